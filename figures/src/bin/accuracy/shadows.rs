//! Errors behind an absorber that some views see past, with pixels weighted by their shadows.
//!
//! A rod of bone lies in tissue, even or with vessels, cysts and fat. A curvilinear transducer
//! sweeps along it, upright and tilted to both sides. The truth is the mean of the same views
//! without the rod, over several drawn tissues: what the tissue looks like at each place.

use std::error::Error;
use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3};
use rayon::prelude::*;
use serde_json::{Map, Value, json};

use mask::Mask;
use phantom::bmode::Layout;
use phantom::body::{Material, Shape, Solid};
use phantom::scene::Scene;
use phantom::{Body, Motion, Scan, ScanSettings, Scanner};
use reconstruct::{Compounding, Reconstructor, Settings, ShadowWeights};
use sonoweave_core::frames::Transform;
use sonoweave_core::slice::Slice;
use volume::Voxels;
use volume::read::SEEN;

use crate::report::{Report, digits, markdown};
use crate::tracker::Draws;

const IMAGE: [u32; 2] = [320, 280];
/// The echo that is displayed white, dB: tissue around the rod is then mid-grey.
const WHITE_DB: f64 = 18.0;
const DEPTH_MM: f64 = 80.0;
const FRAMES: u32 = 9;
const GAP_MM: f64 = 1.0;
const VOXEL_MM: f64 = 0.6;
/// Middle and radius of the rod, in the plane of the upright view: mm from the transducer's face.
const ROD_MM: f64 = 28.0;
const RADIUS_MM: f64 = 2.5;
/// Tilts of the views about the rod, degrees.
const VIEWS: [&[f64]; 2] = [&[-35.0, 0.0, 35.0], &[0.0, 35.0]];
/// A beam lies in the rod's shadow within this distance of its axis, and beside it beyond the
/// other, mm: the beam has a width.
const IN_SHADOW_MM: f64 = 1.8;
const BESIDE_MM: f64 = 4.5;
/// Voxels along a row or column of the compared plane, on either side of the rod.
const REACH: i64 = 58;
/// Inclusions of an organ.
const INCLUSIONS: usize = 28;
/// Tissues over which the truth is a mean.
const TRUTHS: u64 = 6;
/// Largest part of the mean's error in half shadow, and elsewhere, that shadow weights may leave:
/// in even tissue, and in an organ.
const MOST: [[f64; 2]; 2] = [[0.3, 1.02], [0.4, 1.02]];

/// Tissue, even or with vessels, cysts and fat that a seed draws, with or without the rod.
fn body(organ: Option<u64>, with_rod: bool) -> Body {
    let tissue = Material { fibres: None, attenuation: 0.5, ..Material::muscle("tissue", DVec3::Y) };
    let fat = Material { fibres: None, ..Material::fat("fat") };
    let dense = Material { impedance: 1.7, ..Material::dense("dense", 4.0) };
    let cyst = Material { impedance: 1.7, ..Material::water("cyst") };
    let mut solids = Vec::new();
    if let Some(seed) = organ {
        let mut draws = Draws::new(seed);
        let mut between = move |low: f64, high: f64| low + (high - low) * draws.unit();
        for material in (2..6).cycle().take(INCLUSIONS) {
            let centre = DVec3::new(between(-55.0, 55.0), between(0.0, 100.0), between(-10.0, 10.0));
            let radii = DVec3::new(between(3.0, 10.0), between(3.0, 10.0), between(10.0, 40.0));
            solids.push(Solid { shape: Shape::ellipsoid(centre, radii), material });
        }
    }
    if with_rod {
        let [from, to] = [-100.0, 100.0].map(|z| DVec3::new(0.0, ROD_MM, z));
        solids.push(Solid { shape: Shape::Capsule { from, to, radius: RADIUS_MM }, material: 1 });
    }
    Body {
        name: "rod",
        materials: vec![tissue, Material::bone("bone"), Material::blood("blood"), fat, dense, cyst],
        solids,
        wires: Vec::new(),
        landmarks: Vec::new(),
        world_from_body: DAffine3::IDENTITY,
    }
}

/// Slices of views, in one world, and the point that each view's beams come from.
struct Views {
    slices: Vec<Slice>,
    mask: Mask,
    apexes: Vec<DVec3>,
    rod: DVec3,
}

impl Views {
    fn new(tilts_deg: &[f64], organ: Option<u64>, with_rod: bool, seed: u64) -> Result<Self, Box<dyn Error>> {
        let scanner = Scanner { seed, white_db: WHITE_DB, ..Scanner::abdominal(DEPTH_MM) };
        let pixel_mm = scanner.pixel_mm(IMAGE);
        let face = Layout::new(&scanner, IMAGE, [pixel_mm; 2])?.face_below_middle_mm();
        let rod = DVec3::new(0.0, face + ROD_MM, 0.0);
        let mut views = Self { slices: Vec::new(), mask: Mask::full(1, 1), apexes: Vec::new(), rod };
        for tilt in tilts_deg {
            let turn = DAffine3::from_quat(DQuat::from_rotation_z(tilt.to_radians()));
            let about = DAffine3::from_translation(rod) * turn * DAffine3::from_translation(-rod);
            let mut body = body(organ, with_rod).placed_at(face);
            body.world_from_body = about.inverse() * body.world_from_body;
            let scan = Scan::new(ScanSettings {
                scene: Scene::Body(Arc::new(body)),
                motion: Motion::Parallel,
                frames: FRAMES,
                gap_mm: GAP_MM,
                image_size: IMAGE,
                pixel_mm: [pixel_mm; 2],
                noise_sd: 0.0,
                scanner: Some(scanner),
                seed,
                ..ScanSettings::default()
            })?;
            let apex_px = scan.mask().apex_px().ok_or("a curvilinear transducer has an apex")?;
            for mut slice in scan.slices(0..FRAMES) {
                slice.world_from_image = Transform::from_affine(about * slice.world_from_image.affine());
                views.slices.push(slice);
            }
            let apex = DVec3::new(apex_px[0], apex_px[1], 0.0);
            views.apexes.push(views.slices[views.slices.len() - 1].world_from_image.point(apex));
            views.mask = scan.mask().clone();
        }
        Ok(views)
    }

    /// Returns one of the views.
    fn only(&self, view: usize) -> Self {
        let slices = self.slices[view * FRAMES as usize..][..FRAMES as usize].to_vec();
        Self { slices, mask: self.mask.clone(), apexes: vec![self.apexes[view]], rod: self.rod }
    }

    fn reconstructed(&self, settings: Settings) -> Result<Reconstructor, Box<dyn Error>> {
        let mut volume = Reconstructor::new(settings, self.mask.clone())?;
        for slice in &self.slices {
            volume.insert(slice)?;
        }
        Ok(volume)
    }

    /// Returns the number of views that see a place in shadow, and of those that see past the rod;
    /// `None` near the rod, and where a beam meets its edge. Views need not reach the place.
    fn seen(&self, place: DVec3) -> Option<[usize; 2]> {
        let mut count = [0; 2];
        if place.with_z(0.0).distance(self.rod) < BESIDE_MM {
            return None;
        }
        for apex in &self.apexes {
            let apex = apex.with_z(0.0);
            let beam = (place.with_z(0.0) - apex).normalize();
            let to_rod = self.rod - apex;
            let off = to_rod.reject_from(beam).length();
            let is_behind = to_rod.dot(beam) < (place.with_z(0.0) - apex).length();
            match (is_behind, off) {
                (true, off) if off < IN_SHADOW_MM => count[0] += 1,
                (true, off) if off < BESIDE_MM => return None,
                _ => count[1] += 1,
            }
        }
        Some(count)
    }
}

/// Ways to combine views.
const CONTESTANTS: [&str; 4] = ["mean", "maximum", "shadow weights", "views past the rod alone"];

fn settings(contestant: usize) -> Settings {
    let compounding = if contestant == 1 { Compounding::Maximum } else { Compounding::Mean };
    let shadow_weights = (contestant == 2).then(ShadowWeights::default);
    Settings { shadow_weights, compounding, ..Settings::new(DVec3::splat(VOXEL_MM)) }
}

/// Voxels of the compared plane, across the sweeps through their middle.
fn voxels(rod: DVec3) -> impl Iterator<Item = [i64; 3]> {
    let row = (rod.y / VOXEL_MM).round() as i64;
    (-REACH / 2..REACH).flat_map(move |y| (-REACH / 2..=REACH / 2).map(move |x| [x, row + y, 0]))
}

/// Returns the value of a voxel from its sums; `None` where unseen.
fn value((r, w): (f32, f32)) -> Option<f64> {
    (w > SEEN).then(|| f64::from(r / w))
}

/// Returns the truth at the compared voxels: the mean over drawn tissues without the rod.
fn truth(tilts: &[f64], organ: Option<u64>) -> Result<Vec<Option<f64>>, String> {
    let of_seed = |seed: u64| {
        let views = Views::new(tilts, organ, false, 1000 + seed).map_err(|error| error.to_string())?;
        let volume = views.reconstructed(settings(0)).map_err(|error| error.to_string())?;
        Ok::<Vec<_>, String>(voxels(views.rod).map(|at| value(volume.volume().voxel(at))).collect())
    };
    let all = (0..TRUTHS).into_par_iter().map(of_seed).collect::<Result<Vec<_>, _>>()?;
    let mean = |at: usize| Some(all.iter().map(|of| of[at]).sum::<Option<f64>>()? / TRUTHS as f64);
    Ok((0..all[0].len()).map(mean).collect())
}

/// Sums of squared errors and their numbers, of each contestant: in half shadow, and elsewhere.
type Errors = [[[f64; 2]; 2]; CONTESTANTS.len()];

/// Adds the errors of one drawn tissue.
fn add(errors: &mut Errors, tilts: &[f64], organ: Option<u64>, seed: u64) -> Result<(), Box<dyn Error>> {
    let (views, truth) = (Views::new(tilts, organ, true, seed)?, truth(tilts, organ)?);
    let all = (0..3).map(|contestant| views.reconstructed(settings(contestant))).collect::<Result<Vec<_>, _>>()?;
    let alone = (0..tilts.len()).map(|view| views.only(view));
    let alone =
        alone.map(|one| Ok((one.reconstructed(settings(0))?, one))).collect::<Result<Vec<_>, Box<dyn Error>>>()?;
    for (at, truth) in voxels(views.rod).zip(truth) {
        let place = DVec3::from_array(at.map(|x| x as f64 * VOXEL_MM));
        let kind = match views.seen(place) {
            Some([0, _]) => 1,
            Some([_, past]) if past > 0 => 0,
            _ => continue,
        };
        let past = alone.iter().filter(|(_, one)| one.seen(place) == Some([0, 1]));
        let past = past.map(|(volume, _)| volume.volume().voxel(at)).fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        let sums = all.iter().map(|volume| volume.volume().voxel(at)).chain([past]);
        for (errors, sums) in errors.iter_mut().zip(sums) {
            let (Some(value), Some(truth)) = (value(sums), truth) else { continue };
            let [sum, count] = &mut errors[kind];
            (*sum, *count) = (*sum + (value - truth).powi(2), *count + 1.0);
        }
    }
    Ok(())
}

/// Compares the ways to combine views, by tissue and by the number of views.
///
/// # Errors
/// If a phantom cannot be made.
pub(crate) fn compare(seeds: u64, report: &mut Report, figures: &mut Map<String, Value>) -> Result<(), Box<dyn Error>> {
    let mut lines = Vec::new();
    for (is_organ, (tissue, most)) in [false, true].into_iter().zip([("even", MOST[0]), ("organ", MOST[1])]) {
        for tilts in VIEWS {
            let (mut errors, name) = (Errors::default(), format!("{tissue}, {} views", tilts.len()));
            for seed in 1..=seeds {
                add(&mut errors, tilts, is_organ.then_some(seed), seed)?;
            }
            let rms = errors.map(|kinds| kinds.map(|[sum, count]| (sum / count).sqrt()));
            let parts = [0, 1].map(|kind| rms[2][kind] / rms[0][kind]);
            if tilts.len() == 3 {
                for ((part, most), place) in parts.iter().zip(most).zip(["in half shadow", "elsewhere"]) {
                    let is_less = *part <= most * if seeds > 1 { 1.0 } else { 1.05 };
                    report.findings.check(is_less, format!("{name}: {part:.3} of the mean's error {place}"));
                }
            }
            println!("shadows, {name}: {:.3} of the mean's error in half shadow, {:.3} elsewhere", parts[0], parts[1]);
            for (contestant, [half, elsewhere]) in CONTESTANTS.iter().zip(rms) {
                figures.insert(format!("shadows/{name}/{contestant}/half"), json!(half));
                figures.insert(format!("shadows/{name}/{contestant}/elsewhere"), json!(elsewhere));
                let numbers = [half, elsewhere].map(|rms| digits(rms, 3));
                lines.push([name.clone(), (*contestant).to_owned()].into_iter().chain(numbers).collect());
            }
        }
    }
    let columns = ["tissue", "combination", "half shadow, grey levels", "elsewhere"];
    report.section(format!(
        "# Shadows\n\nRoot mean square errors behind a rod of bone, where some views see past it (half shadow) and \
         where all do (elsewhere). The noise of speckle is part of all of them.\n\n{}",
        markdown(&columns, &lines)
    ));
    Ok(())
}
