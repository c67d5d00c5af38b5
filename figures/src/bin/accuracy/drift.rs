//! Slow drift of poses, corrected by crossing sweeps.

use std::error::Error;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use calibration::trajectory::pose_spline::PoseSpline;
use glam::{DAffine3, DQuat, DVec3};
use rayon::prelude::*;
use serde_json::{Map, Value, json};

use crate::crossing_scan::{SWEEP, Sweeps, TRACKER, places, time_s};
use crate::crossings::text;
use crate::report::{Report, digits, markdown};
use crate::tracker::Draws;

/// Drift of the sweeps after the first, mm and degrees.
const DRIFT: f64 = 1.0;
/// Largest error of picture points after the correction, with exact and with smoothed poses, mm.
const MOST_MM: [f64; 2] = [0.04, 0.3];

/// A drift: translations and rotations of the picture in the second sweep, and in the third.
type Drift = [[DVec3; 2]; 2];

/// Returns the motion of the picture by a drift at a step: a quarter of a period in a sweep.
fn moved(drift: &Drift, step: u32) -> DAffine3 {
    let share = f64::from(step % SWEEP) / f64::from(SWEEP);
    let Some(sweep) = (step / SWEEP).checked_sub(1) else { return DAffine3::IDENTITY };
    let phase = FRAC_PI_2 * share + if sweep == 0 { 0.0 } else { FRAC_PI_4 };
    let [shift, turn] = drift[sweep as usize].map(|most| most * libm::sin(phase));
    DAffine3::from_rotation_translation(DQuat::from_scaled_axis(turn), shift)
}

/// Returns the errors of picture points before and after, root mean square over the slices, mm.
/// The latter is none if the correction is refused.
fn corrected(seed: u64, noise: f64, size: f64) -> Result<(f64, Option<f64>), Box<dyn Error>> {
    let mut draws = Draws::new(seed);
    let scan = Sweeps::new(seed)?;
    let drift: Drift = [(); 2].map(|()| [draws.direction() * size, draws.direction() * size.to_radians()]);
    let poses = scan.poses(noise, &mut draws, |step| moved(&drift, step));
    let sensor_from_image = scan.sensor_from_image();
    let slices = scan.slices(&poses, sensor_from_image, 0.0)?;
    let path = PoseSpline::new(&poses)?;
    let error = |place: &dyn Fn(f64, DAffine3) -> Option<DAffine3>| {
        let of_slice = |step: u32| -> Option<f64> {
            let at_s = time_s(step);
            let found = place(at_s, path.at(at_s)? * sensor_from_image)?;
            let truth = scan.world_from_image(step);
            let squares = places().map(|p| found.transform_point3(p).distance_squared(truth.transform_point3(p)));
            Some(squares.iter().sum::<f64>() / 9.0)
        };
        let all = scan.steps().map(of_slice).collect::<Option<Vec<f64>>>().ok_or("a slice has no pose")?;
        Ok::<f64, Box<dyn Error>>((all.iter().sum::<f64>() / all.len() as f64).sqrt())
    };
    let before = error(&|_, world_from_image| Some(world_from_image))?;
    let after = match slices.drift() {
        Ok(found) => Some(error(&|at_s, pose| found.corrected(at_s, pose, sensor_from_image))?),
        Err(_) => None,
    };
    Ok((before, after))
}

/// Compares corrected drift with the truth, and counts corrections of scans without drift.
///
/// # Errors
/// If a scan cannot be painted.
pub(crate) fn compare(
    sweeps: u64,
    report: &mut Report,
    figures: &mut Map<String, Value>,
) -> Result<(), Box<dyn Error>> {
    let mut lines = Vec::new();
    for ((name, noise), most) in [("exact", 0.0), ("0.3 mm, 0.3°, smoothed", TRACKER)].into_iter().zip(MOST_MM) {
        let all = |size: f64| {
            let one = |seed| corrected(seed, noise, size).map_err(text);
            (1..=2 * sweeps).into_par_iter().map(one).collect::<Result<Vec<_>, _>>()
        };
        let [drifting, exact] = [all(DRIFT)?, all(0.0)?];
        let rms = |of: &[f64]| (of.iter().map(|mm| mm * mm).sum::<f64>() / of.len() as f64).sqrt();
        let before = rms(&drifting.iter().map(|(before, _)| *before).collect::<Vec<_>>());
        let errors: Vec<f64> = drifting.iter().filter_map(|(_, after)| *after).collect();
        let after = rms(&errors);
        let refused = exact.iter().filter(|(_, after)| after.is_none()).count();
        let holds = errors.len() == drifting.len() && after <= most;
        report.findings.check(holds, format!("drift, {name} poses: {after:.3} mm, {most} at most"));
        let said = format!("drift, {name} poses: {refused} of {} scans without drift are refused", exact.len());
        report.findings.check(refused == exact.len(), said);
        for (what, value) in [("before", before), ("after", after)] {
            figures.insert(format!("drift/{name}/{what}, mm"), json!(value));
        }
        let refused = format!("{refused} of {}", exact.len());
        lines.push(vec![name.to_owned(), digits(before, 3), digits(after, 3), refused]);
        println!("drift, {name} poses");
    }
    let columns = ["poses", "before, mm", "after, mm", "refused without drift"];
    report.section(format!(
        "# Slow drift by crossing sweeps\n\nError of picture points, root mean square over {} scans of three sweeps: \
         the second and the third drift by up to 1 mm and 1°.\n\n{}",
        2 * sweeps,
        markdown(&columns, &lines)
    ));
    Ok(())
}
