//! Why a frame was not used.

use std::fmt;

use calibration::frames::{BadMatrix, NotRigid};
use serde::Serialize;

/// The reasons a frame can be refused for, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// The source says that the picture is not valid.
    ImageStatus,
    /// The frame has no pixels, or not as many as its size needs.
    ImageMissing,
    /// The orientation code is unknown or not of a 2D picture.
    ImageOrientation,
    /// Not a brightness picture (RF, I/Q, unknown).
    ImageType,
    /// Channels of which no grey can be made.
    Colour,
    /// A pixel is NaN, infinite or beyond single precision.
    PixelNotFinite,
    /// The frame's time is not finite, or beyond what 64 bits of nanoseconds hold.
    TimeInvalid,
    /// A transform on the way to the world was not delivered for this frame.
    PoseMissing,
    /// The source says that a transform on the way is not valid.
    PoseInvalid,
    /// A transform on the way holds NaN or infinity.
    PoseNotFinite,
    /// A tracker's transform on the way is left-handed.
    PoseMirrored,
    /// A tracker's transform on the way has scale or skew, or a matrix on the way is not affine.
    PoseNotRigid,
    /// A transform on the way cannot be inverted.
    PoseSingular,
    /// No way from the image to the world was known yet.
    NoPath,
    /// The picture's size is not that of the frames before.
    SizeChanged,
    /// The same picture at the same pose as the frame before: it would add nothing.
    Repeated,
    /// The slice lies too far out for the lattice.
    OutOfRange,
    /// The time lies too far from the first frame's to be ordered.
    OutOfTime,
    /// The slice leaves the plane of a scan that is reconstructed as planar.
    OutOfPlane,
    /// The pose scales pixels to a size for which the kernel makes no filter.
    PixelSize,
    /// The picture is the last one's at another pose: the grabber repeats it, or the scanner is frozen.
    SamePicture,
    /// Whoever looks at the session has frozen it.
    Paused,
    /// The volume has all the memory that it may take.
    VolumeFull,
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
    /// All reasons, in the order of the stages that find them.
    pub const ALL: [Self; 23] = [
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
        Self::Paused,
        Self::VolumeFull,
    ];

    /// The name in statistics; the serialised form is the same.
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
            Self::Paused => "paused",
            Self::VolumeFull => "volume_full",
        }
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A frame that was refused; nothing else changed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Refusal {
    /// Position of the frame in its stream, from 0.
    pub item: u64,
    /// Why, by name.
    pub reason: Reason,
    /// Why, in words.
    pub detail: String,
}

impl Refusal {
    /// A refusal of frame `item`.
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
    fn names_are_the_serialised_form_and_all_are_listed_once() {
        let mut names = std::collections::BTreeSet::new();
        for reason in Reason::ALL {
            assert_eq!(serde_json::to_string(&reason).unwrap(), format!("\"{}\"", reason.name()));
            assert!(names.insert(reason));
        }
    }
}
