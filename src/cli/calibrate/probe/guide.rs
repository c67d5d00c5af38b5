//! Advice while the phantom is scanned: how well the image plane is known, and which view to
//! scan next.

use std::path::{Path, PathBuf};

use calibration::phantom::file::Registration;
use calibration::probe::{Layout, Observation, Recording, calibrate, next};
use config::phantom::FrameNames;
use sonoweave_core::region::ClipRect;
use sync::ingest::live::Live;

use super::super::guide::{Advice, Guide, lead};
use super::super::recorded::{GRABBER, Tracks, shown_now, without_latency};
use super::arguments::Arguments;
use super::recording::{Looker, number};
use super::report::predicted_ends;
use crate::cli::Failure;

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
    arguments: &Arguments,
    layout: &Layout,
    held: &Registration,
    frames: &FrameNames,
    clip: Option<ClipRect>,
) -> Result<PathBuf, Failure> {
    let gathered = lead(path, &arguments.gathering, |bedside| {
        let instruments = without_latency(bedside)?;
        let scanned = Scanned {
            looker: Looker::new(layout, clip, Some(bedside.mask)),
            tracks: Tracks::of_instruments(&instruments, bedside),
            seen: Vec::new(),
            trouble: None,
            layout,
            held,
            frames,
            goal_mm: arguments.goal,
            limit_mm: arguments.limit,
        };
        Ok((scanned, instruments))
    })?;
    Ok(gathered.session)
}

/// The scan so far.
struct Scanned<'a> {
    looker: Looker<'a>,
    tracks: Tracks,
    /// Their poses are added later.
    seen: Vec<Observation>,
    /// Reason why the last image could not be used.
    trouble: Option<String>,
    layout: &'a Layout,
    held: &'a Registration,
    frames: &'a FrameNames,
    goal_mm: f64,
    limit_mm: f64,
}

impl Guide for Scanned<'_> {
    fn hear(&mut self, device: usize, live: Live) {
        let Live::Picture { picture, timed } = live else {
            if device != GRABBER {
                self.tracks.take(device, live);
            }
            return;
        };
        let looked = shown_now(&picture, &timed).and_then(|shown| {
            let seen = self.looker.look(shown.size, &shown.view()?)?;
            Ok(Observation { frame: number(shown.frame), time_s: shown.time_s(), seen, poses: None })
        });
        match looked {
            Ok(seen) => self.seen.push(seen),
            Err(Failure(why)) => self.trouble = Some(why),
        }
    }

    fn advise(&mut self) -> Advice {
        let Some(size_px) = self.looker.size_px() else {
            return Advice::missing(self.trouble.clone().unwrap_or_else(|| "waiting for frames".into()));
        };
        let track = match self.tracks.track(&self.frames.probe, &self.frames.reference) {
            Ok(track) => track,
            Err(why) => return Advice::missing(why),
        };
        let some = self.seen.iter().step_by(self.seen.len().div_ceil(MOST_PICTURES).max(1));
        let observations: Vec<Observation> =
            some.map(|seen| Observation { poses: track.at(seen.time_s), ..seen.clone() }).collect();
        let recording = Recording { observations: &observations, track: Some(&track), size_px, timed: true };
        let found = match calibrate(self.layout, self.held, recording, None) {
            Ok(found) => found,
            Err(refused) => return Advice::missing(refused.to_string()),
        };
        let [centre, corner] = predicted_ends(&found);
        let held_out = found.validation.as_ref().map(|[errors, _]| errors.mean);
        let pictures = self.seen.len() as f64;
        let mut says = format!(
            "a point is known to {centre:.2} mm at the image's centre and {corner:.2} at the worst corner, the goal is {} mm, from {} of {} frames",
            self.goal_mm,
            found.used(),
            observations.len()
        );
        if let Some(mm) = held_out.filter(|mm| *mm > self.limit_mm) {
            says += &format!("; the last frames are {mm:.2} mm off: keep the phantom in its place, and metal away");
            return Advice::at(0.5, says);
        }
        let next = found.next_view(self.layout, recording, next::pictures(found.used()));
        says += &match next.as_ref().and_then(|next| next.best()) {
            Some(best) => format!("; {best}"),
            None => "; scan on along the wires, and tilt and turn the probe".into(),
        };
        Advice::at((self.goal_mm / corner).powi(2).min(pictures / ENOUGH_PICTURES), says)
    }
}
