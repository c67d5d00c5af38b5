//! Advice while the phantom is scanned: how well the image plane is known, and which view to
//! scan next.

use std::path::{Path, PathBuf};

use calibration::phantom::file::Registration;
use calibration::probe::{Dots, Layout, Recording, calibrate, next};
use config::phantom::FrameNames;
use sonoweave_core::region::ClipRect;
use sync::ingest::live::Live;

use super::super::guide::{Advice, Advisor, Guide, lead};
use super::super::recorded::without_latency;
use super::options::Options;
use super::quality::predicted_ends;
use super::recording::WireFinder;
use super::scan::Scan;
use crate::failure::Failure;

/// Largest number of images in an evaluation, evenly spread over all. It takes about a second.
const MOST_PICTURES: usize = 200;
/// Smallest number of images, whatever the predicted error. Fewer images hide persistent errors.
const ENOUGH_PICTURES: f64 = 100.0;

/// Records a scan until the image plane is known well enough.
///
/// # Errors
/// [`Failure`] when the configured devices cannot be recorded.
pub(super) fn gathered(
    path: &Path,
    options: &Options,
    advisor: &mut dyn Advisor,
    layout: &Layout,
    held: &Registration,
    frames: &FrameNames,
    clip: Option<ClipRect>,
) -> Result<PathBuf, Failure> {
    let gathered = lead(path, &options.gathering, advisor, |bedside| {
        let roles = without_latency(bedside)?;
        let scanned = Scanned {
            finder: WireFinder::new(layout, clip, Some(bedside.mask)),
            scan: Scan::new(&roles, bedside),
            layout,
            held,
            frames,
            goal_mm: options.goal,
            limit_mm: options.limit,
        };
        scanned.scan.check(path, &frames.probe, &frames.reference)?;
        Ok((scanned, roles))
    })?;
    Ok(gathered.session)
}

/// The scan so far.
struct Scanned<'a> {
    finder: WireFinder<'a>,
    scan: Scan<Dots>,
    layout: &'a Layout,
    held: &'a Registration,
    frames: &'a FrameNames,
    goal_mm: f64,
    limit_mm: f64,
}

impl Guide for Scanned<'_> {
    fn add(&mut self, device: usize, live: Live) {
        self.scan.add(device, live, |image| self.finder.find(image.size, &image.view()?));
    }

    fn advise(&mut self) -> Advice {
        let Some(size_px) = self.finder.size_px() else { return self.scan.waiting() };
        let track = match self.scan.tracks.track(&self.frames.probe, &self.frames.reference) {
            Ok(track) => track,
            Err(why) => return Advice::missing(why),
        };
        let observations = self.scan.posed(&track, MOST_PICTURES);
        let recording = Recording { observations: &observations, track: Some(&track), size_px, timed: true };
        let found = match calibrate(self.layout, self.held, recording, None) {
            Ok(found) => found,
            Err(refused) => return Advice::missing(refused.to_string()),
        };
        let [centre, corner] = predicted_ends(&found);
        let held_out = found.validation.as_ref().map(|[errors, _]| errors.mean);
        let pictures = self.scan.observations.len() as f64;
        let mut message = format!(
            "a point is known to {centre:.2} mm at the image's centre and {corner:.2} at the worst corner, the goal is {} mm, from {} of {} frames",
            self.goal_mm,
            found.used(),
            observations.len()
        );
        if let Some(mm) = held_out.filter(|mm| *mm > self.limit_mm) {
            message += &format!("; the last frames are {mm:.2} mm off: keep the phantom in its place, and metal away");
            return Advice::at(0.5, message);
        }
        let next = found.next_view(self.layout, recording, next::pictures(found.used()));
        message += &match next.as_ref().and_then(|next| next.best()) {
            Some(best) => format!("; {best}"),
            None => "; scan on along the wires, and tilt and turn the probe".into(),
        };
        Advice::at((self.goal_mm / corner).powi(2).min(pictures / ENOUGH_PICTURES), message)
    }
}
