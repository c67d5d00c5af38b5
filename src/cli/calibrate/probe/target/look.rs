//! Target detections and poses from a recording.

use glam::DVec2;

use calibration::latency::line::{Finder, Still};
use calibration::picture::GreyView;
use calibration::probe::DotFinder;
use calibration::probe::target::Seen;
use config::bedside::devices::{REFERENCE_FRAME, TRACKER_FRAME};
use mask::MaskSettings;
use sonoweave_core::region::ClipRect;

use super::super::super::super::Failure;
use super::super::super::recorded::{Recorded, Shown, Tracked};
use super::super::recording::{Observed, Region};

/// Largest number of spots of an image that may be the point; the most prominent ones.
const MOST_SPOTS: usize = 12;

/// Names of frames.
#[derive(Debug, Clone, Copy)]
pub(super) struct Names<'a> {
    pub(super) probe: &'a str,
    /// The frame in which the target rests; `None` for the usual one.
    pub(super) reference: Option<&'a str>,
}

/// Searches a recording's images for a point, or for the line of a plane. Also returns the name
/// of the frame in which the target rests.
///
/// # Errors
/// [`Failure`] when it cannot be read, holds no grey images of 8 bits, or has no way from the
/// probe to the target's frame.
pub(super) fn look(
    recorded: &Recorded,
    names: Names<'_>,
    clip: Option<ClipRect>,
    is_plane: bool,
) -> Result<(Observed<Seen>, String), Failure> {
    let (tracked, reference) = tracked(recorded, names)?;
    let mut region: Option<Region> = None;
    let mut eye = if is_plane { Eye::Line(finder(recorded, clip)?) } else { Eye::Dots(DotFinder::new()) };
    let seen = Observed::new(recorded, &tracked, |shown| {
        eye.seen(shown, Region::within(&mut region, mask(recorded), clip, shown.size)?)
    })?;
    Ok((seen, reference))
}

/// Returns the probe's poses and the name of their frame.
fn tracked(recorded: &Recorded, Names { probe, reference }: Names<'_>) -> Result<(Tracked, String), Failure> {
    if let Some(name) = reference {
        return Ok((recorded.tracked(probe, name)?, name.to_owned()));
    }
    match recorded.tracked(probe, REFERENCE_FRAME) {
        Ok(tracked) => Ok((tracked, REFERENCE_FRAME.to_owned())),
        Err(why) => Ok((recorded.tracked(probe, TRACKER_FRAME).map_err(|_| why)?, TRACKER_FRAME.to_owned())),
    }
}

/// Detector for the target.
enum Eye {
    Dots(DotFinder),
    /// `None` if there is no image.
    Line(Option<Finder>),
}

impl Eye {
    fn seen(&mut self, shown: &Shown<'_>, region: &Region) -> Result<Seen, Failure> {
        let view = shown.view()?;
        Ok(match self {
            Self::Dots(finder) => of_dots(finder, &view, region),
            Self::Line(finder) => {
                let (part, from) = part(&view, region.clip);
                let line = finder.as_mut().zip(part).and_then(|(finder, part)| finder.find(&part).ok());
                line.map_or(Seen::Nothing, |line| Seen::line(&line, from))
            }
        })
    }
}

/// Returns the spots that may be the point.
pub(super) fn of_dots(finder: &mut DotFinder, view: &GreyView<'_>, region: &Region) -> Seen {
    let dots = finder.find(view, region.clip).iter().filter(|dot| region.holds(dot.at_px));
    let dots: Vec<DVec2> = dots.take(MOST_SPOTS).map(|dot| dot.at_px).collect();
    if dots.is_empty() { Seen::Nothing } else { Seen::Dots(dots) }
}

/// Returns a finder that knows the static pixels of all images.
fn finder(recorded: &Recorded, clip: Option<ClipRect>) -> Result<Option<Finder>, Failure> {
    let (mut region, mut still) = (None, None::<Still>);
    recorded.pictures(|shown| {
        let region = Region::within(&mut region, mask(recorded), clip, shown.size)?;
        let view = shown.view()?;
        let (Some(part), _) = part(&view, region.clip) else { return Ok(()) };
        match &mut still {
            // Images of another size are refused at detection.
            Some(still) => _ = still.add(&part),
            none => *none = Some(Still::new(&part)),
        }
        Ok(())
    })?;
    Ok(still.map(Finder::new))
}

/// Returns the session's image mask, if there is one.
fn mask(recorded: &Recorded) -> Option<MaskSettings> {
    recorded.bedside().map(|bedside| bedside.mask)
}

/// Returns the searched part of an image, and its first pixel.
pub(super) fn part<'a>(view: &GreyView<'a>, clip: Option<ClipRect>) -> (Option<GreyView<'a>>, DVec2) {
    match clip {
        Some(clip) => (view.part(clip), DVec2::new(f64::from(clip.x), f64::from(clip.y))),
        None => (Some(*view), DVec2::ZERO),
    }
}
