//! A probe's calibration by a point, a stylus or a plane.

mod detector;
mod flags;
mod guide;
mod observe;
mod page;
mod report;

use std::path::Path;
use std::time::Instant;

use calibration::error::{CalibrationError, ProbeError};
use calibration::file::record::Quality;
use calibration::probe::target::refine::Scatter;
use calibration::probe::target::{Calibration, Seen, Target, calibrate};
use calibration::probe::{Observation, Recording};
use calibration::tracker::noise::TrackerNoise;

use super::super::super::Failure;
use super::super::outputs::{Input, print};
use super::super::tip::tip;
use super::arguments::{Arguments, Made, Method};
use super::lag::Lag;
use super::recording::{Observed, pictures};
use super::reproducibility::reproducibility;

pub(super) use flags::Flags;
use observe::{Names, observe};
use report::{Inputs, Report, ends, text};

/// Runs the command by one of these methods.
///
/// # Errors
/// [`Failure`] when the recording does not determine the image plane; nothing is written then.
pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { method, target: flags, validate, clip, limit, outputs, .. } = arguments;
    let path = arguments.path();
    let tip_file = arguments.checked()?;
    // The tip's file may be the output file: its other contents are kept.
    let mut inputs: Vec<&Path> = vec![path];
    inputs.extend(validate.as_deref());
    outputs.check(&inputs, true)?;
    let target = match (method, tip_file) {
        (Method::Plane, _) => Target::Plane,
        (_, Some(file)) => Target::Tip { place_mm: tip(file, &flags.stylus, true)?, error_mm: flags.tip_error },
        _ => Target::Point,
    };
    let reference = if tip_file.is_some() { Some(flags.stylus.as_str()) } else { flags.reference.as_deref() };
    let began = Instant::now();
    let names = Names { probe: "Probe", reference };
    let is_plane = target == Target::Plane;
    let made = arguments
        .gathering
        .of(arguments.live.as_ref())?
        .map(|path| guide::gathered(path, arguments, target, names))
        .transpose()?;
    let recorded = arguments.recorded(made.as_deref())?;
    let path = recorded.path();
    let within = |problem: String| Failure(format!("{}: {problem}", path.display()));
    let (seen, reference) = observe(&recorded, names, *clip, is_plane)?;
    let second = arguments.second(&recorded)?.map(|second| observe(&second, names, *clip, is_plane)).transpose()?;
    let second = second.map(|(second, _)| second);
    if second.as_ref().is_some_and(|second| second.size_px != seen.size_px) {
        return Err(within("its frames differ in size from the second recording's".into()));
    }
    let searched_s = began.elapsed().as_secs_f64();
    let found = calibrate(target, seen.recording(), second.as_ref().map(Observed::recording)).map_err(|e| {
        let disagree = matches!(e, CalibrationError::Probe(ProbeError::Disagree { .. }));
        let clip = if disagree { "; --clip limits the search to a part of the image" } else { "" };
        within(format!("{e}{clip}{}", seen.also()))
    })?;
    if let Some(errors) = &found.validation
        && errors.mean > *limit
    {
        return Err(within(format!(
            "the result is {:.2} mm off on validation frames, more than --limit {limit} mm; keep the target at rest, and metal away from the tracker",
            errors.mean
        )));
    }
    let solved_s = began.elapsed().as_secs_f64() - searched_s;
    let inputs = Inputs {
        input: Input::of(path)?,
        stylus_tip: tip_file.map(Input::of).transpose()?,
        validation: validate.as_deref().map(Input::of).transpose()?,
    };
    let provenance =
        format!("{}, {} frames of {}, {:.2} mm", method.title(), found.used(), inputs.input.name(), found.errors.mean);
    let origin = outputs.origin(inputs.all());
    let text = text(&found, *method, &reference);
    let without = |observations: &[Observation<Seen>]| {
        let recording = Recording { observations, ..seen.recording() };
        Some(calibrate(target, recording, None).ok()?.refined.plane)
    };
    let reproducibility = outputs
        .wants_report()
        .then(|| reproducibility(seen.recording().observations, found.size_px, &found.refined.plane, without));
    let report = Report::new(&found, inputs, *method, reference, *limit)
        .with_times(searched_s, solved_s)
        .with_reproducibility(reproducibility.flatten());
    let lag = arguments.lag(&recorded, [found.refined.lag_s, found.refined.lag_se_s])?;
    let latency = lag.as_ref().and_then(Lag::latency);
    let result = arguments.result(Made {
        probe_from_image: found.refined.probe_from_image(),
        provenance,
        size_px: found.size_px,
        quality: quality(&found),
        covariance: found.refined.covariance(),
        origin,
        latency,
    })?;
    let of_lag = lag.as_ref().filter(|_| outputs.wants_file()).map_or(String::new(), Lag::text);
    let page = || Ok(report.page(&pictures(&recorded, &report.listed_frames())?));
    outputs.write_probe(result, &report, page)?;
    print(&(text + &of_lag + &outputs.summary()))
}

impl Arguments {
    /// Checks the flags before the work. Returns the file of the stylus's tip, if the method
    /// needs it.
    fn checked(&self) -> Result<Option<&Path>, Failure> {
        let Self { method, phantom, registration, target: Flags { stylus_tip, reference, .. }, .. } = self;
        let name = method.name();
        for (flag, is_given) in [("--phantom", phantom.is_some()), ("--registration", registration.is_some())] {
            if is_given {
                return Err(Failure(format!(
                    "{flag}: has no effect with --method {name}, which finds the target's position itself; leave it out"
                )));
            }
        }
        match (method, stylus_tip) {
            (Method::Stylus, None) => Err(Failure(
                "--method stylus needs the position of the stylus's tip; give its file with --stylus-tip, or find it with `calibrate pivot`".into(),
            )),
            (Method::Stylus, Some(_)) if reference.is_some() => Err(Failure(
                "--reference: has no effect with --method stylus, whose poses are in the frame that --stylus names; leave it out".into(),
            )),
            (Method::Stylus, Some(file)) => Ok(Some(file)),
            (_, Some(_)) => Err(Failure(format!("--stylus-tip: has no effect with --method {name}; leave it out"))),
            (_, None) => Ok(None),
        }
    }
}

/// Returns the quality numbers that the file keeps.
fn quality(found: &Calibration) -> Quality {
    let [centre_mm, corner_mm] = ends(found);
    let (position_mm, turn_rad) = match found.refined.scatter {
        // The scatter along u and v contains that of the dot: the sensors have the smaller at most.
        Scatter::Point { turn_rad, along_mm: [u, v, _] } => (u.min(v), turn_rad),
        Scatter::Plane { turn_rad, position_mm, .. } => (position_mm, turn_rad),
    };
    Quality {
        frames: u32::try_from(found.used()).unwrap_or(u32::MAX),
        error_mm: [found.errors.mean, found.errors.sd],
        validation_error_mm: found.validation.as_ref().map(|errors| [errors.mean, errors.sd]),
        centre_mm,
        corner_mm,
        sensors: Some(TrackerNoise { position_mm, rotation_deg: turn_rad.to_degrees() }),
    }
}
