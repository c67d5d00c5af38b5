//! The bricks that a slice's slab meets, and their overlap with the mask.
//!
//! The slab is the set of points whose plane distance is within the kernel's support and whose
//! foot lies in the image. Rows of bricks are clipped against its three pairs of faces (Kay &
//! Kajiya 1986). Each brick is then tested by interval arithmetic. The mask's summed areas tell
//! in a few look-ups whether a brick meets only data, some data, or none.

use glam::{DAffine3, DMat3, DVec3};

use sonoweave_core::frames::{Image as ImageFrame, Transform, World};
use volume::Prism;
use volume::brick::{BrickBox, BrickIndex, EDGE};

use super::nodes::Nodes;

/// A slice's plane, orthogonalised: pixel sizes along u and v, and the map from the world to (u
/// px, v px, plane distance mm).
pub(super) struct Plane {
    pub(super) pixel_mm: [f64; 2],
    pub(super) image_from_world: DAffine3,
}

impl Plane {
    /// Returns the plane of a pose; `None` when the pose is not finite or spans no plane. The
    /// plane's distance grows along u × v, whatever the pose's third column.
    pub(super) fn new(world_from_image: Transform<World, ImageFrame>) -> Option<Self> {
        let affine = world_from_image.affine();
        let [u, v] = [affine.matrix3.x_axis, affine.matrix3.y_axis];
        let normal = u.cross(v);
        if !affine.is_finite() || normal.length() <= 1e-9 * u.length() * v.length() || normal.length() < 1e-30 {
            return None;
        }
        let world_from_slab =
            DAffine3 { matrix3: DMat3::from_cols(u, v, normal.normalize()), translation: affine.translation };
        let image_from_world = world_from_slab.inverse();
        image_from_world.is_finite().then_some(Self { pixel_mm: [u.length(), v.length()], image_from_world })
    }
}

/// Least fraction of a voxel's in-plane kernel that must lie on data for the voxel to take
/// part. Beyond a straight border this is reached 0.84 σ outside. In a right-angled corner (a
/// quarter) all voxels on the data's side are kept.
pub(crate) const LEAST_CERTAINTY: f32 = 0.2;

/// Half a brick, from its centre to the centre of its outermost voxels.
const HALF: f64 = (EDGE as f64 - 1.0) / 2.0;
/// Widening of interval tests against rounding, in units of nodes and of σ.
const SLACK: f64 = 1e-3;

/// An affine function of voxel indices: value at voxel (0, 0, 0) of the lattice, and steps per
/// voxel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Affine {
    pub(crate) base: f64,
    pub(crate) step: DVec3,
}

impl Affine {
    fn at(&self, voxel: DVec3) -> f64 {
        self.base + self.step.dot(voxel)
    }

    /// Largest distance from the value at a brick's centre.
    fn radius(&self) -> f64 {
        HALF * (self.step.x.abs() + self.step.y.abs() + self.step.z.abs())
    }
}

/// Position of a slice in the lattice.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SlabGeometry {
    /// Node column, node row, and plane distance in σ.
    pub(crate) coordinates: [Affine; 3],
    /// Least and largest contributing value of each.
    pub(crate) limits: [[f64; 2]; 3],
}

/// Overlap of a brick with the slice's data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Overlap {
    /// The whole footprint is data.
    Full,
    /// The footprint is data in part.
    Partial,
}

/// Nodes along the edge of a square of the mask's summary. Small enough to follow a fan's
/// border, large enough for the summary to stay in the nearest cache while bricks are looked
/// up.
const SQUARE: usize = 4;

/// Summary of the mask for the walk. A table of sums gives two counts for any rectangle of
/// squares of nodes, in four look-ups: the squares with an uncertain node, and those with a live
/// one.
#[derive(Debug, Clone)]
pub(crate) struct MaskSummary {
    columns: i64,
    rows: i64,
    stride: usize,
    /// At (row, column): number of squares above and left of it with a node that is not wholly
    /// certain, and with one whose certainty suffices.
    sums: Vec<[u32; 2]>,
}

impl MaskSummary {
    pub(crate) fn new(certainty: &Nodes) -> Self {
        let squares = [certainty.columns, certainty.rows].map(|n| n.div_ceil(SQUARE));
        let stride = squares[0] + 1;
        let mut sums = vec![[0_u32; 2]; stride * (squares[1] + 1)];
        for row in 0..squares[1] {
            let mut line = [0, 0];
            for column in 0..squares[0] {
                let rows = row * SQUARE..((row + 1) * SQUARE).min(certainty.rows);
                let columns = column * SQUARE..((column + 1) * SQUARE).min(certainty.columns);
                let nodes = || rows.clone().flat_map(|r| &certainty.data[r * certainty.stride..][columns.clone()]);
                line[0] += u32::from(nodes().any(|c| *c != 1.0));
                line[1] += u32::from(nodes().any(|c| *c >= LEAST_CERTAINTY));
                let above = sums[row * stride + column + 1];
                sums[(row + 1) * stride + column + 1] = [above[0] + line[0], above[1] + line[1]];
            }
        }
        Self { columns: certainty.columns as i64, rows: certainty.rows as i64, stride, sums }
    }

    /// Returns the overlap of a footprint around node (u, v), given by its half widths, with
    /// the data; `None` when no voxel there can take part.
    fn overlap(&self, u: f64, v: f64, radius: [f64; 2]) -> Option<Overlap> {
        // Nodes whose splines reach into the footprint. Truncation equals rounding down where
        // it matters: a footprint that begins before node 1 is clamped to the border and counts
        // as not wholly inside.
        let (low_u, low_v) = (u - radius[0] - SLACK, v - radius[1] - SLACK);
        let (high_u, high_v) = ((u + radius[0] + SLACK) as i64 + 3, (v + radius[1] + SLACK) as i64 + 3);
        let inside = low_u >= 1.0 && low_v >= 1.0 && high_u <= self.columns && high_v <= self.rows;
        let squares = |low: f64, high: i64, most: i64| {
            let first = (low as i64 - 1).clamp(0, most) as usize / SQUARE;
            (first, (high.clamp(0, most) as usize).div_ceil(SQUARE).max(first))
        };
        let (left, right) = squares(low_u, high_u, self.columns);
        let (top, bottom) = squares(low_v, high_v, self.rows);
        let at = |row: usize, column: usize| self.sums[row * self.stride + column];
        let corners = [at(bottom, right), at(top, left), at(top, right), at(bottom, left)];
        let count = |which: usize| corners[0][which] + corners[1][which] - corners[2][which] - corners[3][which];
        if count(1) == 0 {
            None
        } else if inside && count(0) == 0 {
            Some(Overlap::Full)
        } else {
            Some(Overlap::Partial)
        }
    }
}

impl SlabGeometry {
    /// Returns the geometry of a slice. `image_from_voxel` maps voxel indices to (u px, v px,
    /// plane distance mm).
    pub(crate) fn new(
        image_from_voxel: DAffine3,
        certainty: &Nodes,
        step_px: [f64; 2],
        sigma_mm: f64,
        support_mm: f64,
    ) -> Self {
        let row = |axis: usize, scale: f64, shift: f64| Affine {
            base: image_from_voxel.translation[axis] * scale - shift,
            step: image_from_voxel.matrix3.row(axis) * scale,
        };
        let reach = support_mm / sigma_mm;
        Self {
            coordinates: [
                row(0, 1.0 / step_px[0], certainty.first[0] as f64),
                row(1, 1.0 / step_px[1], certainty.first[1] as f64),
                row(2, 1.0 / sigma_mm, 0.0),
            ],
            limits: [[1.0, certainty.columns as f64 - 3.0], [1.0, certainty.rows as f64 - 3.0], [-reach, reach]],
        }
    }

    /// Returns the bricks of the box around the slab; `None` when an index leaves the range of a
    /// brick's coordinates.
    pub(crate) fn brick_box(&self) -> Option<BrickBox> {
        let [u, v, q] = self.coordinates.map(|c| c.step);
        let matrix = DMat3::from_cols(u, v, q).transpose();
        let voxel_from_slab = matrix.inverse();
        let base = DVec3::new(self.coordinates[0].base, self.coordinates[1].base, self.coordinates[2].base);
        let mut low = DVec3::INFINITY;
        let mut high = DVec3::NEG_INFINITY;
        for corner in 0..8_usize {
            let at = |axis: usize| self.limits[axis][corner >> axis & 1];
            let voxel = voxel_from_slab * (DVec3::new(at(0), at(1), at(2)) - base);
            low = low.min(voxel);
            high = high.max(voxel);
        }
        let brick = |x: f64, widen: f64| {
            let index = ((x + widen) / EDGE as f64).floor();
            (index.abs() < f64::from(i32::MAX / EDGE as i32)).then_some(index as i32)
        };
        let ends =
            |ends: DVec3, widen: f64| Some([brick(ends.x, widen)?, brick(ends.y, widen)?, brick(ends.z, widen)?]);
        Some(BrickBox { low: ends(low, -1.0)?, high: ends(high, 1.0)? })
    }

    /// Returns the slab, around all contributing voxels; lattice indices.
    pub(crate) fn prism(&self) -> Option<Prism> {
        let limits = self.limits.map(|[low, high]| [low - SLACK, high + SLACK]);
        Prism::between(self.coordinates.map(|c| (c.base, c.step)), limits)
    }

    /// Calls `visit` for each brick that may hold voxels of the slab, in the order of the
    /// lattice, until it returns false.
    pub(crate) fn walk(
        &self,
        bricks: &BrickBox,
        mask: &MaskSummary,
        mut visit: impl FnMut(BrickIndex, Overlap) -> bool,
    ) {
        let edge = EDGE as f64;
        let radius = self.coordinates.map(|c| c.radius());
        let BrickBox { low: [first_x, first_y, first_z], high: [last_x, last_y, last_z] } = *bricks;
        for z in first_z..=last_z {
            for y in first_y..=last_y {
                let row_start = DVec3::new(HALF, f64::from(y) * edge + HALF, f64::from(z) * edge + HALF);
                let starts = self.coordinates.map(|c| c.at(row_start));
                let (mut first, mut last) = (f64::from(first_x), f64::from(last_x));
                for axis in 0..3 {
                    let step = self.coordinates[axis].step.x * edge;
                    let low = self.limits[axis][0] - radius[axis] - SLACK - starts[axis];
                    let high = self.limits[axis][1] + radius[axis] + SLACK - starts[axis];
                    if step.abs() < 1e-12 {
                        if low > 0.0 || high < 0.0 {
                            last = f64::NEG_INFINITY;
                        }
                    } else {
                        let (a, b) = (low / step, high / step);
                        first = first.max(a.min(b).ceil());
                        last = last.min(a.max(b).floor());
                    }
                }
                if first > last {
                    continue;
                }
                for x in first as i32..=last as i32 {
                    let along = f64::from(x) * edge;
                    let [u, v] = [0, 1].map(|axis| starts[axis] + self.coordinates[axis].step.x * along);
                    if let Some(overlap) = mask.overlap(u, v, [radius[0], radius[1]])
                        && !visit([x, y, z], overlap)
                    {
                        return;
                    }
                }
            }
        }
    }

    /// Returns the three functions within one brick: value at its first voxel and steps, in f32
    /// from a base computed in f64.
    pub(crate) fn in_brick(&self, brick: BrickIndex) -> [[f32; 4]; 3] {
        let origin = DVec3::from_array(brick.map(|b| f64::from(b) * EDGE as f64));
        self.coordinates.map(|c| [c.at(origin) as f32, c.step.x as f32, c.step.y as f32, c.step.z as f32])
    }
}
