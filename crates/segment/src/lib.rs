//! Regions of a volume: the voxels that a seed reaches, and bodies between contours on planes.
//!
//! - [`region`]: the region that grows from a seed.
//! - [`contours`]: closed curves on planes, in the order of a sweep; their files.
//! - [`body`]: the body between contours, as signed distances.
//! - [`planimetry`]: the volume between contours by their areas, without the body.
//! - [`label`]: values of label volumes.
//! - [`field`]: a box of voxels, and values on it.
//! - `flood`: voxels within a range that are connected with a seed, brick by brick.
//! - `smoothing`: smoothed values of bricks.
//! - `distance`: distances between voxels, and the opening of a set of voxels.
//! - `contour`, `polygon`, `spline`: one contour, its polygon, and the curve through its points.
//! - `cubic`: cubic interpolation between unequal steps.

pub mod body;
pub mod contour;
pub mod contours;
mod contours_file;
mod cubic;
mod distance;
mod error;
pub mod field;
mod flood;
pub mod label;
pub mod planimetry;
mod polygon;
pub mod region;
mod smoothing;
mod spline;
#[cfg(test)]
mod tests;

pub use body::Body;
pub use contours::Contours;
pub use error::SegmentError;
pub use region::{Growth, Region};
