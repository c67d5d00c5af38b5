//! Corrected poses of a recorded session's frames. A replay uses them in place of those that it
//! pairs, and leaves out the frames that a gate refused.

use std::collections::{BTreeMap, BTreeSet};

use sonoweave_core::frames::{Image, Transform, World};
use sonoweave_core::refusal::{Reason, Refusal};

/// Corrected poses, and frames left out, by the frames' numbers.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CorrectedFrames {
    /// The corrections, by number and kind, for headers of volumes.
    pub words: String,
    /// Root mean square error of places in the image by the noise of the corrected poses, mm;
    /// `None` if it is that of the session.
    pub pose_error_mm: Option<f64>,
    /// Corrected poses; `None` if all stay. A frame that then has none is refused.
    pub poses: Option<BTreeMap<u64, Transform<World, Image>>>,
    /// Frames that are left out.
    pub left_out: BTreeSet<u64>,
}

impl CorrectedFrames {
    /// Returns a frame's pose, from the one that it was paired with.
    ///
    /// # Errors
    /// The refusal of a frame that is left out, or that has no corrected pose.
    pub(super) fn pose(&self, frame: u64, paired: Transform<World, Image>) -> Result<Transform<World, Image>, Refusal> {
        if self.left_out.contains(&frame) {
            return Err(Refusal::new(frame, Reason::Gated, "a correction of the session leaves it out"));
        }
        let Some(poses) = &self.poses else { return Ok(paired) };
        let corrected = poses.get(&frame).copied();
        corrected.ok_or_else(|| Refusal::new(frame, Reason::NotCorrected, "it has a pose, but no corrected one"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_gets_its_corrected_pose_or_is_refused() {
        let paired = Transform::IDENTITY;
        let corrected = Transform::from_affine(glam::DAffine3::from_translation(glam::DVec3::X));
        let none = CorrectedFrames::default();
        assert_eq!(none.pose(3, paired).unwrap(), paired);
        let poses = Some([(3, corrected), (4, corrected)].into());
        let some = CorrectedFrames { poses, left_out: BTreeSet::from([4]), ..none };
        assert_eq!(some.pose(3, paired).unwrap(), corrected);
        let reasons = [4, 5].map(|frame| some.pose(frame, paired).unwrap_err().reason);
        assert_eq!(reasons, [Reason::Gated, Reason::NotCorrected]);
    }
}
