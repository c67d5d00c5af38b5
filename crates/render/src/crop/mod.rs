//! Parts of the volume that are hidden from view.
//!
//! Each operation of a crop hides a part of space. A hidden voxel is read as if it had not been
//! seen, so that all pictures, from scratch or after a slice, treat a cut like the end of coverage:
//! it is neither a surface nor a rim. The volume itself stays as it is.
//!
//! - [`Crop`]: operations, in their order; the last one can be undone.
//! - [`file`](mod@file): crops as files.
//! - `shape`: whether a point, or all of a ball, is hidden.
//! - [`Cropped`]: a volume without its hidden voxels.

mod cropped;
pub mod file;
mod shape;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::error::RenderError;
pub use cropped::{Cropped, LatticeCrop};

/// Most operations of a crop.
pub const MOST_OPERATIONS: usize = 1000;
/// Most corners of a lasso.
pub const MOST_CORNERS: usize = 512;

/// Hides a part of space from view; points and lengths in mm of the world.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "hide", rename_all = "snake_case", deny_unknown_fields)]
pub enum Operation {
    /// All outside of a box along the world's axes.
    OutsideBox {
        /// Its smallest coordinates.
        low: [f64; 3],
        /// Its largest.
        high: [f64; 3],
    },
    /// The side of a plane to which its normal points.
    BeyondPlane {
        /// A point of the plane.
        point: [f64; 3],
        /// Its normal, of any length.
        normal: [f64; 3],
    },
    /// All before a curved surface, as from the probe: a sheet with nine heights.
    BeforeSurface {
        /// The sheet's first corner.
        origin: [f64; 3],
        /// From there along the sheet's first edge, and its length.
        across: [f64; 3],
        /// The same along its second edge.
        along: [f64; 3],
        /// Heights above the sheet in the direction across × along: rows along the second edge,
        /// at its beginning, middle and end. Between them the surface is quadratic along each
        /// edge; beyond the sheet its border continues.
        heights: [[f64; 3]; 3],
    },
    /// A ball.
    Ball {
        /// Its centre.
        centre: [f64; 3],
        /// Its radius.
        radius: f64,
    },
    /// All inside, or all outside, of an outline that was drawn on a picture.
    Lasso {
        /// The place of the point (0, 0) of the outline's plane.
        origin: [f64; 3],
        /// The direction of its first coordinate.
        right: [f64; 3],
        /// The direction of its second coordinate.
        down: [f64; 3],
        /// The distance of the eye before the plane; without it, rays are parallel.
        #[serde(default)]
        eye: Option<f64>,
        /// Corners of the outline in that plane. Where it crosses itself, parts enclosed an even
        /// number of times are outside.
        outline: Vec<[f64; 2]>,
        /// Whether what is outside is hidden instead.
        #[serde(default)]
        outside: bool,
        /// The depth behind the plane at which hiding ends; through all without it.
        #[serde(default)]
        depth: Option<f64>,
    },
    /// Nothing: all operations before it have no effect any more.
    Nothing {},
}

/// Operations that hide parts of the volume, in their order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Crop {
    operations: Arc<Vec<Operation>>,
}

impl Crop {
    /// Returns the crop of these operations.
    ///
    /// # Errors
    /// [`RenderError::Crop`] with the number of the first impossible one, from 1.
    pub fn new(operations: Vec<Operation>) -> Result<Self, RenderError> {
        if operations.len() > MOST_OPERATIONS {
            let problem = "there may be 1000 operations at most; undo some, or begin again";
            return Err(RenderError::Crop { number: MOST_OPERATIONS + 1, problem });
        }
        for (operation, number) in operations.iter().zip(1..) {
            operation.check().map_err(|problem| RenderError::Crop { number, problem })?;
        }
        Ok(Self { operations: Arc::new(operations) })
    }

    /// Returns all operations.
    pub fn operations(&self) -> &[Operation] {
        &self.operations
    }

    /// Returns the operations that have an effect: those after the last that shows all.
    pub fn present(&self) -> &[Operation] {
        let shown = self.operations.iter().rposition(|operation| matches!(operation, Operation::Nothing {}));
        &self.operations[shown.map_or(0, |last| last + 1)..]
    }

    /// Returns the present operations that only this crop has, and those that only the other has.
    pub(crate) fn differing<'a>(&'a self, other: &'a Self) -> [&'a [Operation]; 2] {
        let (own, other) = (self.present(), other.present());
        let common = own.iter().zip(other).take_while(|(a, b)| a == b).count();
        [&own[common..], &other[common..]]
    }

    /// Returns the crop with one more operation.
    ///
    /// # Errors
    /// [`RenderError::Crop`] if it is impossible, or there are too many.
    pub fn with(&self, operation: Operation) -> Result<Self, RenderError> {
        Self::new(self.operations.iter().cloned().chain([operation]).collect())
    }

    /// Returns the crop without its last operation; `None` if there is none.
    #[must_use]
    pub fn undone(&self) -> Option<Self> {
        let (_, before) = self.operations.split_last()?;
        Some(Self { operations: Arc::new(before.to_vec()) })
    }
}

impl Operation {
    /// Returns the reason why it is impossible.
    fn check(&self) -> Result<(), &'static str> {
        let finite = |points: &[[f64; 3]]| points.iter().flatten().all(|x| x.is_finite());
        let is_right = match self {
            Self::OutsideBox { low, high } => {
                if finite(&[*low, *high]) && (0..3).all(|a| low[a] < high[a]) {
                    return Ok(());
                }
                return Err("a box needs three finite coordinates, each of low below that of high");
            }
            Self::BeyondPlane { point, normal } => {
                if finite(&[*point, *normal]) && DVec3::from(*normal).try_normalize().is_some() {
                    return Ok(());
                }
                return Err("a plane needs a finite point, and a normal that is not 0");
            }
            Self::BeforeSurface { origin, across, along, heights } => {
                let normal = DVec3::from(*across).cross(DVec3::from(*along));
                if finite(&[*origin, *across, *along]) && finite(heights) && normal.try_normalize().is_some() {
                    return Ok(());
                }
                return Err("a surface needs finite numbers, and edges that are not parallel");
            }
            Self::Ball { centre, radius } => finite(&[*centre]) && radius.is_finite() && *radius > 0.0,
            Self::Lasso { origin, right, down, eye, outline, depth, .. } => {
                let numbers = eye.iter().chain(depth).chain(outline.iter().flatten());
                let normal = DVec3::from(*right).cross(DVec3::from(*down));
                let is_finite = finite(&[*origin, *right, *down]) && numbers.clone().all(|x| x.is_finite());
                if !(is_finite && normal.try_normalize().is_some() && eye.is_none_or(|eye| eye > 0.0)) {
                    return Err("a lasso needs finite numbers, directions that are not parallel, and an eye before it");
                }
                if !(3..=MOST_CORNERS).contains(&outline.len()) {
                    return Err("a lasso needs an outline of 3 to 512 corners");
                }
                return Ok(());
            }
            Self::Nothing {} => true,
        };
        if is_right { Ok(()) } else { Err("a ball needs a finite centre, and a radius above 0") }
    }
}
