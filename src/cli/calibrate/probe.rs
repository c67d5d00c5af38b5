//! `sonoweave calibrate probe`: finds the transform from the image to the sensor on the
//! transducer.

mod arguments;
mod guide;
mod lag;
mod page;
mod page_parts;
mod recording;
mod report;
mod reproducibility;
mod scan;
mod target;

use std::path::Path;
use std::time::Instant;

use calibration::file::record::Quality;
use calibration::phantom::file::Registration;
use calibration::probe::errors::Errors;
use calibration::probe::{Calibration, Layout, Observation, Recording, calibrate, next};
use calibration::tracker::noise::TrackerNoise;
use config::Settings as Config;
use config::phantom::PhantomSettings;
use sonoweave_core::frames::Transform;

use super::super::Failure;
use super::outputs::{Input, print};
use super::recorded::Recorded;
pub use arguments::Arguments;
use arguments::{Made, Method};
use lag::Lag;
use recording::{Observed, observe, pictures};
use report::{Report, text};
use reproducibility::reproducibility;

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
    let observe = |recorded: &Recorded| observe(recorded, &layout, &settings.frames, clip);
    let made = arguments.gathering.of(arguments.live.as_ref())?;
    let made = made.map(|path| guide::gathered(path, arguments, &layout, &held, &settings.frames, clip)).transpose()?;
    let recorded = arguments.recorded(made.as_deref())?;
    let path = recorded.path();
    let seen = observe(&recorded)?;
    let second = arguments.second(&recorded)?.map(|second| observe(&second)).transpose()?;
    if second.as_ref().is_some_and(|second| second.size_px != seen.size_px) {
        return Err(within(path, "its frames differ in size from the second recording's".into()));
    }
    let searched_s = began.elapsed().as_secs_f64();
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
    let solved_s = began.elapsed().as_secs_f64() - searched_s;
    let without = |observations: &[Observation]| {
        let recording = Recording { observations, ..seen.recording() };
        Some(calibrate(&layout, &held, recording, None).ok()?.refined.plane)
    };
    let reproducibility = outputs
        .wants_report()
        .then(|| reproducibility(&seen.observations, found.size_px, &found.refined.plane, without));
    let validation = validate.as_deref().map(Input::of).transpose()?;
    let phantom_input = Input::of(phantom)?;
    let registration = registration.as_deref().map(Input::of).transpose()?;
    let origin = outputs
        .origin([Some(&input), Some(&phantom_input), registration.as_ref(), validation.as_ref()].into_iter().flatten());
    let next = found.next_view(&layout, seen.recording(), next::pictures(found.used()));
    let lag = arguments.lag(&recorded, [found.refined.lag_s, found.refined.lag_sd_s])?;
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
    let report = Report::new(&found, &layout, input, phantom_input, validation, &held)
        .with_times(searched_s, solved_s)
        .with_reproducibility(reproducibility.flatten())
        .with_next(next.as_ref())
        .with_lag(lag);
    let page = || Ok(report.page(&pictures(&recorded, &report.listed_frames())?, *limit));
    outputs.write_probe(result, &report, page)?;
    let next = next.as_ref().map_or(String::new(), report::next_line);
    print(&(text(&found, &layout) + &next + &of_lag + &outputs.summary()))
}

/// Returns the quality numbers that the file keeps.
fn quality(found: &Calibration) -> Quality {
    let [centre_mm, corner_mm] = report::predicted_ends(found);
    let both = |errors: &Errors| [errors.mean, errors.sd];
    let scatter = found.refined.scatter;
    Quality {
        frames: u32::try_from(found.used()).unwrap_or(u32::MAX),
        error_mm: both(&found.errors[0]),
        validation_error_mm: found.validation.as_ref().map(|[middle, _]| both(middle)),
        centre_mm,
        corner_mm,
        sensors: Some(TrackerNoise { position_mm: scatter.position_mm, rotation_deg: scatter.turn_rad.to_degrees() }),
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
