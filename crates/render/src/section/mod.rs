//! Planes through a volume, and through the slices it is made of.
//!
//! - [`plane`]: a plane in the world, the rectangle of it that meets a volume's box, and its
//!   pixels.
//! - [`layout`]: three orthogonal planes in one picture.
//! - [`volume`]: samples of a volume in a plane; [`nearest`]: samples of the nearest slices
//!   there.
//! - [`mod@reference`]: simple implementations of both, as the reference.
//!
//! Only the seen voxels about a place contribute, each by its trilinear share times its weight:
//! Σ s·w·v / Σ s·w. A place counts as seen if seen voxels have half of the shares or more.
//! Coverage thus ends half-way to the first unseen voxel, neither grown nor shrunk. A voxel of
//! low weight has little influence on a well-seen neighbour.

use glam::DVec3;

pub mod layout;
pub mod nearest;
pub mod plane;
pub mod reference;
pub mod volume;

#[cfg(test)]
mod tests;

pub use nearest::{NearestSlices, NearestWork};
pub use plane::{Box3, Plane, Section};
pub use volume::{Planar, PlanarWork};

/// Smallest share of seen voxels about a place that counts as seen.
pub const SEEN_SHARE: f64 = 0.5;

/// Sample of a place in a plane.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sampled {
    /// The grey level; 0 where nothing was seen.
    pub value: f32,
    /// Σ s·w: the volume's weight there. For a slice, the share of data pixels, at most 1.
    pub weight: f32,
    /// The share of seen voxels (for a slice: of data pixels) among those about the place, 0 to
    /// 1.
    pub share: f32,
}

impl Sampled {
    /// Nothing was seen.
    pub const UNSEEN: Self = Self { value: 0.0, weight: 0.0, share: 0.0 };

    /// Creates a sample from sums over the voxels about a place: Σ s·w·v and Σ s·w, and Σ s of
    /// the seen ones.
    #[inline]
    pub(super) fn of(numerator: f64, weight: f64, share: f64) -> Self {
        if weight > 0.0 {
            Self { value: (numerator / weight) as f32, weight: weight as f32, share: share as f32 }
        } else {
            Self::UNSEEN
        }
    }

    /// Returns whether there is a grey level to show.
    pub fn is_seen(&self) -> bool {
        f64::from(self.share) >= SEEN_SHARE
    }
}

/// Reason why no plane can be shown.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SectionError {
    /// A normal or upward direction of zero length, or not finite.
    #[error("the plane's {what} {x}, {y}, {z} is no direction: give three finite numbers that are not all 0", x = at.x, y = at.y, z = at.z)]
    Direction {
        /// Name of the direction.
        what: &'static str,
        /// The given value.
        at: DVec3,
    },
    /// The upward direction is parallel to the normal.
    #[error("the plane's upward direction lies along its normal: give another, or none")]
    Upright,
    /// A plane or a point outside the volume.
    #[error(
        "{what} misses the volume, which lies from {} to {} mm in the world: choose a point in it",
        numbers(*low), numbers(*high)
    )]
    Misses {
        /// The plane or the point, in words.
        what: String,
        /// Least coordinates of the volume's box, world mm.
        low: DVec3,
        /// Greatest coordinates, world mm.
        high: DVec3,
    },
    /// A picture without room for planes.
    #[error("a picture of {}×{} pixels has no room for three planes: each side must have at least 8 pixels", size[0], size[1])]
    Room {
        /// Pixels to the right and down.
        size: [u32; 2],
    },
}

/// Formats coordinates to a hundredth of a millimetre.
pub(crate) fn numbers(at: DVec3) -> String {
    at.to_array().map(|x| format!("{:.2}", x + 0.0)).join(", ")
}
