//! `sonoweave calibrate probe`: finds the transform from the image to the sensor on the
//! transducer.

mod again;
mod drawn;
mod guide;
mod lag;
mod page;
mod recording;
mod report;
mod target;

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{ArgGroup, Args, ValueEnum};

use calibration::file::preset::{Covariance, Preset, Quality, Ruler};
use calibration::phantom::file::Registration;
use calibration::probe::errors::Errors;
use calibration::probe::refine::PLANE;
use calibration::probe::{Calibration, Layout, Observation, Recording, calibrate, next};
use config::Settings as Config;
use config::phantom::PhantomSettings;
use sonoweave_core::date::Date;
use sonoweave_core::frames::{Image, Probe, Transform};
use sonoweave_core::region::ClipRect;

use super::super::live::outputs::say;
use super::super::{Failure, values};
use super::guide::Gathering;
use super::outputs::{Input, Outputs, print};
use super::recorded::Recorded;
use again::again;
use lag::Lag;
use recording::{Observed, observe, pictures};
use report::{Report, text};

/// Method of the probe's calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Method {
    /// By a phantom of N-wires
    Nwire,
    /// By a fixed point, e.g. where two wires cross
    Point,
    /// By a fixed plane: the floor of a water tank, or a membrane
    Plane,
    /// By the tip of a tracked stylus, held into the image
    Stylus,
}

impl Method {
    /// Returns the name on the command line.
    fn name(self) -> &'static str {
        match self {
            Self::Nwire => "nwire",
            Self::Point => "point",
            Self::Plane => "plane",
            Self::Stylus => "stylus",
        }
    }

    /// Returns the name of the target.
    fn title(self) -> &'static str {
        match self {
            Self::Nwire => "N-wire phantom",
            Self::Point => "a point at rest",
            Self::Plane => "a plane at rest",
            Self::Stylus => "a stylus's tip",
        }
    }
}

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
    /// Phantom with its wires, for --method nwire: our file (TOML) or a PLUS XML
    #[arg(long, value_name = "FILE")]
    phantom: Option<PathBuf>,
    /// Recording: a tracked sequence with images (.mha, .mhd, .nrrd, .nhdr)
    #[arg(long, value_name = "SEQUENCE")]
    sequence: Option<PathBuf>,
    /// Recording: a session that `live --record` wrote (.mcap). Its own latencies are ignored
    #[arg(long, value_name = "SESSION")]
    session: Option<PathBuf>,
    /// Session configuration: record its devices now, show instructions, and end when there is
    /// enough
    #[arg(long, value_name = "BEDSIDE.toml")]
    live: Option<PathBuf>,
    #[command(flatten)]
    gathering: Gathering,
    /// Goal for --live: end when points are known to this, mm (one standard deviation at the
    /// worst corner)
    #[arg(long, value_name = "MM", default_value_t = 0.3, value_parser = values::positive)]
    goal: f64,
    /// Validate the result on a second recording, a sequence or a session, which has no part in
    /// it
    #[arg(long, value_name = "SEQUENCE|SESSION")]
    validate: Option<PathBuf>,
    /// Pose of the phantom: a calibration file (TOML) or a PLUS XML with PhantomToReference
    /// [default: the phantom's file]
    #[arg(long, value_name = "FILE")]
    registration: Option<PathBuf>,
    /// Method of the probe's calibration
    #[arg(long, value_enum, default_value_t = Method::Nwire)]
    method: Method,
    #[command(flatten)]
    target: target::Flags,
    /// Search only this part of the image: X,Y,W,H in pixels [default: the phantom file's, else
    /// the session configuration's, else the whole image]
    #[arg(long, value_name = "X,Y,W,H", value_parser = values::rectangle)]
    clip: Option<ClipRect>,
    /// Refuse a result whose error on the second recording (mean, mm; of N-wires by PLUS's
    /// definition) is larger
    #[arg(long, value_name = "MM", default_value_t = 2.0, value_parser = values::positive)]
    limit: f64,
    /// Put the result into the calibration file as a preset of that name, for the scanner's
    /// present depth, beside others [default: as the file's only one]
    #[arg(long, value_name = "NAME", requires = "output")]
    preset: Option<String>,
    /// Length along the ruler beside the image, in pixels and in mm: the preset is refused later
    /// if the scanner is set to another depth
    #[arg(long, value_name = "PX,MM", value_parser = ruler, requires = "preset")]
    ruler: Option<Ruler>,
    #[command(flatten)]
    outputs: Outputs,
}

fn ruler(text: &str) -> Result<Ruler, String> {
    let numbers = text.split_once(',').and_then(|(px, mm)| Some((px.trim().parse().ok()?, mm.trim().parse().ok()?)));
    numbers.and_then(|(px, mm)| Ruler::new(px, mm)).ok_or_else(|| "must be two lengths above 0: pixels,mm".into())
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the recording does not determine the image plane; nothing is written then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { phantom, validate, registration, method, clip, limit, outputs, target, .. } = arguments;
    if *method != Method::Nwire {
        return target::run(arguments);
    }
    if let Some(flag) = target.given() {
        return Err(Failure(format!(
            "{flag}: has no effect with --method nwire; leave it out, or choose another --method"
        )));
    }
    let Some(phantom) = phantom else {
        return Err(Failure(
            "--method nwire needs the phantom's wires: give --phantom, or choose another --method".into(),
        ));
    };
    let path = arguments.path();
    // The registration's file may be the output file: its other contents are kept.
    let mut inputs = vec![path, phantom];
    inputs.extend(validate.as_deref());
    outputs.check(&inputs, true)?;
    let settings = PhantomSettings::read(phantom)?;
    let held = match registration {
        Some(path) => registered(path, &settings)?,
        None => settings.registration.ok_or_else(|| {
            Failure(format!(
                "{}: lacks the phantom's position ({}To{}); give its file with --registration, or measure it with \
                `calibrate landmarks`",
                phantom.display(),
                settings.frames.phantom,
                settings.frames.reference
            ))
        })?,
    };
    let within = |path: &Path, problem: String| Failure(format!("{}: {problem}", path.display()));
    let layout = Layout::new(settings.geometry.clone()).map_err(|e| within(phantom, e.to_string()))?;
    let clip = clip.or(settings.clip);
    let began = Instant::now();
    let look = |recorded: &Recorded| observe(recorded, &layout, &settings.frames, clip);
    let made = arguments.gathering.of(arguments.live.as_ref())?;
    let made = made.map(|path| guide::gathered(path, arguments, &layout, &held, &settings.frames, clip)).transpose()?;
    let recorded = arguments.recorded(made.as_deref())?;
    let path = recorded.path();
    let seen = look(&recorded)?;
    let second = arguments.second(&recorded)?.map(|second| look(&second)).transpose()?;
    if second.as_ref().is_some_and(|second| second.size_px != seen.size_px) {
        return Err(within(path, "its frames differ in size from the second recording's".into()));
    }
    let looked_s = began.elapsed().as_secs_f64();
    let found = calibrate(&layout, &held, seen.recording(), second.as_ref().map(Observed::recording))
        .map_err(|e| within(path, format!("{e}{}", seen.also())))?;
    if let Some([errors, _]) = &found.validation
        && errors.mean > *limit
    {
        return Err(within(
            path,
            format!(
                "the result is {:.2} mm off on validation frames, more than --limit {limit} mm; check that the phantom \
                was not moved after its registration, and that no metal is near the tracker",
                errors.mean
            ),
        ));
    }
    let input = Input::of(path)?;
    let provenance =
        format!("N-wire phantom, {} frames of {}, {:.2} mm", found.used(), input.name(), found.errors[0].mean);
    let solved_s = began.elapsed().as_secs_f64() - looked_s;
    let without = |observations: &[Observation]| {
        let recording = Recording { observations, ..seen.recording() };
        Some(calibrate(&layout, &held, recording, None).ok()?.refined.plane)
    };
    let again = outputs.wants_report().then(|| again(&seen.observations, found.size_px, &found.refined.plane, without));
    let validation = validate.as_deref().map(Input::of).transpose()?;
    let phantom_input = Input::of(phantom)?;
    let preset = arguments.preset(Made {
        probe_from_image: found.refined.probe_from_image(),
        size_px: found.size_px,
        quality: quality(&found),
        covariance: found.refined.covariance(),
        inputs: [Some(&input), Some(&phantom_input), validation.as_ref()]
            .into_iter()
            .flatten()
            .map(Input::listed)
            .collect(),
    });
    let next = found.next_view(&layout, seen.recording(), next::pictures(found.used()));
    let lag = arguments.lag(&recorded, [found.refined.lag_s, found.refined.lag_sd_s])?;
    let latency = lag.as_ref().and_then(Lag::latency);
    let of_lag = lag.as_ref().filter(|_| outputs.wants_file()).map_or(String::new(), Lag::text);
    let report = Report::new(&found, &layout, input, phantom_input, validation, &held)
        .took(looked_s, solved_s)
        .again(again.flatten())
        .next(next.as_ref())
        .with_lag(lag);
    let page = || Ok(report.page(&pictures(&recorded, &report.telling())?, *limit));
    outputs.write_probe(&found.refined.probe_from_image(), &provenance, preset, latency, &report, page)?;
    let next = next.as_ref().map_or(String::new(), report::next_line);
    print(&(text(&found, &layout) + &next + &of_lag + &outputs.told()))
}

/// A calibration, as a preset keeps it.
struct Made {
    probe_from_image: Transform<Probe, Image>,
    size_px: [u32; 2],
    quality: Quality,
    covariance: [[f64; PLANE.len()]; PLANE.len()],
    inputs: Vec<calibration::file::preset::Input>,
}

impl Arguments {
    /// Returns the preset, if one was requested.
    fn preset(&self, made: Made) -> Option<Preset> {
        let Made { probe_from_image, size_px, quality, covariance, inputs } = made;
        self.preset.as_ref().map(|name| Preset {
            name: name.clone(),
            probe_from_image,
            made: Some(Date::today()),
            picture_px: Some(size_px),
            ruler: self.ruler,
            clip: None,
            fan: None,
            quality: Some(quality),
            covariance: Some(Covariance {
                parameters: PLANE.map(str::to_owned).to_vec(),
                rows: covariance.iter().map(|row| row.to_vec()).collect(),
            }),
            inputs,
        })
    }

    /// Returns the latencies for a lag and its standard deviation, s; `None` if no lag was
    /// sought (deviation 0).
    fn lag(&self, recorded: &Recorded, [lag_s, sd_s]: [f64; 2]) -> Result<Option<Lag>, Failure> {
        let video_ms = recorded.bedside().map_or(0.0, |bedside| bedside.grabber.latency_ns as f64 * 1e-6);
        let known = || self.outputs.before();
        (sd_s > 0.0).then(|| Ok(Lag::new([lag_s, sd_s], video_ms, known()?.latency.as_ref()))).transpose()
    }

    /// Returns the recording's file.
    fn path(&self) -> &Path {
        // The command line guarantees that one of them is present.
        let some = [&self.sequence, &self.session, &self.live].into_iter().flatten().next();
        some.map_or(Path::new(""), PathBuf::as_path)
    }

    /// Returns the second recording.
    fn second(&self, first: &Recorded) -> Result<Option<Recorded>, Failure> {
        let second = self.validate.as_ref().map(|path| Recorded::of(path)).transpose()?;
        if second.as_ref().is_some_and(|second| second.bedside().is_some() != first.bedside().is_some()) {
            say("note: one recording is a sequence and the other a session; if their lags differ, the second one's \
                errors are too large");
        }
        Ok(second)
    }

    fn recorded(&self, made: Option<&Path>) -> Result<Recorded, Failure> {
        match made.or(self.session.as_deref()) {
            Some(path) => Recorded::session(path),
            None => Ok(Recorded::Sequence(self.path().to_owned())),
        }
    }
}

/// Returns the quality numbers that a preset keeps.
fn quality(found: &Calibration) -> Quality {
    let [centre_mm, corner_mm] = report::predicted_ends(found);
    let both = |errors: &Errors| [errors.mean, errors.sd];
    Quality {
        frames: u32::try_from(found.used()).unwrap_or(u32::MAX),
        error_mm: both(&found.errors[0]),
        validation_error_mm: found.validation.as_ref().map(|[middle, _]| both(middle)),
        centre_mm,
        corner_mm,
    }
}

/// Reads the phantom's pose from a file.
fn registered(path: &Path, phantom: &PhantomSettings) -> Result<Registration, Failure> {
    let frames = &phantom.frames;
    let within = |problem: String| Failure(format!("{}: {problem}", path.display()));
    let known = Config::read(path, None)?.transforms;
    let between = |from: &str, to: &str| known.iter().find(|t| t.from == from && t.to == to).map(|t| t.affine);
    let back = || between(&frames.reference, &frames.phantom).map(|affine| affine.inverse());
    let found = between(&frames.phantom, &frames.reference).or_else(back);
    let affine = found.ok_or_else(|| {
        within(format!("holds no {}To{}; measure it with `calibrate landmarks`", frames.phantom, frames.reference))
    })?;
    Registration::new(Transform::from_affine(affine), None).map_err(|error| within(error.to_string()))
}
