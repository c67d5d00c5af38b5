//! `sonoweave calibrate crossings`: checks a probe's calibration by slices that cross.

mod report;

use clap::{ArgGroup, Args};

use super::super::Failure;
use super::done::{Calibrate, Done, Outlets};
use crate::app::calibrate::crossings::Options;
use crate::app::calibrate::outputs::Outputs;
use report::Report;

/// Flags of `calibrate crossings`.
#[derive(Debug, Args)]
#[command(
    group(ArgGroup::new("from").required(true).args(["sequence", "session"])),
    after_long_help = "\
Sweep the same place of a body at rest three times: upright, turned by 90° about the probe's axis, and tilted by 30°. \
Crossing slices then show the same lines. The command finds the calibration by which they agree best: the image's \
pose at the sensor, its scale and the tracker's latency. It fails if the calibration in use displaces the image by \
more than chance explains, as when the sensor has slipped, or if the sweeps do not tell.

With -o it writes the calibration found into a new file, and fails if that is not certain enough, or too far from the \
one in use: a phantom then determines it better.

Examples:
  sonoweave calibrate crossings --session SESSION-20261121-213000.mcap
  sonoweave calibrate crossings --sequence scan.igs.mha --config probe.toml -o corrected.toml --json=check.json"
)]
pub struct Arguments {
    #[command(flatten)]
    options: Options,
    #[command(flatten)]
    outputs: Outputs,
}

impl Calibrate for Arguments {
    fn calibrate(&self, _: Outlets<'_>) -> Result<Done, Failure> {
        let Arguments { options, outputs } = self;
        options.check(outputs)?;
        let found = options.find()?;
        let report = Report::new(&found);
        let unfit = found.checked.unfit();
        let document = match (outputs.file(), &unfit) {
            (Some(path), Some(why)) => {
                fail!("{}: not written: {why}", path.display());
            }
            (Some(_), None) => {
                let page = || Ok(String::new());
                outputs.write_probe(Some(options.kept()?), found.result(outputs), &report, page)?
            }
            (None, _) => outputs.write_changed(|_| (), &report)?,
        };
        let failure = if outputs.file().is_some() { None } else { found.alarm() };
        Ok(Done { failure, ..Done::new(report.text(outputs), document) })
    }
}
