//! The plane of a scan: its lattice, the line in which a slice meets it, and the slice's
//! departure from it.

use glam::{DAffine3, DMat3, DVec2, DVec3};

use sonoweave_core::frames::{Image as ImageFrame, Transform, World};
use sonoweave_core::region::ClipRect;

use crate::Settings;
use crate::slab::Plane;

/// Default tolerance, voxels.
pub(super) const TOLERANCE_VOXELS: f64 = 0.25;

/// Handling of a slice, or a mask, that leaves the plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OnDeparture {
    /// It is refused.
    Refuse,
    /// The general path takes over the volume and continues.
    #[default]
    Upgrade,
}

/// The planar path's own settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanarSettings {
    /// The lattice's axes in the world as columns: z along image axis u. `None` takes them from
    /// the first slice: x along its image axis v, y = z × x.
    pub direction: Option<DMat3>,
    /// Tolerance for the image's corners, voxels; 0.25 by default. It is their largest distance
    /// from the position that a shift in the plane and a turn about its normal would give.
    pub tolerance_voxels: f64,
    /// Handling of slices beyond the tolerance.
    pub on_departure: OnDeparture,
}

impl Default for PlanarSettings {
    fn default() -> Self {
        Self { direction: None, tolerance_voxels: TOLERANCE_VOXELS, on_departure: OnDeparture::default() }
    }
}

/// The lattice of a scan and the position of its images along z, fixed by the first slice.
#[derive(Debug, Clone, Copy)]
pub(super) struct ScanPlane {
    /// The lattice's axes in the world.
    pub(super) direction: DMat3,
    lattice_from_world: DAffine3,
    spacing_mm: DVec3,
    /// First and last columns and rows of the data in the image, all inclusive.
    u: [f64; 2],
    v: [f64; 2],
    /// Lattice z of pixel column 0, and step from column to column.
    pub(super) z_first: f64,
    pub(super) z_step: f64,
}

/// The line of a slice in the plane: affine functions of a column's lattice indices, as value
/// at column (0, 0) and steps along x and y.
#[derive(Debug, Clone, Copy)]
pub(super) struct SliceLine {
    /// Row of the data, 0 at its first.
    pub(super) row: [f64; 3],
    /// Distance from the slice, mm.
    pub(super) distance: [f64; 3],
    /// Distance from row to row, mm.
    pub(super) row_mm: f64,
}

impl SliceLine {
    /// Returns the slice's normal along the lattice's axes.
    pub(super) fn normal(&self, spacing_mm: DVec3) -> DVec3 {
        let [_, x, y] = self.distance;
        DVec3::new(x, y, 0.0) / spacing_mm
    }
}

impl ScanPlane {
    /// Returns the plane of a slice, on a lattice whose direction is given or taken from the
    /// slice.
    pub(super) fn new(
        settings: &Settings,
        direction: Option<DMat3>,
        data: ClipRect,
        world_from_image: Transform<World, ImageFrame>,
    ) -> Self {
        let pose = world_from_image.affine();
        let direction = direction.unwrap_or_else(|| {
            let z = pose.matrix3.x_axis.normalize();
            let v = pose.matrix3.y_axis;
            let x = (v - z * v.dot(z)).normalize();
            DMat3::from_cols(x, z.cross(x), z)
        });
        let world_from_lattice = Settings { lattice_direction: direction, ..settings.clone() }.world_from_lattice();
        let lattice_from_world = world_from_lattice.inverse();
        let lattice_from_image = lattice_from_world * pose;
        let last = |first: u32, count: u32| [f64::from(first), f64::from(first + count - 1)];
        Self {
            direction,
            lattice_from_world,
            spacing_mm: settings.spacing_mm,
            u: last(data.x, data.width),
            v: last(data.y, data.height),
            z_first: lattice_from_image.translation.z,
            z_step: lattice_from_image.matrix3.x_axis.z,
        }
    }

    /// Distance from column to column, mm.
    pub(super) fn column_mm(&self) -> f64 {
        self.z_step * self.spacing_mm.z
    }

    /// Returns a slice's line in the plane, and the departure of its corners from it in voxels.
    /// The departure is the part of the pose that a shift in the plane and a turn about its
    /// normal cannot produce from the first slice.
    pub(super) fn meet(&self, world_from_image: Transform<World, ImageFrame>) -> (SliceLine, f64) {
        let image = self.lattice_from_world * world_from_image.affine();
        // The line of the slice in the plane is that of its middle column.
        let middle = 0.5 * (self.u[0] + self.u[1]);
        let start = (image.translation + image.matrix3.x_axis * middle).truncate();
        let step = image.matrix3.y_axis.truncate();
        let mut displacement = 0.0_f64;
        for u in self.u {
            for v in self.v {
                let there = image.transform_point3(DVec3::new(u, v, 0.0));
                let here = (start + step * v).extend(self.z_first + self.z_step * u);
                // `f64::max` would drop a NaN, but a finite pose gives none.
                displacement = displacement.max(there.distance(here));
            }
        }
        let scale = self.spacing_mm.truncate();
        let (origin, along) = (start * scale, step * scale);
        let row_mm = along.length();
        let along = along / row_mm;
        let across = DVec2::new(-along.y, along.x);
        let rows = along / row_mm;
        let slice_line = SliceLine {
            row: [-rows.dot(origin) - self.v[0], rows.x * scale.x, rows.y * scale.y],
            distance: [-across.dot(origin), across.x * scale.x, across.y * scale.y],
            row_mm,
        };
        (slice_line, displacement)
    }
}

/// Returns the pose that departs most from the plane of the first one: its index and its
/// departure. The departure is in voxels, at the corners of images of `size` pixels. `None`
/// without poses, or if the first spans no plane.
pub fn worst_departure(
    settings: &Settings,
    planar: &PlanarSettings,
    size: [u32; 2],
    poses: impl IntoIterator<Item = Transform<World, ImageFrame>>,
) -> Option<(usize, f64)> {
    // Poses that span no plane are refused on either path.
    let mut poses = poses.into_iter().enumerate().filter(|(i, pose)| *i == 0 || Plane::new(*pose).is_some()).peekable();
    let (_, first) = *poses.peek()?;
    let data = ClipRect::new(0, 0, size[0], size[1]).ok().filter(|_| Plane::new(first).is_some())?;
    let plane = ScanPlane::new(settings, planar.direction, data, first);
    poses.map(|(i, pose)| (i, plane.meet(pose).1)).max_by(|a, b| a.1.total_cmp(&b.1))
}
