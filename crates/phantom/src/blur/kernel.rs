//! A reconstruction's kernel: its actual σ, and its orientation at each place.

use glam::{DMat3, DVec3};

use reconstruct::Settings;
use reconstruct::kernel::KernelError;
use sonoweave_core::frames::{Image as ImageFrame, Transform, World};
use volume::Grid;

use crate::PhantomError;
use crate::elementary::exp;
use crate::scan::Scan;

/// Slices farther than this many σ across the plane do not affect a voxel's kernel orientation.
const ORIENTATION_REACH: f64 = 4.0;

/// Actual standard deviations of a reconstruction's kernel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EffectiveKernel {
    sigma_mm: [f64; 3],
}

impl EffectiveKernel {
    /// Creates a kernel from effective σ along u, v and the slice's normal, mm.
    ///
    /// # Errors
    /// [`PhantomError::Length`] if one is not positive and finite.
    pub fn new(sigma_mm: [f64; 3]) -> Result<Self, PhantomError> {
        for sigma in sigma_mm {
            PhantomError::check_length("the kernel's effective σ", sigma)?;
        }
        Ok(Self { sigma_mm })
    }

    /// Returns the reconstructor's default kernel for a voxel spacing and a pixel size, mm.
    ///
    /// # Errors
    /// [`KernelError`] if a length is not positive.
    pub fn of_defaults(spacing: DVec3, pixel_mm: [f64; 2]) -> Result<Self, KernelError> {
        let kernels = Settings::new(spacing).kernels(pixel_mm)?;
        Ok(Self { sigma_mm: kernels.map(|kernel| kernel.sigma_effective_mm()) })
    }

    /// Returns the effective σ along u, v and the slice's normal, mm.
    pub fn sigma_mm(&self) -> [f64; 3] {
        self.sigma_mm
    }

    /// Returns the kernel's covariance at a slice's points, mm², world axes.
    pub fn covariance(&self, world_from_image: &Transform<World, ImageFrame>) -> DMat3 {
        let axes = world_from_image.affine().matrix3;
        let along = |axis: DVec3, sigma: f64| {
            let axis = axis.normalize() * sigma;
            DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z)
        };
        let [u, v, n] = self.sigma_mm;
        along(axes.x_axis, u) + along(axes.y_axis, v) + along(axes.z_axis, n)
    }

    pub(super) fn smallest(&self) -> f64 {
        self.sigma_mm.into_iter().fold(f64::INFINITY, f64::min)
    }

    pub(super) fn largest(&self) -> f64 {
        self.sigma_mm.into_iter().fold(0.0, f64::max)
    }
}

/// Returns the world position, mm, of voxel number `k` of layer `z`.
pub(super) fn voxel_centre(grid: &Grid, k: u64, z: u64) -> DVec3 {
    grid.world_from_volume().point(DVec3::new((k % grid.size[0]) as f64, (k / grid.size[0]) as f64, z as f64))
}

/// The kernel's orientation at each place.
pub(super) enum Covariances {
    /// The same everywhere.
    Same(DMat3),
    /// Rotated with the slices.
    Turning { slices: Vec<SliceKernel>, reach_mm: f64, falloff: f64 },
}

/// A slice's plane, the rectangle of its pixels, and its kernel covariance.
#[derive(Clone, Copy)]
pub(super) struct SliceKernel {
    image_from_world: Transform<ImageFrame, World>,
    last: [f64; 2],
    covariance: DMat3,
}

impl Covariances {
    pub(super) fn of(scan: &Scan, kernel: &EffectiveKernel) -> Self {
        let last = scan.settings().image_size.map(|n| f64::from(n - 1));
        let slices: Vec<SliceKernel> = (0..scan.frames())
            .map(|frame| {
                let world_from_image = scan.true_world_from_image(frame);
                let covariance = kernel.covariance(&world_from_image);
                SliceKernel { image_from_world: world_from_image.inverse(), last, covariance }
            })
            .collect();
        let first = slices[0].covariance;
        let differs = |s: &SliceKernel| (s.covariance - first).to_cols_array().iter().any(|x| x.abs() > 1e-12);
        if !slices.iter().any(differs) {
            return Self::Same(first);
        }
        let sigma = kernel.sigma_mm[2];
        Self::Turning { slices, reach_mm: ORIENTATION_REACH * sigma, falloff: -0.5 / (sigma * sigma) }
    }

    /// Returns the slices that affect a layer of a grid: those whose plane passes it within
    /// reach.
    pub(super) fn near_layer(&self, grid: &Grid, z: u64) -> Nearby<'_> {
        let near = match self {
            Self::Same(_) => Vec::new(),
            Self::Turning { slices, reach_mm, .. } => {
                let [nx, ny, _] = grid.size.map(|n| (n - 1) as f64);
                let corners = [(0.0, 0.0), (nx, 0.0), (0.0, ny), (nx, ny)]
                    .map(|(x, y)| grid.world_from_volume().point(DVec3::new(x, y, z as f64)));
                let passes = |s: &&SliceKernel| {
                    let distances = corners.map(|corner| s.image_from_world.point(corner).z);
                    distances.iter().any(|d| *d >= -reach_mm) && distances.iter().any(|d| *d <= *reach_mm)
                };
                slices.iter().filter(passes).copied().collect()
            }
        };
        Nearby { all: self, near }
    }
}

/// The slices near one layer.
pub(super) struct Nearby<'a> {
    all: &'a Covariances,
    near: Vec<SliceKernel>,
}

impl Nearby<'_> {
    /// Returns the mean covariance of the slices whose image lies near a point. If there are
    /// none, returns that of the slice with the nearest plane.
    pub(super) fn at(&self, world: DVec3) -> DMat3 {
        let (slices, reach, falloff) = match self.all {
            Covariances::Same(covariance) => return *covariance,
            Covariances::Turning { slices, reach_mm, falloff } => (slices, *reach_mm, *falloff),
        };
        let (mut sum, mut weights) = (DMat3::ZERO, 0.0);
        for slice in &self.near {
            let foot = slice.image_from_world.point(world);
            let [last_u, last_v] = slice.last;
            let beside = |x: f64, last: f64| !(-0.5..=last + 0.5).contains(&x);
            if foot.z.abs() > reach || beside(foot.x, last_u) || beside(foot.y, last_v) {
                continue;
            }
            let weight = exp(falloff * foot.z * foot.z);
            sum += weight * slice.covariance;
            weights += weight;
        }
        if weights > 0.0 {
            return sum * (1.0 / weights);
        }
        let distance = |slice: &SliceKernel| slice.image_from_world.point(world).z.abs();
        let nearest = slices.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
        nearest.map_or(DMat3::ZERO, |slice| slice.covariance)
    }
}
