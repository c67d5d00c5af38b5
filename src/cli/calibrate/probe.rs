//! `sonoweave calibrate probe`: finds the transform from the image to the sensor on the
//! transducer.

mod page;
mod page_parts;
mod report;
mod target;

use clap::{ArgGroup, Args};

use super::super::Failure;
use super::advice::AdviceDisplay;
use crate::app::calibrate::outputs::{Input, Outputs};
use crate::app::calibrate::probe::quality::quality;
use crate::app::calibrate::probe::{Found, Lag, Made, Method, Options, pictures};
use crate::cli::print::print;
use crate::cli::progress::steps;
use report::{Report, text};

/// Flags of `calibrate probe`.
#[derive(Debug, Args)]
#[command(
    group(ArgGroup::new("from").required(true).args(["sequence", "session", "live"])),
    after_help = "\
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
          sonoweave calibrate probe --method point --sequence crossing.igs.mha -o calibration.toml --report probe.json
          sonoweave calibrate probe --method stylus --stylus-tip calibration.toml --sequence tip.igs.mha -o \
calibration.toml"
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
/// [`Failure`] when the recording does not determine the image plane; nothing is written then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { options, outputs } = arguments;
    let Options { phantom, registration, validate, method, limit, target, .. } = options;
    if *method != Method::Nwire {
        return target::run(options, outputs);
    }
    if let Some(flag) = target.given() {
        fail!("{flag}: has no effect with --method nwire; leave it out, or choose another --method");
    }
    let Some(phantom) = phantom else {
        return Err(Failure(
            "--method nwire needs the phantom's wires: give --phantom, or choose another --method".into(),
        ));
    };
    let path = options.path();
    // The registration's file may be the output file: its other contents are kept.
    let mut inputs = vec![path, phantom];
    inputs.extend(validate.as_deref());
    outputs.check(&inputs, true)?;
    let done = options.by_wires(phantom, &mut AdviceDisplay::default(), &steps)?;
    let Found { layout, held, recorded, found, times_s: [searched_s, solved_s], .. } = &done;
    let path = recorded.path();
    let input = Input::of(path)?;
    let provenance =
        format!("N-wire phantom, {} frames of {}, {:.2} mm", found.used(), input.name(), found.errors[0].mean);
    let reproducibility = outputs.wants_report().then(|| done.reproducibility());
    let validation = validate.as_deref().map(Input::of).transpose()?;
    let phantom_input = Input::of(phantom)?;
    let registration = registration.as_deref().map(Input::of).transpose()?;
    let origin = outputs
        .origin([Some(&input), Some(&phantom_input), registration.as_ref(), validation.as_ref()].into_iter().flatten());
    let next = done.next_view();
    let lag = Lag::of(outputs, recorded, [found.refined.lag_s, found.refined.lag_sd_s])?;
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
    let report = Report::new(found, layout, input, phantom_input, validation, held)
        .with_times(*searched_s, *solved_s)
        .with_reproducibility(reproducibility.flatten())
        .with_next(next.as_ref())
        .with_lag(lag);
    let page = || Ok(report.page(&pictures(recorded, &report.listed_frames())?, *limit));
    outputs.write_probe(result, &report, page)?;
    let next = next.as_ref().map_or(String::new(), report::next_line);
    print(&(text(found, layout) + &next + &of_lag + &outputs.summary()))
}
