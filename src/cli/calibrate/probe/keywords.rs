//! The flags of `calibrate probe` as keywords of a program, and the calibration by them.

use clap::Parser;

use super::{Arguments, Wires};
use crate::app::calibrate::guide::{Advice, Advisor};
use crate::app::calibrate::probe::{Lag, Made, MethodFile};
use crate::app::json::document;
use crate::cli::reconstruct::keywords::parse_as;
use crate::failure::Failure;
use pipeline::session::SessionStatus;

#[derive(Debug, Parser)]
#[command(no_binary_name = true, disable_help_flag = true)]
struct Keywords {
    #[command(flatten)]
    arguments: Arguments,
}

/// Advises nobody.
struct Silent;

impl Advisor for Silent {
    fn say(&self, sentence: &str) {
        tracing::info!("{sentence}");
    }

    fn show(&mut self, _advice: &Advice, _status: &SessionStatus) {}

    fn end(&mut self, _last: &Advice) {}
}

/// Calibrates by a phantom's wires, and writes the requested files. Returns the report, as JSON.
///
/// # Errors
/// [`Failure`] when a keyword does not fit, or the recording does not determine the image plane;
/// nothing is written then.
pub(crate) fn calibrate(keywords: &[(String, String)]) -> Result<String, Failure> {
    let Keywords { arguments } = parse_as(keywords)?;
    let options = &arguments.options;
    if options.live.is_some() {
        return Err(Failure("live: is for people at the bedside; use `sonoweave calibrate probe --live`".into()));
    }
    let (outputs, file) = arguments.checked()?;
    let MethodFile::Phantom(phantom) = file else {
        fail!("method {}: use `sonoweave calibrate probe`; nwire is the method here", options.method.name());
    };
    let wires = Wires::find(options, &outputs, phantom, &mut Silent, &|_, _| Box::new(|_| ()))?;
    let Wires { report, made, .. } = &wires;
    let latency = report.latency.as_ref().and_then(Lag::latency);
    outputs.write_probe(options.result(Made { latency, ..made.clone() })?, report, || wires.page())?;
    document(report)
}
