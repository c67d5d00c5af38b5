//! A recorded sweep in regions of its volume, each reconstructed by itself: in less memory than
//! the whole takes, and in any process that has the plan.
//!
//! - [`plan`]: all decisions about the slices, taken once, in one pass over the recording.
//! - [`grid`]: the regions, boxes of bricks of one size.
//! - `reconstruct`: one region, from the slices that meet it. Its bricks have the bits of a
//!   reconstruction of the whole.
//!
//! Regions do not depend on each other: any number of them may run at once, in any order, and
//! again.

pub mod grid;
pub mod plan;
mod reconstruct;

pub use grid::{RegionGrid, TooSmall};
pub use plan::{PlannedSlice, SweepPlan};
