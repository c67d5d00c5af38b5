//! Reconstruction from slices that stay perpendicular to one plane, as those of a 3-DOF arm. They
//! shift in the plane and turn about its normal, which is parallel to image axis u.
//!
//! The lattice's z is laid along u. A voxel's weight is then a product of one factor along z,
//! the same for every slice, and one per column. The three-dimensional sum separates into a sum
//! along u, once per slice, and one across it, column by column (Ohbuchi, Chen & Fuchs 1992,
//! section 4.1). This takes a fraction of the general path's work and half its memory.
//!
//! In the order of the data:
//!
//! - `plane`: the scan's plane, the line in which a slice meets it, and departures from it.
//! - `departure`: reasons why a slice or mask does not fit the plane.
//! - `bands`: the sum along u, from pixels to lines of voxels.
//! - `table`: the kernel across the image's rows and across the slice, as tables for columns.
//! - `strip`: the columns that a slice meets, and the sum across u: the hot loop.
//! - [`reconstructor`]: all of it behind `insert`.
//! - `upgrade`: transfer to the general path when a slice leaves the plane.
//! - [`reference`](mod@reference): the same sums voxel by voxel in f64.
//!
//! At the border of the data, a column or a range of z takes part if a fifth of the kernel's
//! own axis lies on data. The general path requires the same of the product of both axes. Along
//! straight borders the two agree; in the image's corners this path keeps a few voxels more.

mod bands;
mod departure;
mod plane;
pub mod reconstructor;
pub mod reference;
mod strip;
mod table;
mod upgrade;

#[cfg(test)]
mod tests;

pub use departure::Departure;
pub use plane::{OnDeparture, PlanarSettings, worst_departure};
pub use reconstructor::PlanarReconstructor;
