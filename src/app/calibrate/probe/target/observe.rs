//! Target detections and poses from a recording.

use calibration::probe::target::Seen;
use config::bedside::devices::{REFERENCE_FRAME, TRACKER_FRAME};
use sonoweave_core::region::ClipRect;

use super::super::super::recorded::{Recorded, Tracked};
use super::super::recording::{Observed, Region};
use super::detector::Detector;
use crate::app::reporter::Steps;
use crate::failure::Failure;

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
pub(super) fn observe(
    recorded: &Recorded,
    names: Names<'_>,
    clip: Option<ClipRect>,
    is_plane: bool,
    steps: Steps<'_>,
) -> Result<(Observed<Seen>, String), Failure> {
    let (tracked, reference) = tracked(recorded, names)?;
    let mask = recorded.bedside().map(|bedside| bedside.mask);
    let mut detector = Detector::new(is_plane);
    if is_plane {
        // The static pixels of all images must be known before the first line is searched.
        let mut region = None;
        recorded.pictures(|image| {
            detector.learn(&image.view()?, Region::within(&mut region, mask, clip, image.size)?);
            Ok(())
        })?;
        detector.prepare(1);
    }
    let mut region: Option<Region> = None;
    let seen = Observed::new(recorded, &tracked, steps, |image| {
        Ok(detector.detect(&image.view()?, Region::within(&mut region, mask, clip, image.size)?))
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
