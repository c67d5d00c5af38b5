//! `sonoweave calibrate probe`: where the picture lies in the frame of the sensor on the transducer.

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

use calibration::file::date::Date;
use calibration::file::preset::{Covariance, Preset, Quality, Ruler};
use calibration::frames::{Image, Probe, Transform};
use calibration::phantom::file::Registration;
use calibration::probe::errors::Errors;
use calibration::probe::next;
use calibration::probe::refine::PLANE;
use calibration::probe::{Calibration, Layout, Observation, Recording, calibrate};
use calibration::region::ClipRect;
use clap::{ArgGroup, Args, ValueEnum};

use super::super::live::outputs::say;
use super::super::{Failure, values};
use super::guide::Gathering;
use super::outputs::{Input, Outputs, print};
use super::recorded::Recorded;
use crate::config::Settings as Config;
use crate::config::phantom::PhantomSettings;
use again::again;
use lag::Lag;
use recording::{Observed, observe, pictures};
use report::{Report, text};

/// How a probe is calibrated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Method {
    /// By a phantom of N-wires
    Nwire,
    /// By a point that rests, e.g. where two wires cross
    Point,
    /// By a plane that rests: the floor of a water tank, or a membrane
    Plane,
    /// By the tip of a tracked stylus, held into the picture
    Stylus,
}

impl Method {
    /// As the command line has it.
    fn name(self) -> &'static str {
        match self {
            Self::Nwire => "nwire",
            Self::Point => "point",
            Self::Plane => "plane",
            Self::Stylus => "stylus",
        }
    }

    /// By what it is.
    fn title(self) -> &'static str {
        match self {
            Self::Nwire => "N-wire phantom",
            Self::Point => "a point that rests",
            Self::Plane => "a plane that rests",
            Self::Stylus => "a stylus's tip",
        }
    }
}

/// Flags of `calibrate probe`.
#[derive(Debug, Args)]
#[command(
    group(ArgGroup::new("from").required(true).args(["sequence", "session", "live"])),
    after_help = "\
The result is the transform ImageToProbe, and how much later the tracker's poses come than pictures. A second scan tells how good it is; without one the last third of the first does. Move slowly, for half a minute.

nwire: scan the phantom's wires along and back, and tilt and turn the probe on the way.
point: keep the point (wires that cross in water, a bead) in the picture. Bring it to all parts of the picture, left and right, near and far, and tilt the probe fore and aft and from side to side and turn it about \
its long axis, each by 20° and more.
stylus: hold the tip of a tracked stylus into the picture, so that it shows as a dot, and bring it to all parts of the picture. Where the tip is on it tells `calibrate pivot`.
plane: hold the probe above the floor of a water tank so that it shows as a line. Raise and lower it, tilt it fore and aft and from side to side, by 15° and more. A line tells less than a point.

Pictures that are mirrored only an N-wire phantom can tell: by the other methods the result holds for pictures that are mirrored alike.

Examples: sonoweave calibrate probe --phantom phantom.toml --live bedside.toml -o calibration.toml
          sonoweave calibrate probe --phantom phantom.toml --session SESSION-20261121-213000.mcap -o calibration.toml --report probe.html
          sonoweave calibrate probe --phantom phantom.toml --sequence scan.igs.mha --validate second.igs.mha -o calibration.toml
          sonoweave calibrate probe --method point --sequence crossing.igs.mha -o calibration.toml --report probe.json
          sonoweave calibrate probe --method stylus --stylus-tip calibration.toml --sequence tip.igs.mha -o calibration.toml"
)]
pub struct Arguments {
    /// The phantom with its wires, of --method nwire: our file (TOML) or a PLUS XML
    #[arg(long, value_name = "FILE")]
    phantom: Option<PathBuf>,
    /// The recording: a tracked sequence with pictures (.mha, .mhd, .nrrd, .nhdr)
    #[arg(long, value_name = "SEQUENCE")]
    sequence: Option<PathBuf>,
    /// The recording: a session that `live --record` wrote (.mcap). The latencies that it had do not count
    #[arg(long, value_name = "SESSION")]
    session: Option<PathBuf>,
    /// A bedside's configuration: records its devices now, says what to do, and ends when there is enough
    #[arg(long, value_name = "BEDSIDE.toml")]
    live: Option<PathBuf>,
    #[command(flatten)]
    gathering: Gathering,
    /// With --live: it is enough when points are known to this, mm (one standard deviation at the worst corner)
    #[arg(long, value_name = "MM", default_value_t = 0.3, value_parser = values::positive)]
    goal: f64,
    /// A second recording, a sequence or a session, to tell how good the result is; it has no part in it
    #[arg(long, value_name = "SEQUENCE|SESSION")]
    validate: Option<PathBuf>,
    /// Where the phantom is held: a calibration file (TOML) or a PLUS XML with PhantomToReference [default: the phantom's file]
    #[arg(long, value_name = "FILE")]
    registration: Option<PathBuf>,
    /// How the probe is calibrated
    #[arg(long, value_enum, default_value_t = Method::Nwire)]
    method: Method,
    #[command(flatten)]
    target: target::Flags,
    /// Part of the picture that is looked at: X,Y,W,H in pixels [default: as the phantom's file says, else the session's configuration, else all of it]
    #[arg(long, value_name = "X,Y,W,H", value_parser = values::rectangle)]
    clip: Option<ClipRect>,
    /// Refuse a result whose error on the second recording (mean, mm; of N-wires by PLUS's definition) is larger
    #[arg(long, value_name = "MM", default_value_t = 2.0, value_parser = values::positive)]
    limit: f64,
    /// Put the result into the calibration file as a preset of that name, for the depth at which the scanner is set, beside others [default: as the file's only one]
    #[arg(long, value_name = "NAME", requires = "output")]
    preset: Option<String>,
    /// A length along the ruler beside the picture, in pixels and in mm: the preset is refused later where the scanner is set to another depth
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
/// [`Failure`] when the recording does not say where the picture lies; nothing is written then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { phantom, validate, registration, method, clip, limit, outputs, target, .. } = arguments;
    if *method != Method::Nwire {
        return target::run(arguments);
    }
    if let Some(flag) = target.given() {
        return Err(Failure(format!(
            "{flag}: --method nwire has no use for it; leave it out, or choose another --method"
        )));
    }
    let Some(phantom) = phantom else {
        return Err(Failure(
            "--method nwire has to know the phantom's wires: name their file with --phantom, or choose another --method".into(),
        ));
    };
    let path = arguments.path();
    // The registration's file may be the one that is written: it keeps what it holds.
    let mut inputs = vec![path, phantom];
    inputs.extend(validate.as_deref());
    outputs.check(&inputs, true)?;
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
        return Err(within(path, "its pictures are not of the size of the second recording's".into()));
    }
    let looked_s = began.elapsed().as_secs_f64();
    let also =
        seen.first_refusal.as_ref().map_or(String::new(), |why| format!(" (the first that could not be used: {why})"));
    let found = calibrate(&layout, &held, seen.recording(), second.as_ref().map(Observed::recording))
        .map_err(|e| within(path, format!("{e}{also}")))?;
    if let Some([errors, _]) = &found.validation
        && errors.mean > *limit
    {
        return Err(within(
            path,
            format!(
                "the result is {:.2} mm off on pictures that had no part in it, more than --limit {limit} mm; was the phantom moved after it was registered, or is the tracker disturbed by metal?",
                errors.mean
            ),
        ));
    }
    let input = Input::of(path)?;
    let provenance =
        format!("N-wire phantom, {} pictures of {}, {:.2} mm", found.used(), input.name(), found.errors[0].mean);
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

/// What a preset holds of a calibration.
struct Made {
    probe_from_image: Transform<Probe, Image>,
    size_px: [u32; 2],
    quality: Quality,
    covariance: [[f64; PLANE.len()]; PLANE.len()],
    inputs: Vec<calibration::file::preset::Input>,
}

impl Arguments {
    /// The preset that is asked for.
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

    /// The latencies by a lag and its standard deviation, s; `None` where none was sought, which has no deviation.
    fn lag(&self, recorded: &Recorded, [lag_s, sd_s]: [f64; 2]) -> Result<Option<Lag>, Failure> {
        let video_ms = recorded.bedside().map_or(0.0, |bedside| bedside.grabber.latency_ns as f64 * 1e-6);
        let known = || self.outputs.before();
        (sd_s > 0.0).then(|| Ok(Lag::new([lag_s, sd_s], video_ms, known()?.latency.as_ref()))).transpose()
    }

    /// The recording's file.
    fn path(&self) -> &Path {
        // One of them is there: the command line sees to it.
        let some = [&self.sequence, &self.session, &self.live].into_iter().flatten().next();
        some.map_or(Path::new(""), PathBuf::as_path)
    }

    /// The second recording.
    fn second(&self, first: &Recorded) -> Result<Option<Recorded>, Failure> {
        let second = self.validate.as_ref().map(|path| Recorded::of(path)).transpose()?;
        if second.as_ref().is_some_and(|second| second.bedside().is_some() != first.bedside().is_some()) {
            say(
                "note: one of the recordings is a sequence and the other a session: how late poses come is found in the first, and may be another in the second, whose errors are then too large",
            );
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

/// How good it is, in the numbers that a preset keeps.
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

/// Where a file says that the phantom is held.
fn registered(path: &Path, phantom: &PhantomSettings) -> Result<Registration, Failure> {
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
