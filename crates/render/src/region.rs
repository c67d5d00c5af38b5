//! The render region: a box on the volume's lattice. The volume grows inside it; a renderer takes
//! a wider one by [`Renderer::widen`](super::Renderer::widen).

use glam::{DAffine3, DVec3};

use sonoweave_core::frames::{Transform, Volume, World};
use volume::brick::{BrickIndex, EDGE};

use super::error::RenderError;

/// Largest number of bricks in a region's table: 2 GiB of entries.
const MOST_BRICKS: u64 = 1 << 29;

/// A box of voxels and its position. Region coordinates are voxel indices from the corner of its
/// first brick, at voxel centres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderRegion {
    /// Lattice indices of the box, both inclusive.
    low: [i64; 3],
    high: [i64; 3],
    /// Lattice index of the first voxel of the first brick.
    first: [i64; 3],
    /// Bricks along each axis, one more on each side than the box meets, because samples reach
    /// half a cell beyond it.
    bricks: [u32; 3],
    world_from_region: DAffine3,
    world_from_lattice: DAffine3,
}

impl RenderRegion {
    /// Creates the box of voxels `low` to `high`, both inclusive, of a lattice.
    ///
    /// # Errors
    /// [`RenderError::Box`] if it is empty, too large for a table of its bricks, or too far from
    /// the lattice's origin.
    pub fn new(
        world_from_lattice: Transform<World, Volume>,
        low: [i64; 3],
        high: [i64; 3],
    ) -> Result<Self, RenderError> {
        let wrong = || RenderError::Box { low, high };
        let edge = EDGE as i64;
        let far = i64::from(i32::MAX) - 64;
        if (0..3).any(|a| low[a] > high[a] || low[a] < -far || high[a] > far) {
            return Err(wrong());
        }
        let first: [i64; 3] = std::array::from_fn(|a| (low[a].div_euclid(edge) - 1) * edge);
        let bricks: [u32; 3] = std::array::from_fn(|a| (high[a].div_euclid(edge) + 2 - first[a] / edge) as u32);
        if bricks.iter().map(|b| u64::from(*b)).product::<u64>() > MOST_BRICKS {
            return Err(wrong());
        }
        let lattice = world_from_lattice.affine();
        let world_from_region = DAffine3 {
            matrix3: lattice.matrix3,
            translation: lattice.transform_point3(DVec3::from_array(first.map(|x| x as f64))),
        };
        if !(world_from_region.is_finite() && world_from_region.matrix3.determinant() != 0.0) {
            return Err(wrong());
        }
        Ok(Self { low, high, first, bricks, world_from_region, world_from_lattice: lattice })
    }

    /// Returns the map from lattice indices to world mm, the same for all boxes of a lattice.
    pub(super) fn world_from_lattice(&self) -> DAffine3 {
        self.world_from_lattice
    }

    /// Returns the lattice indices of the box's first and last voxel.
    pub fn bounds(&self) -> [[i64; 3]; 2] {
        [self.low, self.high]
    }

    /// Returns the lattice index of region coordinate 0.
    pub fn first(&self) -> [i64; 3] {
        self.first
    }

    /// Returns the number of bricks along each axis.
    pub fn bricks(&self) -> [u32; 3] {
        self.bricks
    }

    /// Returns how many bricks another region begins beyond this one. `None` unless this one holds
    /// it, both are of one lattice, and no brick has voxels that are only in this one: they were
    /// not read.
    pub(super) fn place_of(&self, other: &Self) -> Option<[i64; 3]> {
        let edge = EDGE as i64;
        let matrix = |of: &Self| of.world_from_region.matrix3.to_cols_array().map(f64::to_bits);
        let aligned = |at: i64| at.rem_euclid(edge) == 0;
        let holds = |a: usize| {
            let [low, high] = [[self.low[a], other.low[a]], [self.high[a], other.high[a]]];
            (low[0] == low[1] || low[0] < low[1] && aligned(low[1]))
                && (high[0] == high[1] || high[0] > high[1] && aligned(high[1] + 1))
        };
        let by: [i64; 3] = std::array::from_fn(|a| (other.first[a] - self.first[a]) / edge);
        // If the lattice is the same, the first voxels lie where they are expected.
        let at =
            |by: [i64; 3]| self.world_from_region.transform_point3(DVec3::from_array(by.map(|by| (by * edge) as f64)));
        let apart = at(by).distance(other.world_from_region.translation);
        let is_one = matrix(self) == matrix(other) && apart <= 1e-6 * self.spacing_mm().min_element();
        (is_one && (0..3).all(holds)).then_some(by)
    }

    /// Returns whether a brick, by lattice index divided by 8, is one of the region's.
    pub fn holds(&self, brick: BrickIndex) -> bool {
        self.place(brick).is_some()
    }

    /// Returns the place of a brick among the region's; `None` if it is none of them.
    pub(super) fn place(&self, brick: BrickIndex) -> Option<[i64; 3]> {
        let at: [i64; 3] = std::array::from_fn(|a| i64::from(brick[a]) - self.first[a] / EDGE as i64);
        (0..3).all(|a| (0..i64::from(self.bricks[a])).contains(&at[a])).then_some(at)
    }

    /// Returns the transform from region coordinates to world mm.
    pub fn world_from_region(&self) -> DAffine3 {
        self.world_from_region
    }

    /// Returns the transform from world mm to region coordinates.
    pub fn region_from_world(&self) -> DAffine3 {
        self.world_from_region.inverse()
    }

    /// Returns the voxel spacing, mm.
    pub fn spacing_mm(&self) -> DVec3 {
        let axes = self.world_from_region.matrix3;
        DVec3::new(axes.x_axis.length(), axes.y_axis.length(), axes.z_axis.length())
    }

    /// Returns the region coordinates of the box's corners.
    fn corners(&self) -> [DVec3; 2] {
        [self.low, self.high].map(|at| DVec3::from_array(std::array::from_fn(|a| (at[a] - self.first[a]) as f64)))
    }

    /// Returns the middle of the box in the world, mm.
    pub fn centre_mm(&self) -> DVec3 {
        let [low, high] = self.corners();
        self.world_from_region.transform_point3(0.5 * (low + high))
    }

    /// Returns the vectors from the middle to four corners of the box and a voxel around it, one
    /// of each diagonal; world axes, mm.
    pub fn diagonals_mm(&self) -> [DVec3; 4] {
        let [low, high] = self.corners();
        let half = 0.5 * (high - low) + DVec3::ONE;
        [[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, -1.0]]
            .map(|sign| self.world_from_region.transform_vector3(half * DVec3::from_array(sign)))
    }

    /// Returns the radius of the sphere about the middle that holds the box and a voxel around
    /// it, mm.
    pub fn radius_mm(&self) -> f64 {
        // In our volumes the axes are perpendicular; in a foreign one the longest diagonal
        // decides.
        self.diagonals_mm().map(DVec3::length).into_iter().fold(0.0, f64::max)
    }
}
