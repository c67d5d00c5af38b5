//! Intervals of voxels by their standard errors: how often they hold the truth.

use std::error::Error;

use serde_json::{Map, Value, json};

use pipeline::PoseNoise;
use reconstruct::Settings;

use crate::poses::Method;
use crate::report::{Report, digits, markdown};
use crate::smoothing::{LIVE, OFFLINE};
use crate::sweep::{PICTURE, Sweep};
use crate::tracker::Noise;

/// Standard deviations of a normal error that hold 68 of 100 cases.
const NORMAL_68: f64 = 0.994_458;
/// The least and the largest share of intervals of 68 % and of 95 % that may hold the truth, for
/// exact and smoothed poses; with interpolated ones they are wide.
const HOLD: [[f64; 2]; 2] = [[0.64, 0.74], [0.93, 0.98]];

/// Intervals of all voxels inside the sweeps.
#[derive(Default)]
struct Intervals {
    voxels: f64,
    /// Those that hold the truth: of 68 % and of 95 %.
    held: [f64; 2],
    /// Sums over voxels: squares of standard errors and of deviations from the truth, grey levels².
    squares: [f64; 2],
    /// Sums over sweeps: noise of a slice, grey levels, and error of poses, mm.
    noise: f64,
    pose_mm: f64,
    sweeps: f64,
}

impl Intervals {
    fn add(&mut self, sweep: &Sweep, method: Method, noise: Noise, seed: u64) -> Result<(), Box<dyn Error>> {
        let poses = method.poses(sweep, &noise.measured(sweep, seed))?;
        let settings = Settings { standard_error: true, ..Sweep::settings() };
        let volume = sweep.reconstructed(settings, &poses.world_from_image)?;
        // Without smoothing, the noise is known beforehand.
        let pose_mm = match method {
            Method::Interpolated => {
                let (position_mm, rotation_deg) = (noise.sd, noise.sd);
                let noise = PoseNoise { position_mm, rotation_deg, probe_from_image: sweep.sensor_from_image() };
                noise.error_mm(PICTURE, "Tracker")
            }
            Method::Exact | Method::Smoothed(_) => poses.error_mm,
        };
        let errors = volume.standard_errors(pose_mm).ok_or("no voxel was reached by two slices")?;
        self.noise += errors.noise();
        self.pose_mm += pose_mm;
        self.sweeps += 1.0;
        for (voxel, truth) in sweep.inside() {
            let Some(error) = errors.at(voxel) else { continue };
            let (r, w) = volume.volume().voxel(voxel);
            let deviation = f64::from((r / w - truth).abs());
            self.voxels += 1.0;
            for (held, half_width) in self.held.iter_mut().zip([error.half_width(NORMAL_68), error.half_width_95()]) {
                *held += f64::from(u8::from(deviation <= half_width));
            }
            self.squares[0] += error.standard_error.powi(2);
            self.squares[1] += deviation.powi(2);
        }
        Ok(())
    }
}

/// Compares intervals with the truth, by the noise of poses.
///
/// # Errors
/// If a slice is refused.
pub(crate) fn compare(
    sweeps: &[Sweep],
    report: &mut Report,
    figures: &mut Map<String, Value>,
) -> Result<(), Box<dyn Error>> {
    let noisy = Noise::white(0.3);
    let kinds = [
        ("exact poses", Method::Exact, Noise::white(0.0)),
        ("0.1 mm, 0.1°, smoothed, 300 ms ahead", Method::Smoothed(OFFLINE), Noise::white(0.1)),
        ("0.3 mm, 0.3°, smoothed, 300 ms ahead", Method::Smoothed(OFFLINE), noisy),
        ("0.3 mm, 0.3°, smoothed, 33 ms ahead", Method::Smoothed(LIVE), noisy),
        ("0.3 mm, 0.3°, interpolated", Method::Interpolated, noisy),
    ];
    let mut lines = Vec::new();
    for (name, method, noise) in kinds {
        let mut found = Intervals::default();
        for (sweep, seed) in sweeps.iter().zip(1..) {
            found.add(sweep, method, noise, seed)?;
        }
        let held = found.held.map(|held| held / found.voxels);
        let [said, actual] = found.squares.map(|sum| (sum / found.voxels).sqrt());
        if method != Method::Interpolated && sweeps.len() > 1 {
            for ((held, [least, most]), percent) in held.iter().zip(HOLD).zip([68, 95]) {
                let holds = (least..=most).contains(held);
                report.findings.check(holds, format!("{name}: intervals of {percent} % hold {held:.3} of the voxels"));
            }
        }
        let [noise, pose_mm] = [found.noise, found.pose_mm].map(|sum| sum / found.sweeps);
        for (what, value) in
            [("68 %", 100.0 * held[0]), ("95 %", 100.0 * held[1]), ("said", said), ("actual", actual), ("noise", noise)]
        {
            figures.insert(format!("intervals/{name}/{what}"), json!(value));
        }
        lines.push(vec![
            name.to_owned(),
            digits(100.0 * held[0], 1),
            digits(100.0 * held[1], 1),
            digits(said, 3),
            digits(actual, 3),
            digits(noise, 3),
            digits(pose_mm, 3),
        ]);
        println!("intervals, {name}");
    }
    let columns =
        ["poses", "68 % hold, %", "95 % hold, %", "standard error", "deviation", "noise of a slice", "of poses, mm"];
    report.section(format!(
        "# Intervals of voxels\n\nShare of the voxels inside a sweep whose interval holds the scene's grey level; root \
         mean squares in grey levels.\n\n{}",
        markdown(&columns, &lines)
    ));
    Ok(())
}
