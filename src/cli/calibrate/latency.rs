//! `sonoweave calibrate latency`: finds the tracker's latency relative to the video.

mod report;

use clap::{ArgGroup, Args};

use calibration::file::CalibrationFile;

use super::super::Failure;
use super::advice::AdviceDisplay;
use crate::app::calibrate::latency::Options;
use crate::app::calibrate::outputs::{Outputs, originates};
use crate::cli::print::print;
use report::Report;

/// Flags of `calibrate latency`.
#[derive(Debug, Args)]
#[command(
    group(ArgGroup::new("from").required(true).args(["video", "sequence", "session", "live"])),
    after_long_help = "\
--method line: hold the probe above the floor of a water tank, and move it up and down, unevenly, for 10 to 20 s. \
The command compares the floor's line in the frames with the tracker's motion. --method crossings: scan any object \
at rest twice, in crossing directions. The command compares slices where they cross; this check needs no phantom.

A lag above 0 means that the tracker lags the video. tracker.latency_ms = video.latency_ms + 1000 · lag_s; both go \
into the calibration file. A session uses them unless its configuration has latency_ms.

Examples:
  sonoweave calibrate latency --live bedside.toml -o probe.toml
  sonoweave calibrate latency --session SESSION-20261121-213000.mcap -o probe.toml
  sonoweave calibrate latency --video tank-video.igs.mha --tracker tank-tracker.igs.mha --json=latency.json"
)]
pub struct Arguments {
    #[command(flatten)]
    options: Options,
    #[command(flatten)]
    outputs: Outputs,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the recording does not determine the lag; nothing is written then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { options, outputs } = arguments;
    options.check(outputs)?;
    let report = Report::new(options.find(&mut AdviceDisplay::default())?)?;
    if report.latency().tracker_ms.abs() > 1000.0 {
        fail!(
            "the tracker's latency would be {:.0} ms, but 1000 ms is the limit; check that all stamps are from one \
            clock",
            report.latency().tracker_ms
        );
    }
    let change = |file: &mut CalibrationFile| {
        file.latency = Some(report.latency());
        originates(file, "latency", &report.provenance());
        file.originates("latency", arguments.outputs.origin(report.inputs()));
    };
    outputs.write_changed(change, &report)?;
    print(&report.text(outputs))
}
