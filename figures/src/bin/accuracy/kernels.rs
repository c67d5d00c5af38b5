//! Errors of volumes by their kernel, with exact poses.

use std::error::Error;
use std::path::Path;

use glam::{DMat3, DVec3};
use rayon::prelude::*;
use serde_json::{Map, Value, json};

use mask::Mask;
use phantom::scene::{Blobs, Scene};
use phantom::{Motion, Scan, ScanSettings, truth};
use reconstruct::kernel::Method;
use reconstruct::{PathReconstructor, Settings};
use sonoweave_core::slice::Slice;
use sonoweave_figures::{Axis, Figure, Ink, Panel, Series, SeriesStyle};
use volume::{Grid, Voxels};

use crate::crossings::text;
use crate::report::{Report, digits, markdown};
use crate::tracker::Draws;

const GAP_MM: f64 = 0.35;
/// Widths along u and v, and across the plane, mm; in a quick run, those about the best.
const QUICK_MM: [f64; 3] = [0.3, 0.375, 0.45];
const QUICK_ACROSS_MM: [f64; 2] = [0.25, 0.3];
const IN_PLANE_MM: [f64; 7] = [0.2, 0.25, 0.3, 0.375, 0.45, 0.5, 0.6];
const ACROSS_MM: [f64; 4] = [0.25, 0.3, 0.35, 0.4];
/// Kernels that are compared, without and with gap weights; each as it is, and with its first
/// moment corrected.
pub(crate) const KERNELS: [(Method, bool); 4] = [
    (Method::GaussianTruncated, false),
    (Method::GaussianTruncated, true),
    (Method::Gaussian4, false),
    (Method::Gaussian4, true),
];
/// Number of contestants.
pub(crate) const ALL: usize = 2 * KERNELS.len();
/// Those that are drawn, with their series.
const DRAWN: [(usize, SeriesStyle, Ink); 4] = [
    (0, SeriesStyle::Dashed, Ink::Vermilion),
    (3, SeriesStyle::Line, Ink::Vermilion),
    (4, SeriesStyle::Dashed, Ink::Blue),
    (7, SeriesStyle::Line, Ink::Blue),
];

/// Returns the name of a contestant.
fn name(contestant: usize) -> String {
    let (method, by_gaps) = KERNELS[contestant / 2];
    let more = match (by_gaps, contestant % 2 == 1) {
        (false, false) => "",
        (true, false) => ", gap weights",
        (false, true) => ", first moment",
        (true, true) => ", both",
    };
    format!("{}{more}", method.name())
}

/// Inserts slices, by their gaps if these count.
///
/// # Errors
/// If a slice is refused.
pub(crate) fn inserted(
    settings: Settings,
    mask: &Mask,
    slices: &[&Slice],
) -> Result<PathReconstructor, Box<dyn Error>> {
    let gaps = settings.weights_by_gaps();
    let mut volume = PathReconstructor::general(settings, mask.clone())?;
    let (poses, size) = (slices.iter().map(|slice| slice.world_from_image), [mask.width(), mask.height()]);
    let weights = gaps.map_or_else(|| vec![1.0; slices.len()], |gaps| gaps.of_sweep(poses, size));
    for (slice, weight) in slices.iter().zip(weights) {
        volume.insert_weighted(slice, weight)?;
    }
    Ok(volume)
}

/// Most scans of an uneven sweep: each has as many voxels as ten of the others.
const UNEVEN_SEEDS: u64 = 3;
/// Frames of a dense sweep for one of an uneven one.
const DENSE: u32 = 20;
/// Voxels within so many of the border are not compared.
const BORDER: i64 = 4;

/// A sweep with its truth.
struct Case {
    scan: Scan,
    slices: Vec<Slice>,
    places: Vec<([i64; 3], f32)>,
    spacing_mm: f64,
}

impl Case {
    fn new(scene: Scene, sweep: &Sweep, seed: u64) -> Result<Self, Box<dyn Error>> {
        let is_fine = sweep.uneven.is_some();
        let spacing_mm = if is_fine { 0.3 } else { 0.5 };
        // An uneven sweep takes some frames of a dense one. The density of noise is the same.
        let dense = if is_fine { DENSE } else { 1 };
        let scan = Scan::new(ScanSettings {
            scene,
            motion: sweep.motion,
            frames: 80 * dense,
            gap_mm: GAP_MM / f64::from(dense),
            image_size: if is_fine { [512, 480] } else { [160, 140] },
            pixel_mm: [if is_fine { 0.1 } else { 0.2 }; 2],
            noise_sd: if is_fine { 6.0 } else { 3.0 },
            seed,
            ..ScanSettings::default()
        })?;
        let slices = match sweep.uneven {
            Some(part) => uneven(scan.frames(), part, seed).map(|frame| scan.slice(frame)).collect(),
            None => scan.slices(0..scan.frames()),
        };
        let mut case = Self { scan, slices, places: Vec::new(), spacing_mm };
        let volume = case.reconstructed(KERNELS[0], [0.3, 0.3])?;
        let (low, high) = volume.volume().seen_bounds().ok_or("no voxel is seen")?;
        let (low, high) = (low.map(|x| x + BORDER), high.map(|x| x - BORDER));
        let size = [0, 1, 2].map(|a| (high[a] - low[a] + 1).max(0) as u64);
        let origin = DVec3::from_array(low.map(|x| x as f64)) * spacing_mm;
        let grid = Grid { origin, spacing: DVec3::splat(spacing_mm), direction: DMat3::IDENTITY, size };
        let grey = truth::sample(&case.scan.settings().scene, &grid)?;
        let index = |i: u64| [i % size[0], i / size[0] % size[1], i / size[0] / size[1]];
        let places = (0..).zip(grey).map(|(i, grey)| {
            let at = index(i);
            ([0, 1, 2].map(|a| low[a] + at[a] as i64), grey)
        });
        let places: Vec<([i64; 3], f32)> = places.collect();
        let weights = places.iter().map(|(at, _)| volume.volume().voxel(*at).1);
        let mut weights: Vec<f32> = weights.filter(|w| *w > 0.0).collect();
        weights.sort_by(f32::total_cmp);
        let median = *weights.get(weights.len() / 2).ok_or("no voxel is seen")?;
        let inside = places.into_iter().filter(|(at, _)| volume.volume().voxel(*at).1 > 0.5 * median);
        case.places = inside.collect();
        Ok(case)
    }

    fn reconstructed(
        &self,
        (method, gap_weights): (Method, bool),
        [plane, across]: [f64; 2],
    ) -> Result<PathReconstructor, Box<dyn Error>> {
        let sigma_mm = [Some(plane), Some(plane), Some(across)];
        let usual = Settings { threads: 1, ..Settings::new(DVec3::splat(self.spacing_mm)) };
        let settings = Settings { method, sigma_mm, gap_weights, ..usual };
        inserted(settings, self.scan.mask(), &self.slices.iter().collect::<Vec<_>>())
    }

    /// Returns the mean square of the error, grey levels², of a volume and with its first moment
    /// corrected.
    fn mean_squares(&self, kernel: (Method, bool), widths_mm: [f64; 2]) -> Result<[f64; 2], Box<dyn Error>> {
        let volume = self.reconstructed(kernel, widths_mm)?;
        let corrected = volume.first_moment().ok_or("nothing is corrected")?;
        let both: [&dyn Voxels; 2] = [volume.volume(), &corrected];
        Ok(both.map(|volume| {
            let (mut sum, mut count) = (0.0, 0.0);
            for (at, truth) in &self.places {
                let (r, w) = volume.voxel(*at);
                if w > 0.0 {
                    sum += f64::from(r / w - truth).powi(2);
                    count += 1.0;
                }
            }
            sum / count
        }))
    }
}

/// Returns frames of a dense sweep: steps of [`DENSE`] frames times numbers drawn uniformly from
/// 1 − `part` to 1 + `part`.
fn uneven(frames: u32, part: f64, seed: u64) -> impl Iterator<Item = u32> {
    let mut draws = Draws::new(seed);
    let mut gap = move || f64::from(DENSE) * (1.0 + part * (2.0 * draws.unit() - 1.0));
    std::iter::successors(Some(0.0), move |at| Some(at + gap())).map(|at| at as u32).take_while(move |at| *at < frames)
}

/// A sweep that is compared, and the largest part of the Gaussian's error that the last contestant
/// may have.
struct Sweep {
    name: &'static str,
    motion: Motion,
    /// Images of 512×480, and gaps that differ by up to this part of their mean.
    uneven: Option<f64>,
    most: f64,
}

const SWEEPS: [Sweep; 5] = [
    Sweep { name: "blobs, freehand", motion: Motion::Freehand, uneven: None, most: 0.85 },
    Sweep { name: "blobs, gaps ± 50 %", motion: Motion::Parallel, uneven: Some(0.5), most: 0.78 },
    Sweep { name: "blobs, gaps ± 90 %", motion: Motion::Parallel, uneven: Some(0.9), most: 0.73 },
    Sweep { name: "blobs, crossing sweeps", motion: Motion::Crossing, uneven: None, most: 0.8 },
    Sweep { name: SPHERE, motion: Motion::Freehand, uneven: None, most: 1.03 },
];
const SPHERE: &str = "hard sphere";

/// A width in the plane, with the least error over those across it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Least {
    pub(crate) plane: f64,
    pub(crate) across: f64,
    pub(crate) rmse: f64,
}

/// Errors of each contestant, by the width in the plane.
pub(crate) type ByWidth = [Vec<Least>; ALL];

impl Sweep {
    /// Returns the errors of each contestant by the width in the plane.
    fn errors(&self, seeds: u64, is_quick: bool) -> Result<ByWidth, Box<dyn Error>> {
        let scene = |seed| match self.name {
            SPHERE => Scene::standard_sphere(),
            _ => Scene::Blobs(Blobs::draw(seed)),
        };
        let cases = (1..=seeds).map(|seed| Case::new(scene(seed), self, seed));
        let cases = cases.collect::<Result<Vec<_>, _>>()?;
        let (planes, acrosses) =
            if is_quick { (&QUICK_MM[..], &QUICK_ACROSS_MM[..]) } else { (&IN_PLANE_MM[..], &ACROSS_MM[..]) };
        // Volumes at once, of one thread each: a small one occupies two threads badly.
        let least = |(kernel, plane): ((Method, bool), f64)| {
            let mut least = [Least { plane, across: 0.0, rmse: f64::INFINITY }; 2];
            for across in acrosses {
                let mut sums = [0.0; 2];
                for case in &cases {
                    let squares = case.mean_squares(kernel, [plane, *across]).map_err(text)?;
                    (0..2).for_each(|i| sums[i] += squares[i] / cases.len() as f64);
                }
                for (least, sum) in least.iter_mut().zip(sums) {
                    if sum.sqrt() < least.rmse {
                        (least.across, least.rmse) = (*across, sum.sqrt());
                    }
                }
            }
            Ok(least)
        };
        let widths = KERNELS.iter().flat_map(|kernel| planes.iter().map(move |plane| (*kernel, *plane)));
        let widths: Vec<((Method, bool), f64)> = widths.collect();
        let found = widths.into_par_iter().map(least).collect::<Result<Vec<_>, String>>()?;
        let mut errors = [const { Vec::new() }; ALL];
        for (number, least) in found.iter().enumerate() {
            let kernel = number / planes.len();
            (0..2).for_each(|i| errors[2 * kernel + i].push(least[i]));
        }
        Ok(errors)
    }
}

/// Prints, records and returns the rows of a table: the best width of each contestant.
pub(crate) fn rows(sweep: &str, best: &[Least], key: &str, figures: &mut Map<String, Value>) -> Vec<Vec<String>> {
    let mut rows = Vec::new();
    for (contestant, Least { plane, across, rmse }) in best.iter().enumerate() {
        let kernel = name(contestant);
        figures.insert(format!("{key}/{kernel}/RMSE"), json!(rmse));
        figures.insert(format!("{key}/{kernel}/width"), json!(plane));
        let numbers = [digits(*plane, 3), digits(*across, 3), digits(*rmse, 4), digits(rmse / best[0].rmse, 3)];
        rows.push([sweep.to_owned(), kernel].into_iter().chain(numbers).collect());
    }
    let ratios = best.iter().map(|least| format!("{:.3}", least.rmse / best[0].rmse));
    println!("{key}: {}", ratios.collect::<Vec<_>>().join(", "));
    rows
}

/// Returns the series of the contestants that are drawn.
pub(crate) fn drawn(errors: &ByWidth) -> Vec<Series> {
    let series = DRAWN.map(|(contestant, style, ink)| {
        let points = errors[contestant].iter().map(|least| [least.plane, least.rmse]).collect();
        Series::new(name(contestant), style, ink, points)
    });
    series.into()
}

/// Compares the kernels over their widths.
///
/// # Errors
/// If a phantom cannot be made, or a file cannot be written.
pub(crate) fn compare(
    seeds: u64,
    report: &mut Report,
    figures: &mut Map<String, Value>,
    folder: &Path,
) -> Result<(), Box<dyn Error>> {
    let (mut lines, mut panels) = (Vec::new(), Vec::new());
    for sweep in &SWEEPS {
        let own = if sweep.uneven.is_some() { seeds.min(UNEVEN_SEEDS) } else { seeds };
        let (name, errors) = (sweep.name, sweep.errors(own, seeds == 1)?);
        // The sphere's edges want the narrowest kernel: it is compared at an equal width.
        let best = |of: &[Least]| match name {
            SPHERE => of.iter().find(|least| least.plane == 0.3).copied(),
            _ => of.iter().copied().min_by(|a, b| a.rmse.total_cmp(&b.rmse)),
        };
        let best = errors.iter().map(|of| best(of).ok_or("no width")).collect::<Result<Vec<_>, _>>()?;
        let ratio = best[ALL - 1].rmse / best[0].rmse;
        let most = sweep.most * if seeds > 1 { 1.0 } else { 1.05 };
        report.findings.check(ratio <= most, format!("{name}: {ratio:.3} of the Gaussian's error, more than {most}"));
        figures.insert(format!("kernels/{name}/ratio"), json!(ratio));
        lines.extend(rows(name, &best, &format!("kernels/{name}"), figures));
        let (x, y) = (Axis::linear("σ in the plane, mm"), Axis::linear("error, grey levels"));
        panels.push(Panel::new(name, x, y, drawn(&errors)));
    }
    let columns = ["sweep", "kernel", "σ in the plane, mm", "across", "RMSE, grey levels", "× of the Gaussian"];
    report.section(format!(
        "# Kernels\n\nExact poses, gaps of 0.35 mm on average. The best width of each kernel; for the sphere, whose \
         edges want the narrowest, σ 0.3. First moment: corrected values of the same volume.\n\n{}",
        markdown(&columns, &lines)
    ));
    report.findings.figure(
        Figure {
            id: "kernels",
            title: "Kernels: errors by their width".into(),
            caption: "Sweeps with exact poses, gaps of 0.35 mm on average and noise of 3 grey levels in pixels of 0.2 \
                      mm; those of uneven gaps 512×480 pixels of 0.1 mm with 6. At each width in the plane, the best \
                      one across it; both: gap weights and first moment. Root mean squares inside the sweep."
                .into(),
            columns: 2,
            height: 230.0,
            panels,
        },
        folder,
    )
}
