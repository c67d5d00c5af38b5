//! Calibrations by crossing sweeps: how near they come, and alarms of slipped sensors.

use std::error::Error;
use std::f64::consts::PI;

use glam::{DAffine3, DQuat, DVec3};
use rayon::prelude::*;
use serde_json::{Map, Value, json};

use calibration::crossings::Checked;
use calibration::trajectory::PoseSample;

use crate::crossing_scan::{Sweeps, TRACKER, places};
use crate::report::{Report, digits, markdown};
use crate::tracker::Draws;

/// Largest error of picture points after the correction, with exact and with smoothed poses, mm.
const MOST_MM: [f64; 2] = [0.05, 0.25];
/// Scans for alarms, and the largest share of false ones. Displacements, and the least shares of
/// them that are found.
const ALARMS: u64 = 300;
const FALSE: f64 = 0.01;
const SLIPS: [(f64, f64); 2] = [(0.5, 0.75), (1.0, 1.0)];

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

/// Returns the map from pixels to the sensor's mm, wrong by `off`.
fn wrong(scan: &Sweeps, off: &Off) -> DAffine3 {
    let picture = scan.sensor(0).inverse() * scan.picture(0);
    let rigid = DAffine3::from_rotation_translation(DQuat::from_scaled_axis(off.rotation), off.translation_mm);
    let scale = DAffine3::from_scale(DVec3::new(1.0 + off.scale[0], 1.0 + off.scale[1], 1.0));
    picture * rigid * scale * picture.inverse() * scan.sensor_from_image()
}

/// Checks a wrong calibration with these poses. Returns the error of picture points before and
/// after, root mean square, mm.
fn checked(scan: &Sweeps, poses: &[PoseSample], off: &Off) -> Result<Corrected, Box<dyn Error>> {
    let used = wrong(scan, off);
    let found = scan.slices(poses, used, off.lag_s)?.checked()?;
    let truth = scan.sensor_from_image();
    let error = |map: DAffine3| {
        let squares = places().map(|p| map.transform_point3(p).distance_squared(truth.transform_point3(p)));
        (squares.iter().sum::<f64>() / 9.0).sqrt()
    };
    let errors = [used, found.corrected(used)].map(error);
    Ok((found, errors))
}

/// A check, and errors of picture points before and after, root mean square, mm.
type Corrected = (Checked, [f64; 2]);

/// Errors in threads are texts.
pub(crate) fn text(error: Box<dyn Error>) -> String {
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
            let poses = scan.poses(noise, &mut draws, |_| DAffine3::IDENTITY);
            checked(&scan, &poses, &Off::draw(&mut draws))
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
        let poses = scan.poses(TRACKER, &mut draws, |_| DAffine3::IDENTITY);
        let alarm = |(mm, _)| Ok(checked(&scan, &poses, &Off::slip(mm, &mut draws))?.0);
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
