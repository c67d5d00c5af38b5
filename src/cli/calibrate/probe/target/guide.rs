//! Advice while a point, a stylus's tip or a plane is scanned.

use std::path::{Path, PathBuf};

use calibration::latency::line::{Finder, Still};
use calibration::picture::GreyView;
use calibration::probe::target::{Seen, Target, calibrate};
use calibration::probe::{DotFinder, Observation, Recording};
use config::bedside::devices::{REFERENCE_FRAME, TRACKER_FRAME};
use mask::MaskSettings;
use sonoweave_core::region::ClipRect;
use sync::ingest::live::Live;

use super::super::super::guide::{Advice, Guide, lead};
use super::super::super::recorded::{GRABBER, Tracks, shown_now, without_latency};
use super::super::arguments::Arguments;
use super::super::recording::{Region, number};
use super::look::{Names, of_dots, part};
use super::report::ends;
use crate::cli::Failure;

/// Largest number of images in an evaluation, evenly spread over all.
const MOST_PICTURES: usize = 600;
/// Smallest number of images, whatever the predicted error.
const ENOUGH_PICTURES: f64 = 100.0;
/// Number of images before the search for a plane's line begins. The search needs to know the
/// static pixels of all images.
const TELL_STILL: usize = 60;

/// Records a scan until the image plane is known well enough.
///
/// # Errors
/// [`Failure`] when the configured devices cannot be recorded.
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
            eye: if target == Target::Plane {
                Eye::Line { still: None, of: 0, finder: None }
            } else {
                Eye::Dots(DotFinder::new())
            },
            region: None,
            tracks: Tracks::of_instruments(&instruments, bedside),
            seen: Vec::new(),
            trouble: None,
        };
        Ok((scanned, instruments))
    })?;
    Ok(gathered.session)
}

/// The scan so far.
struct Scanned<'a> {
    target: Target,
    names: Names<'a>,
    clip: Option<ClipRect>,
    mask: MaskSettings,
    goal_mm: f64,
    eye: Eye,
    region: Option<Region>,
    tracks: Tracks,
    /// Their poses are added later.
    seen: Vec<Observation<Seen>>,
    trouble: Option<String>,
}

/// Detector for the target.
enum Eye {
    Dots(DotFinder),
    /// Learns the static pixels gradually; no line is detected until then.
    Line {
        still: Option<Still>,
        /// Number of images in `still`.
        of: usize,
        finder: Option<Finder>,
    },
}

impl Eye {
    fn see(&mut self, view: &GreyView<'_>, region: &Region) -> Seen {
        match self {
            Self::Dots(finder) => of_dots(finder, view, region),
            Self::Line { still, of, finder } => {
                let (Some(part), from) = part(view, region.clip) else { return Seen::Nothing };
                match still {
                    Some(still) => _ = still.add(&part),
                    none => *none = Some(Still::new(&part)),
                }
                *of += 1;
                let line = finder.as_mut().and_then(|finder| finder.find(&part).ok());
                line.map_or(Seen::Nothing, |line| Seen::line(&line, from))
            }
        }
    }

    /// Applies the static pixels learned so far. Returns false if they come from too few images.
    fn learn(&mut self) -> bool {
        let Self::Line { still, of, finder } = self else { return true };
        if let Some(still) = still.as_ref().filter(|_| *of >= TELL_STILL) {
            *finder = Some(Finder::new(still.clone()));
        }
        finder.is_some()
    }
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
            let seen = self.eye.see(&shown.view()?, region);
            Ok(Observation { frame: number(shown.frame), time_s: shown.time_s(), seen, poses: None })
        });
        match looked {
            Ok(seen) => self.seen.push(seen),
            Err(Failure(why)) => self.trouble = Some(why),
        }
    }

    fn advise(&mut self) -> Advice {
        let Some(region) = self.region.as_ref().filter(|_| !self.seen.is_empty()) else {
            return Advice::missing(self.trouble.clone().unwrap_or_else(|| "waiting for frames".into()));
        };
        if !self.eye.learn() {
            return Advice::missing("scan on: the search for static pixels needs more frames");
        }
        let usual = if self.tracks.of(REFERENCE_FRAME).is_some() { REFERENCE_FRAME } else { TRACKER_FRAME };
        let track = match self.tracks.track(self.names.probe, self.names.reference.unwrap_or(usual)) {
            Ok(track) => track,
            Err(why) => return Advice::missing(why),
        };
        let some = self.seen.iter().step_by(self.seen.len().div_ceil(MOST_PICTURES).max(1));
        let observations: Vec<Observation<Seen>> =
            some.map(|seen| Observation { poses: track.at(seen.time_s), ..seen.clone() }).collect();
        let recording =
            Recording { observations: &observations, track: Some(&track), size_px: region.size, timed: true };
        let found = match calibrate(self.target, recording, None) {
            Ok(found) => found,
            Err(refused) => return Advice::missing(refused.to_string()),
        };
        let [centre, corner] = ends(&found);
        let says = format!(
            "a point is known to {centre:.2} mm at the image's centre and {corner:.2} at the worst corner, the goal is {} mm; {}",
            self.goal_mm,
            if self.target == Target::Plane {
                "raise and lower the probe, tilt it fore and aft and from side to side, with the plane in the image"
            } else {
                "bring the point to all parts of the image, and tilt and turn the probe"
            }
        );
        Advice::at((self.goal_mm / corner).powi(2).min(self.seen.len() as f64 / ENOUGH_PICTURES), says)
    }
}
