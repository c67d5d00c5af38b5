//! A plane in the world, and its visible pixels.

use glam::{DAffine3, DMat3, DVec3};

use sonoweave_core::frames::{Transform, Volume, World};

use super::{SectionError, numbers};

/// For normals closer to the world's z axis than this (cosine), the world's +y is up in the
/// picture instead of its +z.
const STEEP: f64 = 0.999;

/// A plane, viewed from the side its normal points to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// A point on it, world mm.
    pub point: DVec3,
    /// Unit vector towards the viewer.
    pub normal: DVec3,
    /// Unit vector to the right in the picture.
    pub right: DVec3,
    /// Unit vector down in the picture.
    pub down: DVec3,
}

impl Plane {
    /// Creates a plane through a point. `up` need not lie in it; if `None`, the world's +z is
    /// up, and in planes across z the world's +y.
    ///
    /// # Errors
    /// [`SectionError`] for a point or directions that are not finite, for zero directions, and
    /// for an `up` parallel to the normal.
    pub fn new(point: DVec3, normal: DVec3, up: Option<DVec3>) -> Result<Self, SectionError> {
        let direction = |what: &'static str, v: DVec3| {
            // Very short and very long vectors are valid directions too.
            let largest = v.abs().max_element();
            let unit = (v / largest).try_normalize();
            unit.filter(|_| v.is_finite() && largest > 0.0).ok_or(SectionError::Direction { what, at: v })
        };
        if !point.is_finite() {
            return Err(SectionError::Direction { what: "point", at: point });
        }
        let normal = direction("normal", normal)?;
        let up = match up {
            Some(up) => direction("upward direction", up)?,
            None if normal.z.abs() > STEEP => DVec3::Y,
            None => DVec3::Z,
        };
        let right = up.cross(normal);
        if right.length() < 1e-6 {
            return Err(SectionError::Upright);
        }
        let right = right.normalize();
        Ok(Self { point, normal, right, down: right.cross(normal) })
    }

    /// Returns the range along `right` and along `down` where the plane meets a volume's box, mm
    /// from its point.
    fn extent(&self, volume: &Box3) -> Result<[[f64; 2]; 2], SectionError> {
        let cut = volume.cut(self);
        if cut.is_empty() {
            let what = format!("the plane through {} mm across {}", numbers(self.point), numbers(self.normal));
            let [low, high] = volume.world_bounds();
            return Err(SectionError::Misses { what, low, high });
        }
        let along = |axis: DVec3| {
            let places = cut.iter().map(|p| (*p - self.point).dot(axis));
            places.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)])
        };
        Ok([along(self.right), along(self.down)])
    }

    /// Returns the rectangle that contains the plane's intersection with a volume's box, centred
    /// in `size` pixels, as large as it fits.
    ///
    /// # Errors
    /// [`SectionError::Misses`] if there is no intersection.
    pub fn fit(&self, volume: &Box3, size: [u32; 2]) -> Result<Section, SectionError> {
        let [[u0, u1], [v0, v1]] = self.extent(volume)?;
        let [width, height] = size.map(f64::from);
        // A plane that only touches the box has no extent; a thousandth of the box is shown
        // about it.
        let least = 1e-3 * volume.diagonal_mm();
        let mm = ((u1 - u0).max(least) / width).max((v1 - v0).max(least) / height);
        Ok(self.about([0.5 * (u0 + u1), 0.5 * (v0 + v1)], mm, size))
    }

    /// Returns the pixels that cover the plane's intersection with a volume's box. A pixel
    /// measures `least_mm`, or more if a side would exceed `most_px` pixels.
    ///
    /// # Errors
    /// [`SectionError::Misses`] if there is no intersection.
    pub fn cover(&self, volume: &Box3, least_mm: f64, most_px: u32) -> Result<Section, SectionError> {
        let [[u0, u1], [v0, v1]] = self.extent(volume)?;
        let most = most_px.max(1);
        let mm = least_mm.max((u1 - u0).max(v1 - v0) / f64::from(most));
        // If a side is a whole number of pixels, rounding must not add another one.
        let pixels = |mm_long: f64| ((mm_long / mm - 1e-6).ceil().max(1.0) as u32).min(most);
        Ok(self.about([0.5 * (u0 + u1), 0.5 * (v0 + v1)], mm, [pixels(u1 - u0), pixels(v1 - v0)]))
    }

    /// Returns `size` pixels about a place of the plane, given in mm from its point to the right
    /// and down.
    fn about(&self, [u, v]: [f64; 2], mm: f64, size: [u32; 2]) -> Section {
        let [width, height] = size.map(f64::from);
        let middle = self.point + self.right * u + self.down * v;
        let first = middle - self.right * (0.5 * mm * (width - 1.0)) - self.down * (0.5 * mm * (height - 1.0));
        Section { first, right: self.right * mm, down: self.down * mm, size }
    }
}

/// Pixels in a plane: the centre of pixel (i, j) lies at `first` + i·`right` + j·`down`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Section {
    /// Centre of pixel (0, 0), world mm.
    pub first: DVec3,
    /// Step from one pixel to the next on its right, world mm.
    pub right: DVec3,
    /// Step from one pixel to the one below, world mm; the length equals that of `right`.
    pub down: DVec3,
    /// Pixels to the right and down.
    pub size: [u32; 2],
}

impl Section {
    /// Returns the world position of a pixel's centre, mm.
    #[inline]
    pub fn at(&self, i: u32, j: u32) -> DVec3 {
        self.first + self.right * f64::from(i) + self.down * f64::from(j)
    }

    /// Returns the edge length of a pixel, mm.
    pub fn mm_per_px(&self) -> f64 {
        self.right.length()
    }

    /// Returns the total number of pixels.
    pub fn pixels(&self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }

    /// Returns the pixels `[from, to)` of a row at which an affine function lies between `low`
    /// and `high`. The function is `at` at the row's first pixel and grows by `step` a pixel.
    /// One pixel is added on both sides, so that rounding loses none.
    pub(super) fn between(range: [u32; 2], at: f64, step: f64, low: f64, high: f64) -> [u32; 2] {
        let [from, to] = range;
        let slack = 1e-9 * (1.0 + at.abs() + low.abs().max(high.abs()));
        let (low, high) = (low - slack, high + slack);
        if step.abs() * f64::from(to) <= slack {
            // The function is constant along the row.
            return if at + step.abs() * f64::from(to) < low || at - step.abs() * f64::from(to) > high {
                [from, from]
            } else {
                range
            };
        }
        let (one, other) = ((low - at) / step, (high - at) / step);
        let (enter, leave) = (one.min(other).floor() - 1.0, one.max(other).ceil() + 2.0);
        // Casts saturate; NaN becomes 0, and the range empty.
        let (enter, leave) = (from.max(enter.max(0.0) as u32), to.min(leave.max(0.0) as u32));
        if enter < leave { [enter, leave] } else { [from, from] }
    }
}

/// The box of a volume's voxels, including half a voxel around it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Box3 {
    /// Voxel indices to world mm.
    pub world_from_lattice: DAffine3,
    /// First voxel.
    pub low: [i64; 3],
    /// Last voxel.
    pub high: [i64; 3],
}

impl Box3 {
    /// Creates the box of the voxels `low` to `high`, both inclusive, of a lattice.
    pub fn new(world_from_lattice: Transform<World, Volume>, [low, high]: [[i64; 3]; 2]) -> Self {
        Self { world_from_lattice: world_from_lattice.affine(), low, high }
    }

    /// Returns the transform from world mm to voxel indices.
    pub fn lattice_from_world(&self) -> DAffine3 {
        self.world_from_lattice.inverse()
    }

    /// Returns a corner, by the bits of its number: x, y, z; world mm.
    fn corner(&self, number: usize) -> DVec3 {
        self.world_from_lattice.transform_point3(DVec3::from_array(std::array::from_fn(|a| match number >> a & 1 {
            0 => self.low[a] as f64 - 0.5,
            _ => self.high[a] as f64 + 0.5,
        })))
    }

    /// Returns all corners, world mm.
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|n| self.corner(n))
    }

    /// Returns its middle, world mm.
    pub fn middle(&self) -> DVec3 {
        0.5 * (self.corner(0) + self.corner(7))
    }

    /// Returns the length of its diagonal, mm.
    pub fn diagonal_mm(&self) -> f64 {
        (self.corner(7) - self.corner(0)).length()
    }

    /// Returns the least and greatest world coordinates, mm.
    pub fn world_bounds(&self) -> [DVec3; 2] {
        let corners = self.corners();
        [corners.iter().copied().fold(corners[0], DVec3::min), corners.iter().copied().fold(corners[0], DVec3::max)]
    }

    /// Returns orthonormal directions along its axes in the world, each as close to its axis as
    /// the earlier ones allow.
    pub fn directions(&self) -> [DVec3; 3] {
        let basis = basis(self.world_from_lattice.matrix3);
        [basis.x_axis, basis.y_axis, basis.z_axis]
    }

    /// Returns the points where a plane crosses the box's edges: the corners of the
    /// intersection.
    fn cut(&self, plane: &Plane) -> Vec<DVec3> {
        let corners = self.corners();
        let off = corners.map(|c| (c - plane.point).dot(plane.normal));
        // A plane that lies in a face meets it.
        let flat = 1e-9 * self.diagonal_mm();
        let mut cut = Vec::new();
        for from in 0..8_usize {
            if off[from].abs() <= flat {
                cut.push(corners[from]);
            }
            for axis in 0..3 {
                let to = from | 1 << axis;
                if to != from && (off[from] < 0.0) != (off[to] < 0.0) {
                    cut.push(corners[from].lerp(corners[to], off[from] / (off[from] - off[to])));
                }
            }
        }
        cut
    }
}

/// Returns orthonormal directions along the columns of a matrix, each as close to its column as
/// the earlier ones allow.
pub(super) fn basis(matrix: DMat3) -> DMat3 {
    let x = matrix.x_axis.normalize();
    let y = (matrix.y_axis - x * matrix.y_axis.dot(x)).normalize();
    let z = matrix.z_axis - x * matrix.z_axis.dot(x) - y * matrix.z_axis.dot(y);
    DMat3::from_cols(x, y, z.normalize())
}
