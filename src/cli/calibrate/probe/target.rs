//! A probe's calibration by a point, a stylus or a plane.

mod page;
mod report;

use std::path::Path;

use super::super::advice::AdviceDisplay;
use crate::app::calibrate::outputs::{Input, Outputs};
use crate::app::calibrate::probe::target::Found;
use crate::app::calibrate::probe::target::quality::quality;
use crate::app::calibrate::probe::{Lag, Made, Options, pictures};
use crate::cli::Failure;
use crate::cli::print::print;
use crate::cli::progress::steps;
use report::{Inputs, Report, text};

/// Runs the command by one of these methods.
///
/// # Errors
/// [`Failure`] when the recording does not determine the image plane; nothing is written then.
pub(super) fn run(options: &Options, outputs: &Outputs) -> Result<(), Failure> {
    let Options { method, validate, limit, .. } = options;
    let path = options.path();
    let tip_file = options.checked()?;
    // The tip's file may be the output file: its other contents are kept.
    let mut inputs: Vec<&Path> = vec![path];
    inputs.extend(validate.as_deref());
    outputs.check(&inputs, true)?;
    let done = options.by_target(tip_file, &mut AdviceDisplay::default(), &steps)?;
    let Found { recorded, found, reference, times_s: [searched_s, solved_s], .. } = &done;
    let path = recorded.path();
    let inputs = Inputs {
        input: Input::of(path)?,
        stylus_tip: tip_file.map(Input::of).transpose()?,
        validation: validate.as_deref().map(Input::of).transpose()?,
    };
    let provenance =
        format!("{}, {} frames of {}, {:.2} mm", method.title(), found.used(), inputs.input.name(), found.errors.mean);
    let origin = outputs.origin(inputs.all());
    let text = text(found, *method, reference);
    let reproducibility = outputs.wants_report().then(|| done.reproducibility());
    let report = Report::new(found, inputs, *method, reference.clone(), *limit)
        .with_times(*searched_s, *solved_s)
        .with_reproducibility(reproducibility.flatten());
    let lag = Lag::of(outputs, recorded, [found.refined.lag_s, found.refined.lag_se_s])?;
    let latency = lag.as_ref().and_then(Lag::latency);
    let result = options.result(Made {
        probe_from_image: found.refined.probe_from_image(),
        provenance,
        size_px: found.size_px,
        quality: quality(found),
        covariance: found.refined.covariance(),
        origin,
        latency,
    })?;
    let of_lag = lag.as_ref().filter(|_| outputs.wants_file()).map_or(String::new(), Lag::text);
    let page = || Ok(report.page(&pictures(recorded, &report.listed_frames())?));
    outputs.write_probe(result, &report, page)?;
    print(&(text + &of_lag + &outputs.summary()))
}
