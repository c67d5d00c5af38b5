//! Status of the mask: its shape, its certainty, its origin, and the keys that repeat it.

use serde::Serialize;

use mask::{MaskChange, MaskError, MaskFound, MaskSettings};
use sonoweave_core::region::ClipRect;

/// Origin of a mask.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum MaskOrigin {
    /// The configuration, or the calibration.
    Configured,
    /// It was found in the first frames.
    Found,
    /// It was found in the first frames or configured, and an operator confirmed it.
    Confirmed,
    /// An operator ordered it.
    Operator,
}

/// The mask of a session's slices.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MaskStatus {
    /// Width and height of the frames.
    pub size_px: [u32; 2],
    /// Its origin.
    pub origin: MaskOrigin,
    /// Shape, certainty, border and reasons.
    #[serde(flatten)]
    pub found: MaskFound,
    /// The same as a sentence.
    pub says: String,
    /// Keys of the section `[calibration]` that give this mask to the next session; `None` for an
    /// outline of pixels.
    pub config: Option<String>,
    /// The part of each frame that is recorded; `None` for all of it.
    pub recorded: Option<ClipRect>,
}

impl MaskStatus {
    /// Returns the status. `recorded` are the settings of the part of frames that is recorded.
    pub fn new(found: MaskFound, origin: MaskOrigin, recorded: Option<MaskSettings>) -> Self {
        let size_px = [found.mask.width(), found.mask.height()];
        let recorded = recorded.map(|mask| mask.bounds(size_px)).filter(|rect| !rect.covers(size_px[0], size_px[1]));
        Self { size_px, origin, says: found.to_string(), config: found.shape.config(), recorded, found }
    }

    /// Checks a change against the frames, and against the part of them that is recorded.
    ///
    /// # Errors
    /// [`MaskRefusal`].
    pub fn check(&self, change: &MaskChange) -> Result<(), MaskRefusal> {
        let Some(data) = change.mask(self.size_px)?.and_then(|mask| mask.bounds()) else { return Ok(()) };
        match self.recorded {
            Some(kept) if !holds(kept, data) => Err(MaskRefusal::NotRecorded { kept }),
            _ => Ok(()),
        }
    }
}

/// Whether a rectangle contains another.
fn holds(outer: ClipRect, inner: ClipRect) -> bool {
    let end = |rect: ClipRect| [rect.x + rect.width, rect.y + rect.height];
    let (outer_end, inner_end) = (end(outer), end(inner));
    outer.x <= inner.x && outer.y <= inner.y && inner_end[0] <= outer_end[0] && inner_end[1] <= outer_end[1]
}

/// Reason why a mask cannot be taken.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MaskRefusal {
    /// It does not fit the frames.
    #[error(transparent)]
    Mask(#[from] MaskError),
    /// There is no mask that could be changed.
    #[error("the mask is still being searched for in the first frames; wait a moment")]
    Undecided,
    /// The planar path's columns hold one rectangle.
    #[error(
        "the planar path holds slices of one rectangle only; set clip_px in the configuration, or choose the general path (volume.path), and begin a new session"
    )]
    Planar,
    /// It needs pixels that the recording leaves out, so that a replay could not repeat it.
    #[error(
        "the recording keeps only {}×{} pixels at {},{} of each frame; choose a mask inside of them, or set record.full_frame",
        .kept.width, .kept.height, .kept.x, .kept.y
    )]
    NotRecorded {
        /// The part of each frame that is recorded.
        kept: ClipRect,
    },
}

#[cfg(test)]
mod tests {
    use super::*;
    use mask::Clip;

    #[test]
    fn mask_beyond_recorded_part_is_refused() {
        let rect = |x, y, width, height| ClipRect { x, y, width, height };
        let settings = MaskSettings { clip: Clip::Rect(rect(10, 20, 30, 40)), ..MaskSettings::default() };
        let found = || settings.known(mask::Mask::rect(64, 80, rect(10, 20, 30, 40)));
        let status = MaskStatus::new(found(), MaskOrigin::Configured, Some(settings));
        let check = |x, y, width, height| status.check(&MaskChange::Rectangle(rect(x, y, width, height)));
        assert_eq!(
            [check(10, 20, 30, 40), check(12, 30, 1, 30), status.check(&MaskChange::Keep)],
            [Ok(()), Ok(()), Ok(())]
        );
        for (x, y, width, height) in [(9, 20, 3, 3), (10, 19, 3, 3), (10, 20, 31, 3), (10, 20, 3, 41)] {
            assert_eq!(check(x, y, width, height), Err(MaskRefusal::NotRecorded { kept: rect(10, 20, 30, 40) }));
        }
        assert_eq!(status.check(&MaskChange::Whole), Err(MaskRefusal::NotRecorded { kept: rect(10, 20, 30, 40) }));
        assert!(matches!(check(0, 0, 65, 1), Err(MaskRefusal::Mask(MaskError::Leaves { .. }))));
        let whole = MaskStatus::new(found(), MaskOrigin::Configured, None);
        assert_eq!(whole.check(&MaskChange::Whole), Ok(()));
        assert_eq!(whole.config.as_deref(), Some("clip_px = [10, 20, 30, 40]"));
    }
}
