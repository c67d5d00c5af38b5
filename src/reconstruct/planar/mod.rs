//! Slices that stay perpendicular to one plane, as a 3-DOF arm's do: they shift in it and turn about its normal, to which image axis u is parallel.
//!
//! The lattice's z is laid along u. A voxel's weight is then a product of one factor along z, the same for every slice, and one a column,
//! and the three-dimensional sum falls apart into a sum along u, once a slice, and one across it, a column at a time (Ohbuchi, Chen & Fuchs
//! 1992, section 4.1): a fraction of the general path's work on half its memory.
//!
//! In the order of the data:
//!
//! - `plane`: which plane it is, where a slice meets it, and what leaves it.
//! - `bands`: the sum along u, from pixels to lines of voxels.
//! - `table`: the kernel across the picture's rows and across the slice, as looked up by columns.
//! - `strip`: which columns a slice meets, and the sum across u: the hot loop.
//! - [`reconstructor`]: all of it behind `insert`.
//! - `upgrade`: what there is, taken over by the general path when a slice leaves the plane.
//! - [`reference`](mod@reference): the same sums voxel by voxel in f64.
//!
//! At the border of the data a column, and a stretch of z, takes part where a fifth of the kernel's own axis lies
//! on data. The general path asks the same of both axes' product: along straight borders the two agree, in the picture's corners this
//! path keeps a few voxels more.

mod bands;
mod plane;
pub mod reconstructor;
pub mod reference;
mod strip;
mod table;
mod upgrade;

#[cfg(test)]
mod tests;

pub use plane::{Departure, OnDeparture, PlanarSettings, worst_departure};
pub use reconstructor::PlanarReconstructor;
