//! What whoever scans a point, a stylus's tip or a plane is told meanwhile.

use std::path::{Path, PathBuf};

use calibration::probe::DotFinder;
use calibration::probe::target::{Observation, Recording, Target, calibrate};
use calibration::region::ClipRect;

use super::super::super::guide::{Advice, Guide, lead};
use super::super::super::recorded::{GRABBER, Tracks, shown_now, without_latency};
use super::super::recording::{Region, number};
use super::look::{Names, of_dots};
use super::{Arguments, Failure, ends};
use crate::config::bedside::devices::{REFERENCE_FRAME, TRACKER_FRAME};
use crate::ingest::live::Live;
use crate::mask::MaskSettings;

/// Pictures that a judgement is made by, at most: evenly over all there are.
const MOST_PICTURES: usize = 150;
/// Fewer than these are not enough, however sure they make it.
const ENOUGH_PICTURES: f64 = 100.0;
/// A plane's line is found by what stands still in all pictures: it is looked for when there are so many seconds of them.
const OF_A_PLANE_S: f64 = 30.0;

/// Records a scan until the picture's place is known well enough; of a plane for half a minute.
///
/// # Errors
/// [`Failure`] when the bedside's devices cannot be recorded.
pub(super) fn gathered(
    path: &Path,
    arguments: &Arguments,
    target: Target,
    names: Names<'_>,
) -> Result<PathBuf, Failure> {
    let gathered = lead(path, &arguments.gathering, |bedside| {
        let instruments = without_latency(bedside)?;
        let scanned = Scanned {
            target,
            names,
            clip: arguments.clip,
            mask: bedside.mask,
            goal_mm: arguments.goal,
            finder: DotFinder::new(),
            region: None,
            tracks: Tracks::of_instruments(&instruments, bedside),
            seen: Vec::new(),
            trouble: None,
        };
        Ok((scanned, instruments))
    })?;
    Ok(gathered.session)
}

/// The scan by now.
struct Scanned<'a> {
    target: Target,
    names: Names<'a>,
    clip: Option<ClipRect>,
    mask: MaskSettings,
    goal_mm: f64,
    finder: DotFinder,
    region: Option<Region>,
    tracks: Tracks,
    /// Their poses come later.
    seen: Vec<Observation>,
    trouble: Option<String>,
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
            let region = Region::within(&mut self.region, Some(self.mask), self.clip, shown.size)?;
            let seen = of_dots(&mut self.finder, &shown.view()?, region);
            Ok(Observation { frame: number(shown.frame), time_s: shown.time_s(), seen, poses: None })
        });
        match looked {
            Ok(seen) => self.seen.push(seen),
            Err(Failure(why)) => self.trouble = Some(why),
        }
    }

    fn advise(&mut self) -> Advice {
        let (Some(region), Some(first), Some(last)) = (&self.region, self.seen.first(), self.seen.last()) else {
            return Advice::missing(self.trouble.clone().unwrap_or_else(|| "waiting for pictures".into()));
        };
        let scanned_s = last.time_s - first.time_s;
        if self.target == Target::Plane {
            let says = format!(
                "{scanned_s:.0} of {OF_A_PLANE_S:.0} s; raise and lower the probe, tilt it fore and aft and from side to side, the floor in sight"
            );
            return Advice::at(scanned_s / OF_A_PLANE_S, says);
        }
        let usual = if self.tracks.of(REFERENCE_FRAME).is_some() { REFERENCE_FRAME } else { TRACKER_FRAME };
        let track = match self.tracks.track(self.names.probe, self.names.reference.unwrap_or(usual)) {
            Ok(track) => track,
            Err(why) => return Advice::missing(why),
        };
        let some = self.seen.iter().step_by(self.seen.len().div_ceil(MOST_PICTURES).max(1));
        let observations: Vec<Observation> =
            some.map(|seen| Observation { poses: track.at(seen.time_s), ..seen.clone() }).collect();
        let recording =
            Recording { observations: &observations, track: Some(&track), size_px: region.size, timed: true };
        let found = match calibrate(self.target, recording, None) {
            Ok(found) => found,
            Err(refused) => return Advice::missing(refused.to_string()),
        };
        let [centre, corner] = ends(&found);
        let says = format!(
            "a point is known to {centre:.2} mm at the picture's centre, {corner:.2} at the worst corner, where {} are wanted; bring it to all parts of the picture, and tilt and turn the probe",
            self.goal_mm
        );
        Advice::at((self.goal_mm / corner).powi(2).min(self.seen.len() as f64 / ENOUGH_PICTURES), says)
    }
}
