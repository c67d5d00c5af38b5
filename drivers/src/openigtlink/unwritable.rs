//! Reasons why a message cannot be written.

use sonoweave_core::reading::PixelType;

use super::fixed::Unfit;

/// Why a message cannot be written.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Unwritable {
    /// More than the field can hold.
    #[error("{size} {what} do not fit into an OpenIGTLink message; send less")]
    TooMuch {
        /// Name of the units.
        what: &'static str,
        /// Number of units.
        size: usize,
    },
    /// The protocol does not have the pixel type.
    #[error("OpenIGTLink has no pixels of type {0}; send another type")]
    PixelType(PixelType),
    /// The pixels do not form an image.
    #[error(
        "{bytes} bytes are not a box of {} from {} on, of {} voxels of {channels} channels of {pixel}; send the whole box",
        sides(*part), sides(*first), sides(*size)
    )]
    Part {
        /// Bytes of the pixels.
        bytes: usize,
        /// First voxel of the box.
        first: [u16; 3],
        /// Size of the box.
        part: [u16; 3],
        /// Size of the whole image.
        size: [u16; 3],
        /// Channels of a voxel.
        channels: u8,
        /// Scalar type.
        pixel: PixelType,
    },
    /// The name does not fit.
    #[error(transparent)]
    Name(#[from] Unfit),
}

/// Returns the lengths of a box's sides as a text.
fn sides(box_of: [u16; 3]) -> String {
    box_of.map(|side| side.to_string()).join("×")
}
