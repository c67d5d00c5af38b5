//! A pulsating sphere under a probe that moves to and fro: what the reconstructor's volume shows
//! of it under each decay rule.

use std::error::Error;
use std::f64::consts::PI;
use std::path::Path;

use glam::{DMat3, DVec3};
use sonoweave_figures::{Axis, Figure, Ink, Panel, Series, SeriesStyle};

use mask::Mask;
use phantom::scan::Depth;
use phantom::scene::{Pulsating, Sphere};
use phantom::{Motion, Scan, ScanSettings, Scene};
use reconstruct::kernel::{AxisKernel, Method};
use reconstruct::planar::{OnDeparture, PlanarSettings};
use reconstruct::{Compounding, PathReconstructor, Reconstructor, Settings};
use sonoweave_core::slice::Slice;

use crate::decay::{GAP, RATE_HZ, Rule, SPEED, long_wait};
use crate::decay_reconstructed::compounding;
use crate::fading::{Style, rules, series};
use crate::reconstructed_volumes::value;
use crate::report::Report;

/// The decay rate that is shown in detail, 1/s.
const SHOWN: f64 = 10.0;
/// The pass (from 0) after which a profile is shown: backwards, over a sphere that has shrunk.
const PROFILED: usize = 4;
/// Steps of a pass; a trip is two passes, there and back.
const STEPS: u32 = 40;
const TRIPS: u32 = 4;
/// Grey levels within the sphere and around it.
const GREY: [f64; 2] = [180.0, 60.0];
const RADIUS: f64 = 6.0;
const STROKE: f64 = 2.0;
const PERIOD_NS: i64 = 8_000_000_000;
const PIXELS: u32 = 40;
/// Spacing of voxels and of pixels.
const SPACING: f64 = 0.5;
/// Voxels that are evaluated on each side of the middle, in the image plane and along the sweep.
const HALF: [i64; 2] = [18, 23];
const FRESH: Style = ("the newest pass alone", SeriesStyle::Discs, Ink::Black);
const OBJECT: Style = ("the object when last seen", SeriesStyle::Line, Ink::Black);

/// Returns the scan of a trip; the next one begins at its end.
fn trip(number: u32) -> Result<Scan, Box<dyn Error>> {
    let sphere =
        Sphere { centre: DVec3::ZERO, radius: RADIUS, inside: GREY[0], outside: GREY[1], edge_sigma: 0.5 * SPACING };
    let interval_ns = (1e9 / RATE_HZ) as i64;
    Ok(Scan::new(ScanSettings {
        scene: Scene::Pulsating(Pulsating { sphere, stroke_mm: STROKE, period_ns: PERIOD_NS }),
        motion: Motion::OutAndBack,
        frames: 2 * STEPS + 1,
        gap_mm: GAP,
        image_size: [PIXELS; 2],
        pixel_mm: [SPACING; 2],
        noise_sd: 0.0,
        depth: Depth::F32,
        interval_ns,
        first_ns: i64::from(number * 2 * STEPS) * interval_ns,
        ..ScanSettings::default()
    })?)
}

/// Data of one pass.
struct Pass {
    slices: Vec<Slice>,
    /// The sphere as each voxel's nearest slice saw it, in the order of [`voxels`].
    object: Vec<f64>,
    /// The same along the sweep through the middle, more finely.
    profile: Vec<[f64; 2]>,
    /// 1 on the way out, −1 on the way back.
    direction: f64,
}

/// Returns the voxels that are evaluated.
fn voxels() -> impl Iterator<Item = [i64; 3]> {
    let [side, along] = HALF;
    let plane = move |z| (-side..=side).flat_map(move |y| (-side..=side).map(move |x| [x, y, z]));
    (-along..=along).flat_map(plane)
}

fn place(voxel: [i64; 3]) -> DVec3 {
    DVec3::from_array(voxel.map(|x| x as f64 * SPACING))
}

/// Returns the sphere at the time when a pass of a trip reached a position along the sweep.
fn seen(scan: &Scan, direction: f64, z: f64) -> Scene {
    // The turn, in the middle of a trip, is at the sweep's upper end.
    let steps = (0.5 * GAP * f64::from(STEPS) - z) / GAP;
    let before_turn = direction * steps * scan.settings().interval_ns as f64;
    scan.settings().scene.at_time((scan.time_ns(STEPS) as f64 - before_turn) as i64)
}

fn passes() -> Result<Vec<Pass>, Box<dyn Error>> {
    let mut passes = Vec::new();
    for number in 0..TRIPS {
        let scan = trip(number)?;
        // Each trip passes a position twice: the turn is in its middle.
        let first = u32::from(number > 0);
        for (frames, direction) in [(first..STEPS + 1, 1.0), (STEPS + 1..2 * STEPS + 1, -1.0)] {
            let (mut object, mut layer, mut sphere) = (Vec::new(), i64::MIN, Scene::Constant(0.0));
            for voxel in voxels() {
                if voxel[2] != layer {
                    layer = voxel[2];
                    sphere = seen(&scan, direction, SPACING * layer as f64);
                }
                object.push(sphere.value(place(voxel)));
            }
            let fine = (-1200..=1200).map(|i| f64::from(i) * 0.01);
            let profile = fine.map(|z| [z, seen(&scan, direction, z).value(DVec3::Z * z)]).collect();
            passes.push(Pass { slices: scan.slices(frames), object, profile, direction });
        }
    }
    Ok(passes)
}

/// Returns the radius of the sphere with the same volume as the bright voxels, and its centre
/// along the sweep.
fn measure(values: &[Option<f64>]) -> [f64; 2] {
    let (mut mass, mut moment) = (0.0, 0.0);
    for (value, voxel) in values.iter().zip(voxels()) {
        let part = (value.unwrap_or(GREY[1]) - GREY[1]) / (GREY[0] - GREY[1]);
        mass += part;
        moment += part * place(voxel).z;
    }
    let volume = mass * SPACING.powi(3);
    [(0.75 * volume / PI).cbrt(), moment / mass]
}

fn rms(a: &[Option<f64>], b: &[Option<f64>]) -> f64 {
    let squares: Vec<f64> = a.iter().zip(b).filter_map(|(a, b)| Some(((*a)? - (*b)?).powi(2))).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// Returns the largest difference; infinite if only one has a value.
fn largest(a: &[Option<f64>], b: &[Option<f64>]) -> f64 {
    let apart = |(a, b): (&Option<f64>, &Option<f64>)| match (a, b) {
        (Some(a), Some(b)) => (a - b).abs(),
        (None, None) => 0.0,
        _ => f64::INFINITY,
    };
    a.iter().zip(b).map(apart).fold(0.0, f64::max)
}

fn settings(compounding: Compounding) -> Settings {
    Settings {
        method: Method::GaussianTruncated,
        compounding,
        sigma_mm: [None, None, Some(1.0)],
        ..Settings::new(DVec3::splat(SPACING))
    }
}

fn reconstructor(compounding: Compounding) -> Result<Reconstructor, Box<dyn Error>> {
    Ok(Reconstructor::new(settings(compounding), Mask::full(PIXELS, PIXELS))?)
}

/// Returns the values by the planar path after all passes, with one age per column.
fn planar(compounding: Compounding, passes: &[Pass]) -> Result<Vec<Option<f64>>, Box<dyn Error>> {
    // Columns along image axis u, which is the world's x.
    let direction = Some(DMat3::from_cols(DVec3::Y, DVec3::Z, DVec3::X));
    let planar = PlanarSettings { direction, on_departure: OnDeparture::Refuse, ..PlanarSettings::default() };
    let mut reconstructor = PathReconstructor::planar(settings(compounding), planar, Mask::full(PIXELS, PIXELS))?;
    for slice in passes.iter().flat_map(|pass| &pass.slices) {
        reconstructor.insert(slice)?;
    }
    Ok(voxels().map(|[x, y, z]| value(reconstructor.volume(), [y, z, x])).collect())
}

fn insert(reconstructor: &mut Reconstructor, pass: &Pass) -> Result<Vec<Option<f64>>, Box<dyn Error>> {
    for slice in &pass.slices {
        reconstructor.insert(slice)?;
    }
    Ok(voxels().map(|voxel| value(reconstructor.volume(), voxel)).collect())
}

/// Results of one rule, after each pass.
#[derive(Default)]
struct RuleResults {
    /// Profile along the sweep through the middle, after one pass.
    profile: Vec<[f64; 2]>,
    radius: Vec<f64>,
    /// Lead of the shown centre over the object's, along the pass, mm.
    ahead: Vec<f64>,
    /// Difference from the newest pass alone, grey levels rms.
    off: Vec<f64>,
    /// The final values.
    values: Vec<Option<f64>>,
    /// The reconstructor's own bound on the deviation from the exact in-plane sum, grey levels.
    stated: f64,
}

impl RuleResults {
    fn after(&mut self, pass: &Pass, fresh: &[Option<f64>]) {
        let values = &self.values;
        let object: Vec<Option<f64>> = pass.object.iter().copied().map(Some).collect();
        let [[radius, centre], [_, truth]] = [measure(values), measure(&object)];
        if self.radius.len() + 1 == PROFILED {
            let axis = values.iter().zip(voxels()).filter(|(_, voxel)| voxel[..2] == [0, 0]);
            self.profile = axis.map(|(v, voxel)| [place(voxel).z, v.unwrap_or(f64::NAN)]).collect();
        }
        self.radius.push(radius);
        self.ahead.push(pass.direction * (centre - truth));
        self.off.push(rms(values, fresh));
    }

    fn radii(&self) -> Vec<[f64; 2]> {
        (1..).map(f64::from).zip(&self.radius).map(|(pass, radius)| [pass, *radius]).collect()
    }

    /// Returns the mean centre offset and the rms difference, over the passes that have a past.
    fn summary(&self) -> [f64; 2] {
        let count = self.off.len() as f64 - 1.0;
        let ahead = self.ahead.iter().skip(1).sum::<f64>() / count;
        [ahead, (self.off.iter().skip(1).map(|off| off * off).sum::<f64>() / count).sqrt()]
    }
}

/// Draws the figure. Returns the difference between the planar and the general path, grey
/// levels, over all rules.
pub(crate) fn draw(
    report: &mut Report,
    folder: &Path,
    kernel: AxisKernel,
    rates: &[f64],
) -> Result<f64, Box<dyn Error>> {
    let wait = long_wait(&kernel);
    let passes = passes()?;
    let [mut object, mut alone]: [RuleResults; 2] = Default::default();
    let mut fresh = Vec::new();
    for pass in &passes {
        let values = insert(&mut reconstructor(Compounding::Mean)?, pass)?;
        object.values = pass.object.iter().copied().map(Some).collect();
        object.after(pass, &values);
        alone.values.clone_from(&values);
        alone.after(pass, &values);
        fresh.push(values);
    }
    let reconstruct = |rule: Rule| -> Result<RuleResults, Box<dyn Error>> {
        let mut results = RuleResults::default();
        let mut reconstructor = reconstructor(compounding(rule))?;
        for (pass, fresh) in passes.iter().zip(&fresh) {
            results.values = insert(&mut reconstructor, pass)?;
            results.after(pass, fresh);
        }
        results.stated = reconstructor.decimation().map_or(0.0, |(_, part)| part * 255.0);
        Ok(results)
    };
    let unfaded = reconstruct(Rule::None)?;
    let mut profiles = vec![series(OBJECT, passes[PROFILED - 1].profile.clone()), series(FRESH, alone.profile.clone())];
    let mut radii = vec![series(OBJECT, object.radii()), series(FRESH, alone.radii())];
    let [mut ahead, mut off]: [Vec<Series>; 2] = Default::default();
    let mut shown = Vec::new();
    // Differences between the planar and the general path, over all rules.
    let [mut ages, mut stated] = [0.0_f64; 2];
    // Values at the slowest rate, and the smallest difference at any.
    let [mut slowest, mut least]: [Vec<f64>; 2] = Default::default();
    for (i, (style, rule)) in rules(SHOWN, wait).into_iter().enumerate() {
        let mut summaries = Vec::new();
        for rate in rates {
            let faded = (rule != Rule::None).then(|| reconstruct(rules(*rate, wait)[i].1)).transpose()?;
            let results = faded.as_ref().unwrap_or(&unfaded);
            summaries.push(results.summary());
            if *rate == SHOWN {
                profiles.push(series(style, results.profile.clone()));
                radii.push(series(style, results.radii()));
                shown.push(results.summary());
                let columns = planar(compounding(rules(*rate, wait)[i].1), &passes)?;
                ages = ages.max(largest(&results.values, &columns));
                stated = stated.max(results.stated);
            }
        }
        let over = |c: usize| rates.iter().zip(&summaries).map(|(rate, summary)| [*rate, summary[c]]).collect();
        ahead.push(series(style, over(0)));
        off.push(series(style, over(1)));
        slowest.push(summaries.first().map_or(f64::NAN, |summary| summary[1]));
        least.push(summaries.iter().map(|summary| summary[1]).fold(f64::INFINITY, f64::min));
    }
    let [exponential, dead, none, printed, printed_wait] = shown[..] else { return Err("five rules".into()) };
    // The reference: a pass without a past shows the object's position and size correctly.
    let largest_of = |values: &mut dyn Iterator<Item = f64>| values.map(f64::abs).fold(0.0, f64::max);
    let place = largest_of(&mut alone.ahead.iter().copied());
    let size = largest_of(&mut alone.radius.iter().zip(&object.radius).map(|(a, b)| a - b));
    report.check(place < 0.01 && size < 0.01, format!("a pass alone shows the sphere {place} and {size} mm off"));
    let lag = SHOWN * kernel.sigma_effective_mm().powi(2) / SPEED;
    report.near("how far behind the sphere exponential decay shows it", -exponential[0], lag, 0.2);
    report.check(dead[0].abs() < 0.02, format!("a wait shows the sphere {} mm ahead", dead[0]));
    report.check(dead[1] < 0.5, format!("a wait leaves {} grey levels of the past", dead[1]));
    report.check(none[1] > 20.0 * dead[1], format!("without decay {} grey levels remain", none[1]));
    report.check(
        least[0] > 3.0 * dead[1] && least[3] > 3.0 * dead[1],
        format!("a rule without a wait comes as near as one with it: {least:?}"),
    );
    report.check(
        slowest[1] > 3.0 * dead[1],
        format!("after a wait a slow rate leaves no more than a fast one: {slowest:?}"),
    );
    let mean = object.radius.iter().sum::<f64>() / object.radius.len() as f64;
    let left = unfaded.radius.last().map_or(f64::NAN, |radius| radius - mean);
    report.check(left.abs() < 0.5, format!("without decay the radius is {left} mm from the mean of all passes"));
    report.check(printed_wait[0] > 1.9, format!("the printed formula with the wait shows {printed_wait:?}"));
    report.check(
        printed_wait[1] > none[1],
        format!("the printed formula with the wait is nearer than no decay: {printed_wait:?}, {none:?}"),
    );
    report.check(
        ages <= stated,
        format!(
            "with an age a column the sphere is {ages} grey levels from that with an age a voxel, more than {stated}"
        ),
    );
    let pass_s = f64::from(STEPS) / RATE_HZ;
    let (beat_s, end) = (PERIOD_NS as f64 * 1e-9, f64::from(2 * TRIPS) + 0.3);
    let [first, last] = [rates.first(), rates.last()].map(|rate| rate.copied().unwrap_or(SHOWN));
    let figure = Figure {
        id: "decay-sphere",
        title: "A sphere that swells and shrinks under a probe that goes to and fro".into(),
        caption: format!(
            "By the reconstructor, in three dimensions: radius {RADIUS} mm ± {STROKE} mm in {beat_s} s, {pass_s:.2} s a pass, σ = 1 mm across the slices. At a = \
             {SHOWN}/s: exponential decay shows the sphere {:.2} mm behind where the probe saw it (a·σ_eff²/v = {lag:.2}) and is {:.1} grey levels rms from \
             the newest pass alone; after a wait of 2d/v {:.3} mm and {:.1}; as printed {:.2} mm behind and {:.1}; as printed after the wait {:.2} mm ahead \
             and {:.1}; without decay the radius tends to the mean of all passes, and {:.1}. Without a wait no rate both forgets the last pass and keeps this one whole. \
             Near its turns the probe comes back soon, and a slow rate has not faded what is there.",
            -exponential[0],
            exponential[1],
            dead[0].abs(),
            dead[1],
            -printed[0],
            printed[1],
            printed_wait[0],
            printed_wait[1],
            none[1]
        ),
        columns: 2,
        height: 240.0,
        panels: vec![
            Panel::new(
                format!("After pass {PROFILED}, which goes left; a = {SHOWN}/s"),
                Axis::linear("position along the sweep, mm").from_to(-11.0, 11.0),
                Axis::linear("value, grey levels").from_to(40.0, 200.0),
                profiles,
            ),
            Panel::new(
                format!("Radius of what is shown; a = {SHOWN}/s"),
                Axis::linear("pass").from_to(0.7, end),
                Axis::linear("radius of the same volume, mm").from_to(3.0, 9.0),
                radii,
            ),
            Panel::new(
                "How far ahead of the object, along the pass",
                Axis::log("rate of decay a, 1/s").from_to(first, last),
                Axis::linear("place of the centre shown, mm").from_to(-2.5, 2.5),
                ahead,
            ),
            Panel::new(
                "How far from what the newest pass alone shows",
                Axis::log("rate of decay a, 1/s").from_to(first, last),
                Axis::linear("rms, grey levels").from_to(0.0, 30.0),
                off,
            ),
        ],
    };
    report.figure(figure, folder)?;
    Ok(ages)
}
