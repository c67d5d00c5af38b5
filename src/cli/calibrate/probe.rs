//! `sonoweave calibrate probe`: finds the transform from the image to the sensor on the
//! transducer.

mod page;
mod page_parts;
mod report;
mod shared;
mod target;

use std::path::{Path, PathBuf};

use clap::{ArgGroup, Args};

use super::super::Failure;
use super::done::{Calibrate, Done, Outlets};
use crate::app::calibrate::outputs::Outputs;
use crate::app::calibrate::probe::quality::quality;
use crate::app::calibrate::probe::{Found, Lag, Made, MethodFile, Options, pictures};
use report::{Report, text};
use shared::{Inputs, write};

/// Flags of `calibrate probe`.
#[derive(Debug, Args)]
#[command(
    group(ArgGroup::new("from").required(true).args(["sequence", "session", "live"])),
    after_long_help = "\
The result is the transform ImageToProbe, and the lag of the tracker's poses behind the frames. A second scan \
validates the result; without one, the last third of the first scan does. Move slowly, for half a minute.

nwire: scan the phantom's wires along and back, and tilt and turn the probe on the way.
point: keep the point (wires that cross in water, a bead) in the picture. Bring it to all parts of the picture, left \
and right, near and far. Tilt the probe fore and aft and from side to side, and turn it about its long axis, each by \
20° or more.
stylus: hold the tip of a tracked stylus into the image plane as a dot, and move it to all parts of the image. \
`calibrate pivot` measures the position of the tip.
plane: hold the probe above the floor of a water tank so that it shows as a line. Raise and lower it, tilt it fore \
and aft and from side to side, by 15° or more. A line gives less information than a point.

Only an N-wire phantom detects mirrored frames; the other methods do not notice them.

Examples: sonoweave calibrate probe --phantom phantom.toml --live bedside.toml -o calibration.toml
          sonoweave calibrate probe --phantom phantom.toml --session SESSION-20261121-213000.mcap -o \
calibration.toml --report probe.html
          sonoweave calibrate probe --phantom phantom.toml --sequence scan.igs.mha --validate second.igs.mha -o \
calibration.toml
          sonoweave calibrate probe --method point --sequence crossing.igs.mha -o calibration.toml --json=probe.json
          sonoweave calibrate probe --method stylus --stylus-tip calibration.toml --sequence tip.igs.mha -o \
calibration.toml"
)]
pub struct Arguments {
    #[command(flatten)]
    options: Options,
    #[command(flatten)]
    outputs: Outputs,
    /// Write the report as a page for a browser (.html)
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
}

impl Arguments {
    /// Returns the outputs and the file of the method. Checks them before the work.
    ///
    /// # Errors
    /// [`Failure`] when flags contradict each other or files are out of reach.
    fn checked(&self) -> Result<(Outputs, MethodFile<'_>), Failure> {
        let Self { options, report, outputs } = self;
        let mut outputs = outputs.clone();
        outputs.page.clone_from(report);
        let file = options.checked()?;
        // The files of the tip and of the registration may be the output file, whose other contents
        // are kept.
        let inputs = [Some(options.path()), options.phantom.as_deref(), options.validate.as_deref()];
        outputs.check(&inputs.into_iter().flatten().collect::<Vec<_>>())?;
        Ok((outputs, file))
    }
}

impl Calibrate for Arguments {
    fn calibrate(&self, outlets: Outlets<'_>) -> Result<Done, Failure> {
        let options = &self.options;
        let (outputs, file) = self.checked()?;
        match file {
            MethodFile::Phantom(phantom) => by_wires(options, &outputs, phantom, outlets),
            MethodFile::Target(tip) => target::calibrate(options, &outputs, tip, outlets),
        }
    }
}

fn by_wires(options: &Options, outputs: &Outputs, phantom: &Path, outlets: Outlets<'_>) -> Result<Done, Failure> {
    let wants_report = outlets.wants_report || outputs.wants_report();
    let done = options.by_wires(phantom, outlets.advisor, outlets.steps)?;
    let Found { layout, recorded, found, .. } = &done;
    let refined = &found.refined;
    let reproducibility = wants_report.then(|| done.reproducibility()).flatten();
    let next = done.next_view();
    let inputs = Inputs::of(options, recorded.path())?;
    let mut report = Report::new(options, inputs, &done, reproducibility, next.as_ref());
    report.latency = Lag::of(outputs, recorded, [refined.lag_s, refined.lag_sd_s])?;
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
    let text = text(found, layout) + &next.as_ref().map_or(String::new(), report::next_line);
    write(options, outputs, made, report.latency.as_ref(), &report, page, text)
}
