//! `sonoweave calibrate probe`: where the picture lies in the frame of the sensor on the transducer.

mod recording;
mod report;

use std::path::PathBuf;
use std::time::Instant;

use calibration::phantom::file::Registration;
use calibration::probe::{Layout, calibrate};
use calibration::region::ClipRect;
use clap::{Args, ValueEnum};

use super::super::{Failure, values};
use super::outputs::{Input, Outputs, print};
use crate::config::Settings as Config;
use crate::config::phantom::PhantomSettings;
use crate::mask::Clip;
use recording::{Observed, observe};
use report::{Report, text};

/// How a probe is calibrated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Method {
    /// By a phantom of N-wires
    Nwire,
}

/// Flags of `calibrate probe`.
#[derive(Debug, Args)]
#[command(after_help = "\
Scan the phantom's wires slowly for a quarter of a minute: along them and back, and tilt and turn the probe on the way. A second scan tells how good the result is; without one the last third \
of the first does. The result is the transform ImageToProbe, and how much later the tracker's poses come than pictures.

Example: sonoweave calibrate probe --phantom phantom.toml --sequence scan.igs.mha --validate second.igs.mha -o calibration.toml --report probe.json")]
pub struct Arguments {
    /// The phantom with its wires: our file (TOML) or a PLUS XML
    #[arg(long, value_name = "FILE")]
    phantom: PathBuf,
    /// The recording: a tracked sequence with pictures (.igs.mha, .mha)
    #[arg(long, value_name = "SEQUENCE")]
    sequence: PathBuf,
    /// A second recording, to tell how good the result is; it has no part in it
    #[arg(long, value_name = "SEQUENCE")]
    validate: Option<PathBuf>,
    /// Where the phantom is held: a calibration file (TOML) or a PLUS XML with PhantomToReference [default: the phantom's file]
    #[arg(long, value_name = "FILE")]
    registration: Option<PathBuf>,
    /// How the probe is calibrated
    #[arg(long, value_enum, default_value_t = Method::Nwire)]
    method: Method,
    /// Part of the picture where wires are looked for: X,Y,W,H in pixels [default: as the phantom's file says, else all of it]
    #[arg(long, value_name = "X,Y,W,H", value_parser = clip)]
    clip: Option<ClipRect>,
    /// Refuse a result whose error on the second recording (mean, mm; PLUS's definition) is larger
    #[arg(long, value_name = "MM", default_value_t = 2.0, value_parser = values::positive)]
    limit: f64,
    #[command(flatten)]
    outputs: Outputs,
}

fn clip(text: &str) -> Result<ClipRect, String> {
    match text.parse::<Clip>().map_err(|e| e.to_string())? {
        Clip::Rect(rect) => Ok(rect),
        _ => Err("must be four whole numbers of pixels X,Y,W,H".into()),
    }
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the recording does not say where the picture lies; nothing is written then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { phantom, sequence, validate, registration, method: Method::Nwire, clip, limit, outputs } =
        arguments;
    // The registration's file may be the one that is written: it keeps what it holds.
    let mut inputs = vec![sequence.as_path(), phantom];
    inputs.extend(validate.as_deref());
    outputs.check(&inputs)?;
    let settings = PhantomSettings::read(phantom)?;
    let held = match registration {
        Some(path) => registered(path, &settings)?,
        None => settings.registration.ok_or_else(|| {
            Failure(format!(
                "{}: does not say where the phantom is held ({}To{}); name the file that does with --registration, or find it with `calibrate landmarks`",
                phantom.display(),
                settings.frames.phantom,
                settings.frames.reference
            ))
        })?,
    };
    let within = |path: &PathBuf, problem: String| Failure(format!("{}: {problem}", path.display()));
    let layout = Layout::new(settings.geometry.clone()).map_err(|e| within(phantom, e.to_string()))?;
    let clip = clip.or(settings.clip);
    let began = Instant::now();
    let seen = observe(sequence, &layout, &settings.frames, clip)?;
    let second = validate.as_ref().map(|path| observe(path, &layout, &settings.frames, clip)).transpose()?;
    if second.as_ref().is_some_and(|second| second.size_px != seen.size_px) {
        return Err(within(sequence, "its pictures are not of the size of the second recording's".into()));
    }
    let looked_s = began.elapsed().as_secs_f64();
    let also =
        seen.first_refusal.as_ref().map_or(String::new(), |why| format!(" (the first that could not be used: {why})"));
    let found = calibrate(&layout, &held, seen.recording(), second.as_ref().map(Observed::recording))
        .map_err(|e| within(sequence, format!("{e}{also}")))?;
    if let Some([errors, _]) = &found.validation
        && errors.mean > *limit
    {
        return Err(within(
            sequence,
            format!(
                "the result is {:.2} mm off on pictures that had no part in it, more than --limit {limit} mm; was the phantom moved after it was registered, or is the tracker disturbed by metal?",
                errors.mean
            ),
        ));
    }
    let input = Input::of(sequence)?;
    let provenance =
        format!("N-wire phantom, {} pictures of {}, {:.2} mm", found.used(), input.name(), found.errors[0].mean);
    let report = Report::new(
        &found,
        &layout,
        input,
        Input::of(phantom)?,
        validate.as_deref().map(Input::of).transpose()?,
        &held,
    )
    .took(looked_s, began.elapsed().as_secs_f64() - looked_s);
    outputs.write_probe(&found.refined.probe_from_image(), &provenance, &report)?;
    print(&(text(&found, &layout) + &outputs.told()))
}

/// Where a file says that the phantom is held.
fn registered(path: &std::path::Path, phantom: &PhantomSettings) -> Result<Registration, Failure> {
    let frames = &phantom.frames;
    let within = |problem: String| Failure(format!("{}: {problem}", path.display()));
    let known = Config::read(path, None)?.transforms;
    let between = |from: &str, to: &str| known.iter().find(|t| t.from == from && t.to == to).map(|t| t.affine);
    let back = || between(&frames.reference, &frames.phantom).map(|affine| affine.inverse());
    let found = between(&frames.phantom, &frames.reference).or_else(back);
    let affine = found.ok_or_else(|| {
        within(format!("holds no {}To{}; find it with `calibrate landmarks`", frames.phantom, frames.reference))
    })?;
    Registration::new(calibration::frames::Transform::from_affine(affine), None).map_err(within)
}
