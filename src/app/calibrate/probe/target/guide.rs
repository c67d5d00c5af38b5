//! Advice while a point, a stylus's tip or a plane is scanned.

use std::path::{Path, PathBuf};

use calibration::probe::Recording;
use calibration::probe::target::{Seen, Target, calibrate};
use config::bedside::devices::{REFERENCE_FRAME, TRACKER_FRAME};
use mask::MaskSettings;
use sonoweave_core::region::ClipRect;
use sync::ingest::live::Live;

use super::super::super::guide::{Advice, Advisor, Guide, lead};
use super::super::super::recorded::without_latency;
use super::super::options::Options;
use super::super::recording::Region;
use super::super::scan::Scan;
use super::detector::Detector;
use super::observe::Names;
use super::quality::ends;
use crate::failure::Failure;

/// Largest number of images in an evaluation, evenly spread over all.
const MOST_PICTURES: usize = 600;
/// Smallest number of images, whatever the predicted error.
const ENOUGH_PICTURES: f64 = 100.0;
/// Number of images before the search for a plane's line begins. The search needs to know the
/// static pixels of all images.
const LEAST_LEARNED: usize = 60;

/// Records a scan until the image plane is known well enough.
///
/// # Errors
/// [`Failure`] when the configured devices cannot be recorded.
pub(super) fn gathered(
    path: &Path,
    options: &Options,
    advisor: &mut dyn Advisor,
    target: Target,
    names: Names<'_>,
) -> Result<PathBuf, Failure> {
    let gathered = lead(path, &options.gathering, advisor, |bedside| {
        let roles = without_latency(bedside)?;
        let scan = Scan::new(&roles, bedside);
        let usual = if scan.tracks.of(REFERENCE_FRAME).is_some() { REFERENCE_FRAME } else { TRACKER_FRAME };
        let reference = names.reference.unwrap_or(usual);
        scan.check(path, names.probe, reference)?;
        let scanned = Scanned {
            target,
            probe: names.probe,
            reference: reference.to_owned(),
            clip: options.clip,
            mask: bedside.mask,
            goal_mm: options.goal,
            detector: Detector::new(target == Target::Plane),
            region: None,
            scan,
        };
        Ok((scanned, roles))
    })?;
    Ok(gathered.session)
}

/// The scan so far.
struct Scanned<'a> {
    target: Target,
    probe: &'a str,
    reference: String,
    clip: Option<ClipRect>,
    mask: MaskSettings,
    goal_mm: f64,
    detector: Detector,
    region: Option<Region>,
    scan: Scan<Seen>,
}

impl Guide for Scanned<'_> {
    fn add(&mut self, device: usize, live: Live) {
        self.scan.add(device, live, |image| {
            let region = Region::within(&mut self.region, Some(self.mask), self.clip, image.size)?;
            let view = image.view()?;
            self.detector.learn(&view, region);
            Ok(self.detector.detect(&view, region))
        });
    }

    fn advise(&mut self) -> Advice {
        let Some(region) = self.region.as_ref().filter(|_| !self.scan.observations.is_empty()) else {
            return self.scan.waiting();
        };
        if !self.detector.prepare(LEAST_LEARNED) {
            return Advice::missing("scan on: the search for static pixels needs more frames");
        }
        let track = match self.scan.tracks.track(self.probe, &self.reference) {
            Ok(track) => track,
            Err(why) => return Advice::missing(why),
        };
        let observations = self.scan.posed(&track, MOST_PICTURES);
        let recording =
            Recording { observations: &observations, track: Some(&track), size_px: region.size, timed: true };
        let found = match calibrate(self.target, recording, None) {
            Ok(found) => found,
            Err(refused) => return Advice::missing(refused.to_string()),
        };
        let [centre, corner] = ends(&found);
        let message = format!(
            "a point is known to {centre:.2} mm at the image's centre and {corner:.2} at the worst corner, the goal is {} mm; {}",
            self.goal_mm,
            if self.target == Target::Plane {
                "raise and lower the probe, tilt it fore and aft and from side to side, with the plane in the image"
            } else {
                "bring the point to all parts of the image, and tilt and turn the probe"
            }
        );
        Advice::at((self.goal_mm / corner).powi(2).min(self.scan.observations.len() as f64 / ENOUGH_PICTURES), message)
    }
}
