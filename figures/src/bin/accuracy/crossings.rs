//! Calibrations by crossing sweeps: how near they come, and alarms of slipped sensors.

use std::error::Error;
use std::f64::consts::PI;

use glam::{DAffine3, DMat3, DQuat, DVec3};
use rayon::prelude::*;
use serde_json::{Map, Value, json};

use calibration::crossings::Checked;
use calibration::slices::Slices;
use calibration::trajectory::PoseSample;
use calibration::trajectory::pose_spline::PoseSpline;
use phantom::scene::{Blobs, Scene};
use phantom::{Motion, Scan, ScanSettings};
use sonoweave_core::slice::Pixels;
use sync::clock::TimeFlags;
use sync::history::{PoseHistory, PoseSample as Measured, Rigid};
use sync::smoothing::{Smoothing, smoothed};

use crate::report::{Report, digits, markdown};
use crate::sweep::STEP_NS;
use crate::tracker::Draws;

/// 51×48 mm of pixels.
const IMAGE: [u32; 2] = [128, 120];
const PIXEL_MM: f64 = 0.4;
const NOISE_SD: f64 = 3.0;
/// Slices of a sweep, frames from one to the next, and frames before the first and after the last
/// at which the tracker measures.
const SLICES: u32 = 40;
const EVERY: u32 = 3;
const MARGIN: u32 = 12;
/// Known poses between two frames, and how far the probe moves between frames, mm.
const STEPS: u32 = 8;
const GAP_MM: f64 = 0.35;
/// Steps of a sweep, and the pause before the next, ns.
const SWEEP: u32 = (SLICES * EVERY + 2 * MARGIN) * STEPS;
const PAUSE_NS: i64 = 2_000_000_000;
/// Distance of the sensor from the image's middle, mm, against v.
const LEVER_MM: f64 = 110.0;
/// Noise of the tracker, mm and degrees, 120 times a second.
const TRACKER: f64 = 0.3;
const HALF_WIDTH_NS: i64 = 300_000_000;
/// Largest error of picture points after the correction, with exact and with smoothed poses, mm.
const MOST_MM: [f64; 2] = [0.05, 0.25];
/// Scans for alarms, and the largest share of false ones. Displacements, and the least shares of
/// them that are found.
const ALARMS: u64 = 300;
const FALSE: f64 = 0.01;
const SLIPS: [(f64, f64); 2] = [(0.5, 0.75), (1.0, 1.0)];

/// Three sweeps.
struct Sweeps {
    scan: Scan,
    /// Times, s, and pixels.
    images: Vec<(f64, Vec<u8>)>,
}

/// A wrong calibration.
#[derive(Clone, Copy, Default)]
struct Off {
    translation_mm: DVec3,
    rotation: DVec3,
    scale: [f64; 2],
    lag_s: f64,
}

impl Off {
    /// 1 mm, 1°, 2 % and 10 ms in drawn directions.
    fn draw(draws: &mut Draws) -> Self {
        let translation_mm = draws.direction();
        let sign = if draws.unit() < 0.5 { 1.0 } else { -1.0 };
        let scale = [0.02 * sign, -0.02 * sign];
        Self { translation_mm, rotation: draws.direction() * (PI / 180.0), scale, lag_s: 0.01 * sign }
    }

    fn slip(mm: f64, draws: &mut Draws) -> Self {
        Self { translation_mm: draws.direction() * mm, ..Self::default() }
    }
}

fn time_ns(step: u32) -> i64 {
    i64::from(step) * STEP_NS + i64::from(step / SWEEP) * PAUSE_NS
}

impl Sweeps {
    fn new(seed: u64) -> Result<Self, Box<dyn Error>> {
        let scan = Scan::new(ScanSettings {
            scene: Scene::Blobs(Blobs::draw(seed)),
            motion: Motion::ThreeDirections,
            frames: 3 * SWEEP,
            gap_mm: GAP_MM / f64::from(STEPS),
            image_size: IMAGE,
            pixel_mm: [PIXEL_MM; 2],
            noise_sd: NOISE_SD,
            seed,
            interval_ns: STEP_NS,
            ..ScanSettings::default()
        })?;
        // Every second slice lies between two poses of the tracker.
        let steps = (0..3 * SLICES).map(|k| k / SLICES * SWEEP + (MARGIN + k % SLICES * EVERY) * STEPS + k % 2);
        let image = |step: u32| match &scan.slice(step).image.pixels() {
            Pixels::U8(pixels) => Ok((time_ns(step) as f64 * 1e-9, pixels.to_vec())),
            _ => Err("the scan has 8 bits"),
        };
        let images = steps.map(image).collect::<Result<_, _>>()?;
        Ok(Self { scan, images })
    }

    /// Returns the rigid frame of the image about its middle, mm.
    fn picture(&self, step: u32) -> DAffine3 {
        let image = self.scan.true_world_from_image(step);
        let m = image.affine().matrix3;
        let [right, bottom] = IMAGE.map(|n| f64::from(n) - 1.0);
        DAffine3 {
            matrix3: DMat3::from_cols(m.x_axis.normalize(), m.y_axis.normalize(), m.z_axis.normalize()),
            translation: image.point(DVec3::new(0.5 * right, 0.5 * bottom, 0.0)),
        }
    }

    fn sensor(&self, step: u32) -> DAffine3 {
        self.picture(step) * DAffine3::from_translation(-DVec3::Y * LEVER_MM)
    }

    /// Returns the map from pixels to the sensor's mm, wrong by `off`.
    fn sensor_from_image(&self, off: &Off) -> DAffine3 {
        let sensor = self.sensor(0).inverse();
        let picture = sensor * self.picture(0);
        let rigid = DAffine3::from_rotation_translation(DQuat::from_scaled_axis(off.rotation), off.translation_mm);
        let scale = DAffine3::from_scale(DVec3::new(1.0 + off.scale[0], 1.0 + off.scale[1], 1.0));
        picture * rigid * scale * picture.inverse() * sensor * self.scan.true_world_from_image(0).affine()
    }

    /// Returns the sensor's poses with a tracker's noise, smoothed if there is any.
    fn poses(&self, noise: f64, draws: &mut Draws) -> Vec<PoseSample> {
        let mut found = Vec::new();
        for sweep in 0..3 {
            let measured: Vec<Measured> = (sweep * SWEEP..(sweep + 1) * SWEEP)
                .step_by(2)
                .map(|step| {
                    let truth = self.sensor(step);
                    let [shift, turn] = [draws.vector() * noise, draws.vector() * noise.to_radians()];
                    let turned = DQuat::from_scaled_axis(turn) * DQuat::from_mat3(&truth.matrix3);
                    let pose = Rigid { rotation: turned.normalize(), position_mm: truth.translation + shift };
                    Measured { time_ns: time_ns(step), bound_ns: 0, flags: TimeFlags::NONE, pose, invalid: None }
                })
                .collect();
            let mut history = PoseHistory::new(measured.len(), HALF_WIDTH_NS);
            measured.iter().for_each(|sample| history.insert(sample.clone()));
            found.extend(measured.iter().map(|sample| {
                let smooth = || smoothed(&history, sample.time_ns, &Smoothing::offline(HALF_WIDTH_NS)).ok();
                let pose = if noise > 0.0 { smooth().map_or(sample.pose, |found| found.pose) } else { sample.pose };
                let Rigid { rotation, position_mm } = pose;
                PoseSample { time_s: sample.time_ns as f64 * 1e-9, rotation, position_mm }
            }));
        }
        found
    }

    /// Checks a wrong calibration with these poses. Returns the error of picture points before and
    /// after, root mean square, mm.
    fn checked(&self, poses: &[PoseSample], off: &Off) -> Result<Corrected, Box<dyn Error>> {
        let used = self.sensor_from_image(off);
        let data = vec![true; (IMAGE[0] * IMAGE[1]) as usize];
        let mut slices = Slices::new(IMAGE[0], IMAGE[1], &data, used, PoseSpline::new(poses)?);
        for (time_s, pixels) in &self.images {
            slices.push(time_s - off.lag_s, pixels, IMAGE[0], IMAGE[1]);
        }
        let found = slices.checked()?;
        let truth = self.sensor_from_image(&Off::default());
        let error = |map: DAffine3| {
            let [right, bottom] = IMAGE.map(|n| f64::from(n) - 1.0);
            let places =
                (0..9).map(|k| DVec3::new(0.5 * right * f64::from(k % 3), 0.5 * bottom * f64::from(k / 3), 0.0));
            let squares = places.map(|p| map.transform_point3(p).distance_squared(truth.transform_point3(p)));
            (squares.sum::<f64>() / 9.0).sqrt()
        };
        let errors = [used, found.corrected(used)].map(error);
        Ok((found, errors))
    }
}

/// A check, and errors of picture points before and after, root mean square, mm.
type Corrected = (Checked, [f64; 2]);

/// Errors in threads are texts.
fn text(error: Box<dyn Error>) -> String {
    error.to_string()
}

/// Compares calibrations by crossings with the truth, and alarms with slips.
///
/// # Errors
/// If a scan cannot be painted or is refused.
pub(crate) fn compare(
    sweeps: u64,
    report: &mut Report,
    figures: &mut Map<String, Value>,
) -> Result<(), Box<dyn Error>> {
    let is_quick = sweeps == 1;
    let mut lines = Vec::new();
    for ((name, noise), most) in [("exact", 0.0), ("0.3 mm, 0.3°, smoothed", TRACKER)].into_iter().zip(MOST_MM) {
        let one = |seed: u64| {
            let mut draws = Draws::new(seed);
            let scan = Sweeps::new(seed)?;
            scan.checked(&scan.poses(noise, &mut draws), &Off::draw(&mut draws))
        };
        let all =
            (1..=2 * sweeps).into_par_iter().map(|seed| one(seed).map_err(text)).collect::<Result<Vec<_>, _>>()?;
        let rms = |of: &dyn Fn(&Corrected) -> f64| {
            (all.iter().map(|one| of(one).powi(2)).sum::<f64>() / all.len() as f64).sqrt()
        };
        let [before, after] = [0, 1].map(|k| rms(&|(_, errors)| errors[k]));
        let said = rms(&|(found, _)| found.shift_se_mm);
        let worst = all.iter().map(|(_, errors)| errors[1]).fold(0.0, f64::max);
        let applied = all.iter().filter(|(found, _)| found.unfit().is_none()).count();
        let holds = after <= most;
        report.findings.check(holds, format!("crossings, {name} poses: {after:.3} mm, {most} at most"));
        for (what, value) in [("before", before), ("after", after), ("worst", worst), ("said", said)] {
            figures.insert(format!("crossings/{name}/{what}, mm"), json!(value));
        }
        let numbers = [before, after, worst, said].map(|mm| digits(mm, 3));
        lines.push([vec![name.to_owned()], numbers.to_vec(), vec![format!("{applied} of {}", all.len())]].concat());
        println!("crossings, {name} poses");
    }
    let columns = ["poses", "before, mm", "after, mm", "worst, mm", "standard error, mm", "fit to use"];
    let mut section = format!(
        "# Calibration by crossing sweeps\n\nError of picture points, root mean square over {} scans: 1 mm, 1°, 2 % and \
         10 ms off before.\n\n{}",
        2 * sweeps,
        markdown(&columns, &lines)
    );
    let scans = if is_quick { 2 } else { ALARMS };
    let slips = [(0.0, 0.0)].into_iter().chain(SLIPS);
    let one = |seed: u64| {
        let mut draws = Draws::new(seed);
        let scan = Sweeps::new(seed)?;
        let poses = scan.poses(TRACKER, &mut draws);
        let alarm = |(mm, _)| Ok(scan.checked(&poses, &Off::slip(mm, &mut draws))?.0);
        slips.clone().map(alarm).collect::<Result<Vec<_>, Box<dyn Error>>>()
    };
    let seeds = (1000..1000 + scans).into_par_iter();
    let all = seeds.map(|seed| one(seed).map_err(text)).collect::<Result<Vec<_>, _>>()?;
    let mut lines = Vec::new();
    for (number, (mm, least)) in slips.clone().enumerate() {
        let found = all.iter().map(|scan| &scan[number]);
        let alarms = found.clone().filter(|found| found.has_slipped()).count();
        let share = alarms as f64 / scans as f64;
        let mut shifts: Vec<f64> = found.map(|found| found.shift_mm).collect();
        shifts.sort_by(f64::total_cmp);
        let middle = shifts[shifts.len() / 2];
        let holds = if mm == 0.0 { share <= FALSE } else { share >= least };
        if !is_quick {
            report.findings.check(holds, format!("crossings: {alarms} alarms of {scans} scans slipped by {mm} mm"));
        }
        figures.insert(format!("crossings/alarms/{mm} mm"), json!(share));
        lines.push(vec![digits(mm, 2), format!("{alarms} of {scans}"), digits(100.0 * share, 3), digits(middle, 3)]);
    }
    let columns = ["slipped by, mm", "alarms", "%", "displacement found, median, mm"];
    section += &format!(
        "\n# Alarms of a slipped sensor\n\nThe tracker's noise is 0.3 mm and 0.3°, smoothed.\n\n{}",
        markdown(&columns, &lines)
    );
    report.section(section);
    Ok(())
}
