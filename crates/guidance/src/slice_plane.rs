//! A slice's plane with its data rectangle, and the positions of points relative to it.

use glam::{DAffine3, DMat3, DVec2, DVec3};

use mask::Mask;
use sonoweave_core::frames::{Image as ImageFrame, Transform, World};

/// A slice's plane. Positions in it are pixels (u, v) and the distance along the normal, mm.
#[derive(Debug, Clone, Copy)]
pub struct SlicePlane {
    world_from_plane: DAffine3,
    plane_from_world: DAffine3,
    corners: [DVec3; 4],
    middle: DVec3,
    pixel_mm: [f64; 2],
    /// The data rectangle: first and last column and row.
    columns: [f64; 2],
    rows: [f64; 2],
}

impl SlicePlane {
    /// Creates the plane; `None` for a degenerate pose, or an empty mask.
    pub fn new(world_from_image: Transform<World, ImageFrame>, mask: &Mask) -> Option<Self> {
        let affine = world_from_image.affine();
        let [u, v] = [affine.matrix3.x_axis, affine.matrix3.y_axis];
        let normal = u.cross(v).try_normalize()?;
        let world_from_plane = DAffine3 { matrix3: DMat3::from_cols(u, v, normal), translation: affine.translation };
        let plane_from_world = world_from_plane.inverse();
        let bounds = mask.bounds()?;
        let span = |first: u32, count: u32| [f64::from(first), f64::from(first + count - 1)];
        let (columns, rows) = (span(bounds.x, bounds.width), span(bounds.y, bounds.height));
        let at = |u: f64, v: f64| world_from_plane.transform_point3(DVec3::new(u, v, 0.0));
        let corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[u, v]| at(columns[u], rows[v]));
        let middle = at(0.5 * (columns[0] + columns[1]), 0.5 * (rows[0] + rows[1]));
        let pixel_mm = [u.length(), v.length()];
        (plane_from_world.is_finite() && world_from_plane.is_finite()).then_some(Self {
            world_from_plane,
            plane_from_world,
            corners,
            middle,
            pixel_mm,
            columns,
            rows,
        })
    }

    /// Returns the world position of a pixel, mm.
    pub fn world(&self, u: f64, v: f64) -> DVec3 {
        self.world_from_plane.transform_point3(DVec3::new(u, v, 0.0))
    }

    /// Returns the pixel and the distance along the normal of a world position.
    pub fn local(&self, world: DVec3) -> DVec3 {
        self.plane_from_world.transform_point3(world)
    }

    /// Returns the distance of a world position from the plane along its normal, mm.
    pub fn distance(&self, world: DVec3) -> f64 {
        self.plane_from_world.matrix3.row(2).dot(world) + self.plane_from_world.translation.z
    }

    /// Returns the unit normal, along u × v.
    pub fn normal(&self) -> DVec3 {
        self.world_from_plane.matrix3.z_axis
    }

    /// Returns the corners of the data rectangle in the world, in order from the first pixel
    /// along u.
    pub fn corners(&self) -> &[DVec3; 4] {
        &self.corners
    }

    /// Returns the middle of the data rectangle in the world.
    pub fn middle(&self) -> DVec3 {
        self.middle
    }

    /// Returns the first and last column of the data rectangle, and the first and last row.
    pub fn data(&self) -> [[f64; 2]; 2] {
        [self.columns, self.rows]
    }

    /// Returns the offset of a world position from the middle within the plane, along u and v,
    /// mm.
    pub fn beside(&self, world: DVec3) -> DVec2 {
        let at = self.local(world);
        let off = |axis: usize, [low, high]: [f64; 2]| (at[axis] - 0.5 * (low + high)) * self.pixel_mm[axis];
        DVec2::new(off(0, self.columns), off(1, self.rows))
    }

    /// Returns half the width and height of the data rectangle, mm.
    pub fn half_mm(&self) -> DVec2 {
        let half = |axis: usize, [low, high]: [f64; 2]| 0.5 * (high - low) * self.pixel_mm[axis];
        DVec2::new(half(0, self.columns), half(1, self.rows))
    }

    /// Returns whether a kernel of this reach covers a world position, mm: near the plane, and
    /// its foot on data.
    pub fn sees(&self, world: DVec3, reach_mm: f64, mask: &Mask) -> bool {
        let at = self.local(world);
        at.z.abs() <= reach_mm && holds(mask, at.x, at.y)
    }
}

/// Returns whether the pixel nearest to an image position is data.
pub fn holds(mask: &Mask, u: f64, v: f64) -> bool {
    let [u, v] = [u, v].map(f64::round);
    u >= 0.0 && v >= 0.0 && mask.contains(u as u32, v as u32)
}
