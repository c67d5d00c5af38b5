//! Detects the target in images: the spots that may be a point, or the line of a plane.

use glam::DVec2;

use calibration::latency::line::{Finder, Still};
use calibration::picture::GreyView;
use calibration::probe::DotFinder;
use calibration::probe::target::Seen;
use sonoweave_core::region::ClipRect;

use super::super::recording::Region;

/// Largest number of spots of an image that may be the point; the most prominent ones.
const MOST_SPOTS: usize = 12;

/// Detector for the target.
pub(super) enum Detector {
    /// For a point.
    Dots(DotFinder),
    /// For a plane. It needs to know the static pixels; no line is detected until then.
    Line {
        still: Option<Still>,
        /// Number of images in `still`.
        count: usize,
        finder: Option<Finder>,
    },
}

impl Detector {
    /// Returns a detector that has learned no static pixels.
    pub(super) fn new(is_plane: bool) -> Self {
        if is_plane { Self::Line { still: None, count: 0, finder: None } } else { Self::Dots(DotFinder::new()) }
    }

    /// Learns the static pixels of an image; does nothing for a point.
    pub(super) fn learn(&mut self, view: &GreyView<'_>, region: &Region) {
        let Self::Line { still, count, .. } = self else { return };
        let (Some(part), _) = part(view, region.clip) else { return };
        match still {
            // Images of another size are refused at detection.
            Some(still) => _ = still.add(&part),
            none => *none = Some(Still::new(&part)),
        }
        *count += 1;
    }

    /// Applies the static pixels learned so far, if they come from at least so many images.
    /// Returns whether the detector is ready.
    pub(super) fn prepare(&mut self, least: usize) -> bool {
        let Self::Line { still, count, finder } = self else { return true };
        if let Some(still) = still.as_ref().filter(|_| *count >= least) {
            *finder = Some(Finder::new(still.clone()));
        }
        finder.is_some()
    }

    /// Detects the target in an image.
    pub(super) fn detect(&mut self, view: &GreyView<'_>, region: &Region) -> Seen {
        match self {
            Self::Dots(finder) => of_dots(finder, view, region),
            Self::Line { finder, .. } => {
                let (part, from) = part(view, region.clip);
                let line = finder.as_mut().zip(part).and_then(|(finder, part)| finder.find(&part).ok());
                line.map_or(Seen::Nothing, |line| Seen::line(&line, from))
            }
        }
    }
}

/// Returns the spots that may be the point.
fn of_dots(finder: &mut DotFinder, view: &GreyView<'_>, region: &Region) -> Seen {
    let dots = finder.find(view, region.clip).iter().filter(|dot| region.holds(dot.at_px));
    let dots: Vec<DVec2> = dots.take(MOST_SPOTS).map(|dot| dot.at_px).collect();
    if dots.is_empty() { Seen::Nothing } else { Seen::Dots(dots) }
}

/// Returns the searched part of an image, and its first pixel.
fn part<'a>(view: &GreyView<'a>, clip: Option<ClipRect>) -> (Option<GreyView<'a>>, DVec2) {
    match clip {
        Some(clip) => (view.part(clip), DVec2::new(f64::from(clip.x), f64::from(clip.y))),
        None => (Some(*view), DVec2::ZERO),
    }
}
