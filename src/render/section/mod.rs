//! Planes through a volume, and through the slices that it is made of.
//!
//! - [`plane`]: a plane in the world, the rectangle of it that meets a volume's box, and its pixels.
//! - [`layout`]: three planes at right angles in one picture.
//! - [`volume`]: what a volume holds in a plane; [`nearest`]: what the nearest slices hold there.
//! - [`mod@reference`]: both in the plainest way, the measure of them.
//!
//! Of the voxels about a place those that were seen have a say, each by its trilinear share times its weight: Σ s·w·v / Σ s·w. A place counts as seen where
//! seen voxels have half of the shares or more. So coverage ends half-way to the first unseen voxel, neither grown nor shrunk, and a voxel that was hardly
//! seen does not pull at one that was seen well.

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

/// From which part of the shares about it on a place was seen.
pub const SEEN_SHARE: f64 = 0.5;

/// What is known of a place in a plane.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sampled {
    /// The grey level; 0 where nothing was seen.
    pub value: f32,
    /// Σ s·w: the weight that the volume has there. Of a slice 1 or less: the share of data pixels.
    pub weight: f32,
    /// The share of seen voxels (of a slice: of data pixels) among those about the place, 0 to 1.
    pub share: f32,
}

impl Sampled {
    /// Nothing was seen.
    pub const UNSEEN: Self = Self { value: 0.0, weight: 0.0, share: 0.0 };

    /// From sums over the voxels about a place: Σ s·w·v and Σ s·w, and Σ s of those that were seen.
    pub(super) fn of(numerator: f64, weight: f64, share: f64) -> Self {
        if weight > 0.0 {
            Self { value: (numerator / weight) as f32, weight: weight as f32, share: share as f32 }
        } else {
            Self::UNSEEN
        }
    }

    /// Whether there is a grey level to be shown.
    pub fn is_seen(&self) -> bool {
        f64::from(self.share) >= SEEN_SHARE
    }
}

/// Why there is no plane to be shown.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SectionError {
    /// A normal or an upward direction without length, or one that is no number.
    #[error("the plane's {what} {x}, {y}, {z} is no direction: give three finite numbers that are not all 0", x = at.x, y = at.y, z = at.z)]
    Direction {
        /// Which.
        what: &'static str,
        /// As given.
        at: DVec3,
    },
    /// Upwards is out of the plane.
    #[error("the plane's upward direction lies along its normal: give another, or none")]
    Upright,
    /// A plane or a point beside the volume.
    #[error(
        "{what} misses the volume, which lies from {} to {} mm in the world: choose a point in it",
        numbers(*low), numbers(*high)
    )]
    Misses {
        /// The plane or the point, in words.
        what: String,
        /// Least coordinates of the volume's box, world mm.
        low: DVec3,
        /// Greatest.
        high: DVec3,
    },
    /// A picture without room for planes.
    #[error("a picture of {}×{} pixels has no room for three planes: each side needs at least 8 pixels", size[0], size[1])]
    Room {
        /// Pixels to the right and down.
        size: [u32; 2],
    },
}

/// Coordinates to a hundredth of a millimetre.
pub(crate) fn numbers(at: DVec3) -> String {
    at.to_array().map(|x| format!("{:.2}", x + 0.0)).join(", ")
}
