//! Reasons for which a frame was refused.

use std::fmt;

use serde::Serialize;

use crate::frames::{BadMatrix, NotRigid};

/// Reason for refusing a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// The source reports an invalid image.
    ImageStatus,
    /// The frame has no pixels, or not as many as its size needs.
    ImageMissing,
    /// The orientation code is unknown or not of a 2D image.
    ImageOrientation,
    /// Not a brightness image (RF, I/Q, unknown).
    ImageType,
    /// Channels that cannot be converted to grey.
    Colour,
    /// A pixel is NaN, infinite or beyond single precision.
    PixelNotFinite,
    /// The frame's time is not finite, or does not fit 64 bits of nanoseconds.
    TimeInvalid,
    /// A transform between image and world was not delivered for this frame.
    PoseMissing,
    /// The source reports an invalid transform between image and world.
    PoseInvalid,
    /// A transform between image and world holds NaN or infinity.
    PoseNotFinite,
    /// A tracker's transform between image and world is left-handed.
    PoseMirrored,
    /// A tracker's transform between image and world has scale or skew, or a matrix is not
    /// affine.
    PoseNotRigid,
    /// A transform between image and world cannot be inverted.
    PoseSingular,
    /// No chain of transforms from the image to the world was known yet.
    NoPath,
    /// The image's size differs from that of earlier frames.
    SizeChanged,
    /// Same image and same pose as the frame before: it would add nothing.
    Repeated,
    /// The slice lies beyond the range of the lattice.
    OutOfRange,
    /// The time is too far from the first frame's to be ordered.
    OutOfTime,
    /// The slice leaves the plane of a scan on the planar path.
    OutOfPlane,
    /// The pose scales pixels to a size for which the kernel has no filter.
    PixelSize,
    /// Same image as the last one at another pose: the grabber repeats it, or the scanner is
    /// stuck.
    SamePicture,
    /// The user has frozen the session.
    Frozen,
    /// The volume has reached its memory limit.
    VolumeFull,
    /// A correction of the recorded session leaves the frame out.
    Gated,
    /// The corrections of the recorded session have no pose for the frame.
    NotCorrected,
}

impl From<&BadMatrix> for Reason {
    fn from(bad: &BadMatrix) -> Self {
        match bad {
            BadMatrix::NotFinite { .. } => Self::PoseNotFinite,
            BadMatrix::LastRow { .. } => Self::PoseNotRigid,
            BadMatrix::Singular { .. } => Self::PoseSingular,
        }
    }
}

impl From<&NotRigid> for Reason {
    fn from(bad: &NotRigid) -> Self {
        match bad {
            NotRigid::Mirrored { .. } => Self::PoseMirrored,
            NotRigid::Distorted { .. } => Self::PoseNotRigid,
        }
    }
}

impl Reason {
    /// All reasons.
    pub const ALL: [Self; 25] = [
        Self::ImageStatus,
        Self::ImageMissing,
        Self::ImageOrientation,
        Self::ImageType,
        Self::Colour,
        Self::PixelNotFinite,
        Self::TimeInvalid,
        Self::PoseMissing,
        Self::PoseInvalid,
        Self::PoseNotFinite,
        Self::PoseMirrored,
        Self::PoseNotRigid,
        Self::PoseSingular,
        Self::NoPath,
        Self::SizeChanged,
        Self::Repeated,
        Self::OutOfRange,
        Self::OutOfTime,
        Self::OutOfPlane,
        Self::PixelSize,
        Self::SamePicture,
        Self::Frozen,
        Self::VolumeFull,
        Self::Gated,
        Self::NotCorrected,
    ];

    /// Returns the name in statistics; the serialised form is the same.
    pub const fn name(self) -> &'static str {
        match self {
            Self::ImageStatus => "image_status",
            Self::ImageMissing => "image_missing",
            Self::ImageOrientation => "image_orientation",
            Self::ImageType => "image_type",
            Self::Colour => "colour",
            Self::PixelNotFinite => "pixel_not_finite",
            Self::TimeInvalid => "time_invalid",
            Self::PoseMissing => "pose_missing",
            Self::PoseInvalid => "pose_invalid",
            Self::PoseNotFinite => "pose_not_finite",
            Self::PoseMirrored => "pose_mirrored",
            Self::PoseNotRigid => "pose_not_rigid",
            Self::PoseSingular => "pose_singular",
            Self::NoPath => "no_path",
            Self::SizeChanged => "size_changed",
            Self::Repeated => "repeated",
            Self::OutOfRange => "out_of_range",
            Self::OutOfTime => "out_of_time",
            Self::OutOfPlane => "out_of_plane",
            Self::PixelSize => "pixel_size",
            Self::SamePicture => "same_picture",
            Self::Frozen => "frozen",
            Self::VolumeFull => "volume_full",
            Self::Gated => "gated",
            Self::NotCorrected => "not_corrected",
        }
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A refused frame; refusing it changed nothing else.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Refusal {
    /// Position of the frame in its stream, from 0.
    pub item: u64,
    /// Reason.
    pub reason: Reason,
    /// Explanation in words.
    pub detail: String,
}

impl Refusal {
    /// Returns a refusal of frame `item`.
    pub fn new(item: u64, reason: Reason, detail: impl Into<String>) -> Self {
        Self { item, reason, detail: detail.into() }
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "frame {}: {} ({})", self.item, self.detail, self.reason)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_match_serialised_form_and_are_unique() {
        let mut names = std::collections::BTreeSet::new();
        for reason in Reason::ALL {
            assert_eq!(serde_json::to_string(&reason).unwrap(), format!("\"{}\"", reason.name()));
            assert!(names.insert(reason));
        }
    }
}
