//! The camera: the rays of a picture, in lattice coordinates.

use glam::{DAffine3, DVec3};

use super::error::RenderError;
use super::region::RenderRegion;
pub use super::view::{MOST_PIXELS, MOST_SAMPLES, View};

/// Largest zoom either way, as a power of two: a factor of about a thousand.
pub const MOST_ZOOM: f64 = 10.0;

/// Unit direction vectors of a view in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axes {
    /// To the right in the picture.
    pub right: DVec3,
    /// Upwards in the picture.
    pub up: DVec3,
    /// Into the picture.
    pub forward: DVec3,
}

impl View {
    /// Returns the directions of the picture.
    pub fn axes(&self) -> Axes {
        // libm gives the same results on every machine.
        let [(sa, ca), (se, ce), (sr, cr)] =
            [self.azimuth, self.elevation, self.roll].map(|degrees: f64| libm::sincos(degrees.to_radians()));
        let forward = DVec3::new(-sa * ce, ca * ce, -se);
        let right = DVec3::new(ca, sa, 0.0);
        let up = right.cross(forward);
        Axes { right: right * cr - up * sr, up: up * cr + right * sr, forward }
    }

    /// Returns a view, in whole degrees, of a volume whose slices lie along mean directions u
    /// and v; v points away from the probe.
    ///
    /// Tissue next to the probe is bright and hides the tissue behind it, and bone casts a
    /// shadow. The camera therefore looks from the deep side, 60° out of the plane across the
    /// beams and 20° to the side. The probe is on top, as scanners draw it. If the slice
    /// directions are unknown, it looks from the front, 30° to the side and 20° above.
    pub fn of_slices(axes: Option<[DVec3; 2]>) -> Self {
        let Some([u, v]) = axes else { return Self { azimuth: 30.0, elevation: 20.0, ..Self::default() } };
        let along = u.cross(v).normalize_or_zero();
        let (aside, ca) = libm::sincos(20.0_f64.to_radians());
        let (against, across) = libm::sincos(60.0_f64.to_radians());
        let forward = -v * against - (along * ca + u * aside) * across;
        let level = Self::along(forward, DVec3::Z);
        let level = Self { azimuth: level.azimuth.round(), elevation: level.elevation.round(), ..Self::default() };
        let Axes { right, up, .. } = level.axes();
        Self { roll: libm::atan2(-v.dot(right), -v.dot(up)).to_degrees().round(), ..level }
    }

    /// Returns the view in direction `forward`, whose upward direction is as near to `up` as
    /// possible. Neither may be zero, nor may they be parallel.
    pub fn along(forward: DVec3, up: DVec3) -> Self {
        let forward = forward.normalize_or_zero();
        let elevation = libm::asin((-forward.z).clamp(-1.0, 1.0));
        let azimuth = libm::atan2(-forward.x, forward.y);
        let [azimuth, elevation] = [azimuth, elevation].map(f64::to_degrees);
        let level = Self { azimuth, elevation, ..Self::default() };
        let Axes { right, up: above, .. } = level.axes();
        Self { roll: libm::atan2(up.dot(right), up.dot(above)).to_degrees(), ..level }
    }

    fn check(&self) -> Result<(), RenderError> {
        let angles = [self.azimuth, self.elevation, self.roll];
        let perspective = self.perspective.unwrap_or(1.0);
        let sees = perspective > 0.0 && perspective <= 170.0;
        let is_near = self.zoom.abs() <= MOST_ZOOM && self.aim.is_none_or(|aim| aim.is_finite() && aim.length() <= 1e6);
        if angles.iter().all(|a| a.is_finite() && a.abs() <= 1e6) && sees && is_near {
            return Ok(());
        }
        Err(RenderError::View { view: *self })
    }
}

/// The rays of a picture of a render region: pixel (i, j) has i to the right and j down. Samples
/// are `step_mm` apart along each ray. Sample `k` of all rays lies in one plane (parallel) or at
/// one distance from the eye (perspective), whatever the volume holds.
#[derive(Debug, Clone, Copy)]
pub struct Camera {
    size: [u32; 2],
    axes: Axes,
    perspective: bool,
    samples: u32,
    step_mm: f64,
    /// The first sample of pixel (0, 0), or the eye; lattice coordinates of the render region.
    origin: DVec3,
    /// Offsets per pixel to the right and down, and to the first sample of a ray (perspective:
    /// to a point at distance 1 along the axis); lattice coordinates.
    right: DVec3,
    down: DVec3,
    forward: DVec3,
    /// Distance of the eye from the first sample, mm.
    near_mm: f64,
    region_from_world: DAffine3,
    /// Scale from pixel offsets to world directions, perspective.
    pixel: f64,
}

/// One ray in lattice coordinates of the render region: sample k lies at `base + k·step`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Sample 0.
    pub base: DVec3,
    /// Step from one sample to the next.
    pub step: DVec3,
}

impl Camera {
    /// Creates a camera aimed at the middle of a render region that shows all of it, unless the
    /// view says otherwise. Samples are `step` times the finest voxel spacing apart.
    ///
    /// # Errors
    /// [`RenderError`] for an invalid view or step, for pictures without pixels or beyond
    /// [`MOST_PIXELS`] a side, and for a step that needs more than [`MOST_SAMPLES`] samples.
    pub fn new(view: &View, size: [u32; 2], step: f64, region: &RenderRegion) -> Result<Self, RenderError> {
        view.check()?;
        if size.iter().any(|s| *s == 0 || *s > MOST_PIXELS) {
            return Err(RenderError::Size { size });
        }
        let step_mm = step * region.spacing_mm().min_element();
        let radius = region.radius_mm();
        let samples = (2.0 * radius / step_mm).ceil() + 1.0;
        if !(step > 0.0 && step.is_finite() && samples <= f64::from(MOST_SAMPLES)) {
            return Err(RenderError::Step { step, samples });
        }
        let axes = view.axes();
        // An offset of the picture's middle does not move the start and end of the rays in
        // depth.
        let aside = view.aim.map_or(DVec3::ZERO, |aim| aim - region.centre_mm());
        let centre = region.centre_mm() + (aside - axes.forward * aside.dot(axes.forward));
        let closer = libm::exp2(-view.zoom);
        let region_from_world = region.region_from_world();
        let [width, height] = size.map(f64::from);
        // Offset from the middle of the picture to the middle of pixel (0, 0).
        let (i0, j0) = (0.5 * (1.0 - width), 0.5 * (1.0 - height));
        let (origin, pixel, near_mm) = match view.perspective {
            None => {
                let extent = |axis: DVec3| match view.turns {
                    true => radius,
                    false => region.diagonals_mm().map(|d| d.dot(axis).abs()).into_iter().fold(0.0, f64::max),
                };
                let pixel = (2.0 * extent(axes.right) / width).max(2.0 * extent(axes.up) / height) * closer;
                let first = centre - axes.forward * radius + axes.right * (i0 * pixel) - axes.up * (j0 * pixel);
                (first, pixel, 0.0)
            }
            Some(degrees) => {
                let half = 0.5 * degrees.to_radians();
                let distance = radius / libm::sin(half);
                let pixel = 2.0 * libm::tan(half) / width.min(height) * closer;
                (centre - axes.forward * distance, pixel, distance - radius)
            }
        };
        let linear = |v: DVec3| region_from_world.transform_vector3(v);
        let forward = match view.perspective {
            None => linear(axes.forward),
            Some(_) => axes.forward + axes.right * (i0 * pixel) - axes.up * (j0 * pixel),
        };
        Ok(Self {
            size,
            axes,
            perspective: view.perspective.is_some(),
            samples: samples as u32,
            step_mm,
            origin: region_from_world.transform_point3(origin),
            right: linear(axes.right * pixel),
            down: linear(-axes.up * pixel),
            forward,
            near_mm,
            region_from_world,
            pixel,
        })
    }

    /// Returns the pixels to the right and down.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Returns the samples along a ray; most lie outside of the volume.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// Returns the distance between samples along a ray, mm.
    pub fn step_mm(&self) -> f64 {
        self.step_mm
    }

    /// Returns the view's directions in the world.
    pub fn axes(&self) -> Axes {
        self.axes
    }

    /// Returns the depth of a region position, from 0 at the nearest sample on the view's axis
    /// to 1 at the farthest.
    pub fn depth(&self, at: DVec3, region: &RenderRegion) -> f64 {
        let along = (region.world_from_region().transform_point3(at) - region.centre_mm()).dot(self.axes.forward);
        0.5 + 0.5 * along / region.radius_mm()
    }

    /// Returns the ray of a pixel.
    #[inline(always)]
    pub fn ray(&self, i: u32, j: u32) -> Ray {
        self.ray_through([f64::from(i), f64::from(j)])
    }

    /// Returns the ray through a picture position in pixels; whole numbers are pixel centres.
    #[inline(always)]
    pub fn ray_through(&self, [i, j]: [f64; 2]) -> Ray {
        if !self.perspective {
            return Ray { base: self.origin + self.right * i + self.down * j, step: self.forward * self.step_mm };
        }
        let world = self.forward + self.axes.right * (i * self.pixel) - self.axes.up * (j * self.pixel);
        let per_mm = self.region_from_world.transform_vector3(world.normalize());
        Ray { base: self.origin + per_mm * self.near_mm, step: per_mm * self.step_mm }
    }

    /// Returns whether the view is perspective rather than parallel.
    pub fn is_perspective(&self) -> bool {
        self.perspective
    }

    /// Returns the pixel coordinates of a world position (mm), like [`Self::project`].
    pub fn project_world(&self, at: DVec3) -> Option<[f64; 2]> {
        self.project(self.region_from_world.transform_point3(at))
    }

    /// Returns the projection from the world (x, y, z in mm, 1) to the picture. The pixel
    /// position to the right and down is the first two numbers over the third, whole at pixel
    /// centres. In a perspective view it is valid only for a positive third number.
    pub fn projection(&self) -> [[f64; 4]; 3] {
        let Axes { right, up, forward } = self.axes;
        let origin = self.region_from_world.inverse().transform_point3(self.origin);
        let row = |axis: DVec3| [axis.x, axis.y, axis.z, -axis.dot(origin)];
        let [to_right, down] = [right / self.pixel, -up / self.pixel];
        if !self.perspective {
            return [row(to_right), row(down), [0.0, 0.0, 0.0, 1.0]];
        }
        let [i, j] = self.size.map(|side| forward * (0.5 * (f64::from(side) - 1.0)));
        [row(to_right + i), row(down + j), row(forward)]
    }

    /// Returns the first pixel's ray and its change per pixel to the right and down; region
    /// coordinates. Parallel: sample 0, the step to the next sample, and the shifts of sample 0.
    /// Perspective: the eye, the vector to the point at 1 mm along the view's axis, and the
    /// shifts of that point.
    pub(super) fn first_ray(&self) -> (Ray, [DVec3; 2]) {
        let step = match self.perspective {
            false => self.forward * self.step_mm,
            true => self.region_from_world.transform_vector3(self.forward),
        };
        (Ray { base: self.origin, step }, [self.right, self.down])
    }

    /// Returns, for a perspective view, the pixel distance at 1 mm along the view's axis and the
    /// distance of the first sample from the eye, mm; `None` for parallel rays.
    pub(super) fn perspective(&self) -> Option<[f64; 2]> {
        self.perspective.then_some([self.pixel, self.near_mm])
    }

    /// Returns the pixel coordinates of a region position; `None` beside or behind a perspective
    /// view's eye.
    pub fn project(&self, at: DVec3) -> Option<[f64; 2]> {
        let from = at - self.origin;
        let world = self.region_from_world.matrix3.inverse() * from;
        let (x, y, z) = (world.dot(self.axes.right), -world.dot(self.axes.up), world.dot(self.axes.forward));
        if !self.perspective {
            let pixel = (self.region_from_world.matrix3.inverse() * self.right).length();
            return Some([x / pixel, y / pixel]);
        }
        if z < 1e-6 {
            return None;
        }
        let [width, height] = self.size.map(f64::from);
        Some([x / (z * self.pixel) + 0.5 * (width - 1.0), y / (z * self.pixel) + 0.5 * (height - 1.0)])
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DQuat};

    use super::*;

    #[test]
    fn view_from_its_axes_restores_directions() {
        for (azimuth, elevation, roll) in
            [(0.0, 0.0, 0.0), (33.0, 21.0, -50.0), (-170.0, -80.0, 170.0), (10.0, 90.0, 0.0)]
        {
            let Axes { forward, up, right } = View { azimuth, elevation, roll, ..View::default() }.axes();
            let found = View::along(forward, up).axes();
            let off = (found.forward - forward).length() + (found.up - up).length() + (found.right - right).length();
            assert!(off < 1e-7, "{azimuth} {elevation} {roll}: {off}");
        }
    }

    #[test]
    fn scan_view_from_deep_side_keeps_probe_on_top() {
        for turn in [DMat3::IDENTITY, DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(1.3, -0.4, 2.0)))] {
            let [u, v] = [DVec3::X, DVec3::Z].map(|axis| turn * axis);
            let view = View::of_slices(Some([u, v]));
            let Axes { right, up, forward } = view.axes();
            // The tolerance covers three angles rounded to whole degrees.
            let along = |forward: DVec3, axis: DVec3| forward.dot(axis).clamp(-1.0, 1.0).acos().to_degrees();
            assert!((along(forward, -v) - 30.0).abs() < 1.5, "{view:?}");
            assert!((along(forward, -u) - 80.2).abs() < 1.5, "{view:?}");
            assert!(right.dot(v).abs() < 0.03 && up.dot(-v) > 0.45, "{view:?}");
        }
        let View { azimuth, elevation, roll, .. } = View::of_slices(Some([DVec3::X, DVec3::Z]));
        assert_eq!([azimuth, elevation, roll.abs()], [20.0, 60.0, 180.0]);
        assert_eq!(View::of_slices(None), View { azimuth: 30.0, elevation: 20.0, ..View::default() });
    }
}
