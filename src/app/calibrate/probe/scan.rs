//! Images and poses of a scan that is being recorded.

use std::path::Path;

use calibration::probe::Observation;
use calibration::probe::track::Track;
use config::bedside::Bedside;
use pipeline::session::DeviceRole;
use sync::ingest::live::Live;

use super::super::guide::Advice;
use super::super::recorded::{GRABBER, GreyImage, Tracks, live_image};
use super::recording::number;
use crate::failure::{Failure, Reason};

/// The scan so far, with what was detected in each image.
pub(super) struct Scan<S> {
    pub(super) tracks: Tracks,
    /// Their poses are added later.
    pub(super) observations: Vec<Observation<S>>,
    /// Reason why the last image could not be used.
    trouble: Option<String>,
}

impl<S: Clone> Scan<S> {
    pub(super) fn new(devices: &[DeviceRole], bedside: &Bedside) -> Self {
        Self { tracks: Tracks::of_roles(devices, bedside), observations: Vec::new(), trouble: None }
    }

    /// Checks before the recording that the configured devices give the poses of a sensor relative
    /// to the reference.
    ///
    /// # Errors
    /// [`Failure`] with the frame that they lack.
    pub(super) fn check(&self, configuration: &Path, sensor: &str, reference: &str) -> Result<(), Failure> {
        let problem = |why| format!("{}: {why}; give its station under [tracker]", configuration.display());
        self.tracks.track(sensor, reference).map(|_| ()).map_err(|why| Failure::new(problem(why)))
    }

    /// Adds a sample of a device; `detect` searches an image.
    pub(super) fn add(&mut self, device: usize, live: Live, detect: impl FnOnce(&GreyImage<'_>) -> Result<S, Failure>) {
        let Live::Picture { picture, timed } = live else {
            if device != GRABBER {
                self.tracks.add(device, live);
            }
            return;
        };
        let observed = live_image(&picture, &timed).and_then(|image| {
            let seen = detect(&image)?;
            Ok(Observation { frame: number(image.frame), time_s: image.time_s(), seen, poses: None })
        });
        match observed {
            Ok(observation) => self.observations.push(observation),
            Err(Failure(Reason { sentence: why, .. })) => self.trouble = Some(why),
        }
    }

    /// Returns the advice before the first usable image.
    pub(super) fn waiting(&self) -> Advice {
        Advice::missing(self.trouble.clone().unwrap_or_else(|| "waiting for frames".into()))
    }

    /// Returns at most so many of the images, evenly spread over all, with their poses.
    pub(super) fn posed(&self, track: &Track, most: usize) -> Vec<Observation<S>> {
        let some = self.observations.iter().step_by(self.observations.len().div_ceil(most).max(1));
        some.map(|one| Observation { poses: track.at(one.time_s), ..one.clone() }).collect()
    }
}
