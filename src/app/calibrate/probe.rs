//! The transform from the image to the sensor on the transducer.

mod guide;
mod lag;
mod options;
pub(crate) mod quality;
mod recording;
mod reproducibility;
mod scan;
pub(crate) mod target;

use std::path::Path;
use std::time::Instant;

use calibration::phantom::file::Registration;
use calibration::probe::next::NextView;
use calibration::probe::{Calibration, Layout, Observation, Recording, calibrate, next};
use config::Settings as Config;
use config::phantom::PhantomSettings;
use sonoweave_core::frames::Transform;

use super::guide::Advisor;
use super::recorded::Recorded;
use crate::app::reporter::Steps;
use crate::failure::Failure;
pub(crate) use lag::Lag;
pub(crate) use options::{Made, Method, MethodFile, Options};
use recording::{Observed, observe};
pub(crate) use recording::{StoredImage, pictures};
pub(crate) use reproducibility::Reproducibility;
use reproducibility::reproducibility;

/// Largest distance of a phantom from its reference sensor, mm.
const MOST_MM: f64 = 10_000.0;

/// A calibration by an N-wire phantom, and what it is based on.
pub(crate) struct Found {
    pub(crate) layout: Layout,
    pub(crate) held: Registration,
    pub(crate) recorded: Recorded,
    seen: Observed,
    pub(crate) found: Calibration,
    /// Time to search the images, and to calibrate, s.
    pub(crate) times_s: [f64; 2],
}

impl Options {
    /// Calibrates by a phantom's wires. Records the scan first if it is still to be made.
    ///
    /// # Errors
    /// [`Failure`] when the recording does not determine the image plane.
    pub(crate) fn by_wires(
        &self,
        phantom: &Path,
        advisor: &mut dyn Advisor,
        steps: Steps<'_>,
    ) -> Result<Found, Failure> {
        let Self { registration, clip, limit, .. } = self;
        let settings = PhantomSettings::read(phantom)?;
        let held = match registration {
            Some(path) => registered(path, &settings)?,
            None => settings.registration.ok_or_else(|| {
                Failure::new(format!(
                    "{}: lacks the phantom's position ({}To{}); give its file with --registration, or measure it with \
                    `calibrate landmarks`",
                    phantom.display(),
                    settings.frames.phantom,
                    settings.frames.reference
                ))
            })?,
        };
        let within = |path: &Path, problem: String| Failure::new(format!("{}: {problem}", path.display()));
        let layout = Layout::new(settings.geometry.clone()).map_err(|e| within(phantom, e.to_string()))?;
        let clip = clip.or(settings.clip);
        let began = Instant::now();
        let observe = |recorded: &Recorded| observe(recorded, &layout, &settings.frames, clip, steps);
        let second = self.second(advisor)?;
        let made = self.gathering.of(self.live.as_ref())?;
        let made = made
            .map(|path| guide::gathered(path, self, advisor, &layout, &held, &settings.frames, clip))
            .transpose()?;
        let recorded = self.recorded(made.as_deref())?;
        let path = recorded.path();
        let seen = observe(&recorded)?;
        let second = second.map(|second| observe(&second)).transpose()?;
        if second.as_ref().is_some_and(|second| second.size_px != seen.size_px) {
            return Err(within(
                path,
                "its frames differ in size from the second recording's; give one of the same size".into(),
            ));
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
        let times_s = [searched_s, began.elapsed().as_secs_f64() - searched_s];
        Ok(Found { layout, held, recorded, seen, found, times_s })
    }
}

impl Found {
    /// Returns the view to scan next, if any.
    pub(crate) fn next_view(&self) -> Option<NextView> {
        let Self { layout, seen, found, .. } = self;
        found.next_view(layout, seen.recording(), next::pictures(found.used()))
    }

    /// Calibrates again without parts of the recording.
    pub(crate) fn reproducibility(&self) -> Option<Reproducibility> {
        let Self { layout, held, seen, found, .. } = self;
        let without = |observations: &[Observation]| {
            let recording = Recording { observations, ..seen.recording() };
            Some(calibrate(layout, held, recording, None).ok()?.refined.plane)
        };
        reproducibility(&seen.observations, found.size_px, &found.refined.plane, without)
    }
}

/// Reads the phantom's pose from a file.
fn registered(path: &Path, phantom: &PhantomSettings) -> Result<Registration, Failure> {
    let frames = &phantom.frames;
    let within = |problem: String| Failure::new(format!("{}: {problem}", path.display()));
    let known = Config::read(path, None)?.transforms;
    let between = |from: &str, to: &str| known.iter().find(|t| t.from == from && t.to == to).map(|t| t.affine);
    let back = || between(&frames.reference, &frames.phantom).map(|affine| affine.inverse());
    let found = between(&frames.phantom, &frames.reference).or_else(back);
    let affine = found.ok_or_else(|| {
        within(format!("holds no {}To{}; measure it with `calibrate landmarks`", frames.phantom, frames.reference))
    })?;
    let far_mm = affine.translation.length();
    if far_mm > MOST_MM {
        return Err(within(format!(
            "{}To{} is {far_mm:.0e} mm, more than {MOST_MM:.0}; check that its numbers are in mm",
            frames.phantom, frames.reference
        )));
    }
    Registration::new(Transform::from_affine(affine), None).map_err(|error| within(error.to_string()))
}
