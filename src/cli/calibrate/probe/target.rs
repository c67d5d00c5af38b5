//! A probe's calibration by a point, a stylus or a plane.

mod page;
mod report;

use std::path::Path;

use super::super::done::{Done, Outlets};
use super::shared::{Inputs, write};
use crate::app::calibrate::outputs::Outputs;
use crate::app::calibrate::probe::target::Found;
use crate::app::calibrate::probe::target::quality::quality;
use crate::app::calibrate::probe::{Lag, Made, Options, pictures};
use crate::cli::Failure;
use report::{Report, text};

/// Calibrates by one of these methods; `tip_file` holds the stylus's tip, if it is one.
///
/// # Errors
/// [`Failure`] when the recording does not determine the image plane; nothing is written then.
pub(super) fn calibrate(
    options: &Options,
    outputs: &Outputs,
    tip_file: Option<&Path>,
    outlets: Outlets<'_>,
) -> Result<Done, Failure> {
    let wants_report = outlets.wants_report || outputs.wants_report();
    let done = options.by_target(tip_file, outlets.advisor, outlets.steps)?;
    let Found { recorded, found, reference, .. } = &done;
    let refined = &found.refined;
    let reproducibility = wants_report.then(|| done.reproducibility()).flatten();
    let report = Report::new(options, Inputs::of(options, recorded.path())?, &done, reproducibility);
    let lag = Lag::of(outputs, recorded, [refined.lag_s, refined.lag_se_s])?;
    let made = Made {
        probe_from_image: refined.probe_from_image(),
        provenance: report.shared.provenance(&report.inputs),
        size_px: found.size_px,
        quality: quality(found),
        covariance: refined.covariance(),
        origin: report.inputs.origin(outputs),
        latency: None,
    };
    let page = || Ok(report.page(&pictures(recorded, &report.listed_frames())?));
    write(options, outputs, made, lag.as_ref(), &report, page, text(found, options.method, reference))
}
