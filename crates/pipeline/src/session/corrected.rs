//! Corrected poses of a recorded session's frames. A replay uses them in place of those that it
//! pairs, and leaves out the frames that a gate refused.

use std::collections::{BTreeMap, BTreeSet};

use calibration::pressure::Compression;
use sonoweave_core::frames::{Image as ImageFrame, Transform, World};
use sonoweave_core::refusal::{Reason, Refusal};
use sonoweave_core::slice::{Image, Pixels};

/// Corrected poses, and frames left out, by the frames' numbers.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CorrectedFrames {
    /// The corrections, by number and kind, for headers of volumes.
    pub words: String,
    /// Root mean square error of places in the image by the noise of the corrected poses, mm;
    /// `None` if it is that of the session.
    pub pose_error_mm: Option<f64>,
    /// Corrected poses; `None` if all stay. A frame that then has none is refused.
    pub poses: Option<BTreeMap<u64, Transform<World, ImageFrame>>>,
    /// Frames that are left out.
    pub left_out: BTreeSet<u64>,
    /// Displacement of tissue along v by the probe's pressure, which is undone. Depths count from
    /// the image's first row, mm.
    pub compressions: BTreeMap<u64, Compression>,
}

impl CorrectedFrames {
    /// Returns a frame's pose, from the one that it was paired with.
    ///
    /// # Errors
    /// The refusal of a frame that is left out, or that has no corrected pose.
    pub(super) fn pose(
        &self,
        frame: u64,
        paired: Transform<World, ImageFrame>,
    ) -> Result<Transform<World, ImageFrame>, Refusal> {
        if self.left_out.contains(&frame) {
            return Err(Refusal::new(frame, Reason::Gated, "a correction of the session leaves it out"));
        }
        let Some(poses) = &self.poses else { return Ok(paired) };
        let corrected = poses.get(&frame).copied();
        corrected.ok_or_else(|| Refusal::new(frame, Reason::NotCorrected, "it has a pose, but no corrected one"))
    }
}

impl CorrectedFrames {
    /// Returns a frame's image as light contact would show it.
    pub(super) fn image(&self, frame: u64, image: Image, pose: &Transform<World, ImageFrame>) -> Image {
        let (Some(compression), Pixels::U8(pixels)) = (self.compressions.get(&frame), image.pixels()) else {
            return image;
        };
        let mm_per_row = pose.affine().matrix3.y_axis.length();
        // Tissue is displaced within the image's data.
        let undone = compression.undone(pixels, &vec![true; pixels.len()], image.width() as usize, mm_per_row);
        Image::new(image.width(), image.height(), Pixels::U8(undone.pixels.into()))
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

    #[test]
    fn pressed_image_is_shown_as_by_light_contact() {
        // Rows of 0.5 mm; tissue is shown 1 mm deeper than it lies.
        let pose = Transform::from_affine(glam::DAffine3::from_scale(glam::DVec3::new(0.3, 0.5, 1.0)));
        let image = Image::new(2, 5, Pixels::U8((0..10).collect::<Vec<u8>>().into()));
        let compressions = [(3, Compression::new(vec![[0.0, 1.0]]).unwrap())].into();
        let corrected = CorrectedFrames { compressions, ..CorrectedFrames::default() };
        let Pixels::U8(pixels) = corrected.image(3, image.clone(), &pose).pixels().clone() else { panic!("8 bits") };
        assert_eq!(&pixels[..6], [4, 5, 6, 7, 8, 9]);
        let other = corrected.image(4, image.clone(), &pose);
        assert!(matches!((other.pixels(), image.pixels()), (Pixels::U8(a), Pixels::U8(b)) if a == b));
    }
}
