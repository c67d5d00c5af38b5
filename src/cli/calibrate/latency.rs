//! `sonoweave calibrate latency`: finds the tracker's latency relative to the video.

mod report;

use clap::{ArgGroup, Args};

use calibration::file::CalibrationFile;

use super::super::Failure;
use super::done::{Calibrate, Done, Outlets};
use crate::app::calibrate::latency::Options;
use crate::app::calibrate::outputs::{Outputs, originates};
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

impl Calibrate for Arguments {
    fn calibrate(&self, outlets: Outlets<'_>) -> Result<Done, Failure> {
        let Arguments { options, outputs } = self;
        options.check(outputs)?;
        let report = Report::new(options.find(outlets.advisor)?)?;
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
            file.originates("latency", outputs.origin(report.inputs()));
        };
        let document = outputs.write_changed(change, &report)?;
        Ok(Done::new(report.text(outputs), document))
    }
}
