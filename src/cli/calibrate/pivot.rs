//! `sonoweave calibrate pivot`: finds a stylus's tip.

use std::fmt::Write as _;

use clap::Args;
use serde::Serialize;

use calibration::pivot::Pivot;
use calibration::statistics::Spread;

use super::super::{Failure, values};
use super::done::{Calibrate, Done, Outlets};
use crate::app::calibrate::outputs::{Input, Outputs, named, place, rows};
use crate::app::calibrate::pivot::{Found, Swings, sds};
use crate::app::calibrate::poses::{Counts, Poses, Recording};

/// Flags of `calibrate pivot`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Put the tip into a small hole and begin to record. Keep the tip in place, and swing the stylus by 30° or more to all \
sides for half a minute. The result is the transform StylusTipToStylus: the tip's position in the frame of the \
stylus's sensor, with z along the shaft away from the sensor.

Examples: sonoweave calibrate pivot --live bedside.toml -o calibration.toml
          sonoweave calibrate pivot --sequence swing.igs.mha -o calibration.toml --json=pivot.json")]
pub struct Arguments {
    #[command(flatten)]
    recording: Recording,
    /// Refuse a result whose tip strays by more, mm (root mean square)
    #[arg(long, value_name = "MM", default_value_t = 2.0, value_parser = values::positive)]
    limit: f64,
    /// Goal for --live: end when the tip is known to this, mm (one standard deviation along the
    /// worst axis)
    #[arg(long, value_name = "MM", default_value_t = 0.1, value_parser = values::positive)]
    goal: f64,
    #[command(flatten)]
    outputs: Outputs,
}

/// Report of a result. The names contain the units.
#[derive(Debug, Serialize)]
struct Report<'a> {
    kind: &'static str,
    input: Input,
    stylus: &'a str,
    frame: &'a str,
    route: &'a str,
    poses: &'a Counts,
    outliers: &'a [usize],
    tip_mm: [f64; 3],
    tip_sd_mm: [f64; 3],
    tip_covariance_mm2: [[f64; 3]; 3],
    pivot_mm: [f64; 3],
    /// Mean distance of the tip from the pivot, without outliers: PLUS's calibration error.
    residual_mm: f64,
    residuals_mm: Spread,
    noise_along_mm: f64,
    noise_across_mm: f64,
    turned: Vec<Turned>,
    correlation_length: f64,
    condition: f64,
    limit_mm: f64,
    /// Row major.
    stylus_tip_to_stylus: [f64; 16],
}

/// Rotation of a direction of the stylus.
#[derive(Debug, Serialize)]
struct Turned {
    axis: [f64; 3],
    rms_deg: f64,
}

impl Calibrate for Arguments {
    fn calibrate(&self, outlets: Outlets<'_>) -> Result<Done, Failure> {
        let Arguments { recording, limit, goal, outputs } = self;
        outputs.check(&[recording.path()])?;
        let swings = Swings { limit_mm: *limit, goal_mm: *goal };
        let Found { recording, read, pivot } = swings.find(recording, outlets.advisor)?;
        let recording = recording.as_ref();

        let input = Input::of(recording.path())?;
        let transform = named("StylusTip", &recording.stylus, &pivot.stylus_from_tip);
        let provenance =
            format!("pivot, {} poses of {}, {:.2} mm", pivot.residual_mm.count, input.name(), pivot.residual_mm.mean);
        let origin = outputs.origin([&input]);
        let sds = sds(&pivot);
        let text = text(recording, &read, &pivot, sds);
        let report = Report {
            kind: "pivot",
            input,
            stylus: &recording.stylus,
            frame: &read.frame,
            route: &read.route,
            poses: &read.counts,
            outliers: &pivot.outliers,
            tip_mm: pivot.tip_mm.to_array(),
            tip_sd_mm: sds,
            tip_covariance_mm2: pivot.tip_covariance_mm2,
            pivot_mm: pivot.pivot_mm.to_array(),
            residual_mm: pivot.residual_mm.mean,
            residuals_mm: pivot.residual_mm,
            noise_along_mm: pivot.noise_mm[0],
            noise_across_mm: pivot.noise_mm[1],
            turned: (pivot.turning.axes.iter().zip(pivot.turning.deg))
                .map(|(axis, rms_deg)| Turned { axis: axis.to_array(), rms_deg })
                .collect(),
            correlation_length: pivot.correlation_length,
            condition: pivot.condition,
            limit_mm: *limit,
            stylus_tip_to_stylus: rows(pivot.stylus_from_tip.affine()),
        };
        let report = outputs.write(&transform, &provenance, origin, &report)?;
        Ok(Done::new(text + &outputs.summary(), report))
    }
}

fn text(recording: &Recording, read: &Poses, pivot: &Pivot, sds: [f64; 3]) -> String {
    let mut text = String::new();
    let spread = &pivot.residual_mm;
    let [x, y, z] = sds.map(|sd| format!("{sd:.3}"));
    // Writing to a string does not fail.
    let _ = writeln!(
        text,
        "tip of {} at {} mm (±{x}, {y}, {z}, one standard deviation), {:.1} mm from its sensor",
        recording.stylus,
        place(pivot.tip_mm),
        pivot.tip_mm.length()
    );
    let _ = writeln!(
        text,
        "the tip strays by {:.3} mm on average (rms {:.3}, at most {:.3}) about {} mm in {}",
        spread.mean,
        spread.rms,
        spread.max,
        place(pivot.pivot_mm),
        read.frame
    );
    let _ = writeln!(
        text,
        "{} of {} poses agree, {} do not{}; noise at the tip {:.3} mm along the shaft, {:.3} across; condition {:.1}",
        spread.count,
        read.counts.read,
        pivot.outliers.len(),
        read.counts.refusals(),
        pivot.noise_mm[0],
        pivot.noise_mm[1],
        pivot.condition
    );
    let [least, middle, most] = pivot.turning.deg.map(|deg| format!("{deg:.0}"));
    let _ = writeln!(text, "the stylus's axes turned by {least}, {middle} and {most}° (rms)");
    text
}
