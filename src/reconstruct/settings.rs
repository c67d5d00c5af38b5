//! What a reconstruction is asked to do: the lattice, the kernel, the compounding and the means.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};

use super::compounding::Compounding;
use super::decay::DecayError;
use super::filter::MOST_NODES;
use super::kernel::{AxisKernel, KernelError, Method, Shape, Support};
use super::planar::Departure;
use super::spline::SplineError;
use crate::mask::Mask;
use crate::simd::Simd;

/// Kernel's share outside its support in the plane, where taps are cheap: a spline fits so small a kink as well as none, of 0.01 it does not.
pub const IN_PLANE_SUPPORT: Support = Support::Energy(1e-3);
/// Kernel's share outside its support across the plane, where the support is what an insert costs.
pub const OFF_PLANE_SUPPORT: Support = Support::Energy(0.01);
/// In-plane σ as a multiple of the larger of voxel spacing and pixel size: below 0.75 voxel a sampled Gaussian stops behaving like one
/// (Lindeberg 2023).
pub const IN_PLANE_SIGMA: f64 = 0.75;
/// Off-plane σ when nothing is known of the scanner's resolution, mm.
pub const OFF_PLANE_SIGMA_MM: f64 = 1.0;
/// Default of [`Settings::max_weight`].
pub const MAX_WEIGHT: f64 = 256.0;
/// Largest [`Settings::max_weight`]: there the mean of slices that are all alike may be off by 3 %, the rounding of so long a sum in f32, and in
/// proportion below. At ten and more times as much, a constant is no longer one at all.
pub const MOST_WEIGHT: f64 = 1e6;

/// What to reconstruct with.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Voxel spacing, mm.
    pub spacing_mm: DVec3,
    /// World position of the centre of the lattice's voxel (0, 0, 0), mm.
    pub lattice_origin_mm: DVec3,
    /// Columns are the directions of the lattice's axes in the world: orthonormal.
    pub lattice_direction: DMat3,
    /// The kernel's kind.
    pub method: Method,
    /// How slices that reach the same voxel make its value.
    pub compounding: Compounding,
    /// Nominal σ along u, v and the slice's normal, mm; `None` for the default of each. A method that interpolates between pixels takes only
    /// the last.
    pub sigma_mm: [Option<f64>; 3],
    /// Where a Gaussian ends, in the plane and across it; `None` for [`IN_PLANE_SUPPORT`] and [`OFF_PLANE_SUPPORT`].
    pub support: [Option<Support>; 2],
    /// Largest weight of a voxel, as a multiple of the kernel's peak, from 1 to [`MOST_WEIGHT`]: from there on the mean moves instead of freezing.
    pub max_weight: f64,
    /// Threads that filter and weave.
    pub threads: usize,
    /// Instruction set of the hot loops.
    pub simd: Simd,
    /// Bricks may take this many bytes.
    pub memory_bytes: u64,
}

impl Settings {
    /// Defaults at a voxel spacing: one thread, the best instruction set, at most 8 GiB.
    pub fn new(spacing_mm: DVec3) -> Self {
        Self {
            spacing_mm,
            lattice_origin_mm: DVec3::ZERO,
            lattice_direction: DMat3::IDENTITY,
            method: Method::default(),
            compounding: Compounding::default(),
            sigma_mm: [None; 3],
            support: [None; 2],
            max_weight: MAX_WEIGHT,
            threads: 1,
            simd: Simd::detect(),
            memory_bytes: 8 << 30,
        }
    }

    /// # Errors
    /// [`SettingsError`] when they cannot work for any slice.
    pub(super) fn check(&self, mask: &Mask) -> Result<(), SettingsError> {
        let spacing = self.spacing_mm;
        if !(spacing.is_finite() && spacing.min_element() > 0.0) {
            return Err(SettingsError::Spacing(spacing));
        }
        let direction = self.lattice_direction;
        // A NaN is not below the limit.
        let skew = (direction.transpose() * direction - DMat3::IDENTITY).to_cols_array().map(f64::abs);
        if !skew.iter().all(|x| *x < 1e-9) {
            return Err(SettingsError::Direction(direction));
        }
        if !self.simd.is_available() {
            return Err(SettingsError::Simd(self.simd.name()));
        }
        if !(self.max_weight >= 1.0 && self.max_weight <= MOST_WEIGHT) {
            return Err(SettingsError::MaxWeight(self.max_weight));
        }
        if mask.area() == 0 {
            return Err(SettingsError::EmptyMask);
        }
        Ok(())
    }

    /// What of the settings the planar path cannot do.
    pub fn beyond_planar(&self) -> Option<String> {
        if self.method.interpolates() {
            Some(format!("the kernel {}", self.method.name()))
        } else if self.compounding.selects() {
            Some(format!("the compounding {}", self.compounding.name()))
        } else {
            None
        }
    }

    /// The threads asked for; `None` where the caller's suffices.
    pub(super) fn pool(&self) -> Result<Option<Arc<rayon::ThreadPool>>, SettingsError> {
        match self.threads {
            0 | 1 => Ok(None),
            n => rayon::ThreadPoolBuilder::new()
                .num_threads(n)
                .thread_name(|i| format!("weave-{i}"))
                .build()
                .map(|pool| Some(Arc::new(pool)))
                .map_err(|e| SettingsError::Threads(n, e.to_string())),
        }
    }

    /// Kernels along u, v and the normal for a pixel size, mm.
    ///
    /// # Errors
    /// [`KernelError`] when a σ or where a kernel ends makes no sense.
    pub fn kernels(&self, pixel_mm: [f64; 2]) -> Result<[AxisKernel; 3], KernelError> {
        let spacing = self.spacing_mm.max_element();
        let default = |axis: usize| match axis {
            2 => OFF_PLANE_SIGMA_MM,
            _ => IN_PLANE_SIGMA * spacing.max(pixel_mm[axis]),
        };
        let kernel = |axis: usize| {
            let sigma = self.sigma_mm[axis].unwrap_or_else(|| default(axis));
            let [in_plane, across] = self.support;
            match axis {
                2 => AxisKernel::new(self.method, sigma, across.unwrap_or(OFF_PLANE_SUPPORT)),
                _ => self.method.in_plane(sigma, in_plane.unwrap_or(IN_PLANE_SUPPORT), pixel_mm[axis]),
            }
        };
        let mut kernels = [kernel(0)?, kernel(1)?, kernel(2)?];
        if self.compounding.selects() {
            let [.., normal] = &mut kernels;
            let support_mm = (0.5 * spacing).max(normal.hwhm() * normal.sigma_mm);
            *normal = AxisKernel { shape: Shape::Box, support_mm, pedestal: 0.0, ..*normal };
        }
        Ok(kernels)
    }

    /// The lattice: voxel indices to world mm.
    pub(super) fn world_from_lattice(&self) -> DAffine3 {
        DAffine3 {
            matrix3: self.lattice_direction * DMat3::from_diagonal(self.spacing_mm),
            translation: self.lattice_origin_mm,
        }
    }
}

/// Why the reconstructor cannot be used with these settings.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SettingsError {
    /// No volume has this spacing.
    #[error("the voxel spacing must be positive numbers of mm, not {0}")]
    Spacing(DVec3),
    /// The lattice's axes are not perpendicular, or not of length 1.
    #[error("the lattice's axes must be perpendicular and of length 1, not {0}")]
    Direction(DMat3),
    /// The planar path's tolerance is no length.
    #[error("the tolerance about the scan's plane must be a number of voxels, 0 or more, not {0}")]
    Tolerance(f64),
    /// The planar path lacks what is asked for.
    #[error("the planar path has no way for {0}: choose --path general")]
    BeyondPlanar(String),
    /// The planar path cannot hold what the mask says.
    #[error(transparent)]
    Planar(#[from] Departure),
    /// No kernel.
    #[error(transparent)]
    Kernel(#[from] KernelError),
    /// No filter.
    #[error("along image axis {axis}: {source}")]
    Spline {
        /// `u` or `v`.
        axis: char,
        /// Why.
        #[source]
        source: SplineError,
    },
    /// Nothing in the picture is data.
    #[error("the mask leaves no pixel of the picture: check the clip rectangle, the fan and the picture's size")]
    EmptyMask,
    /// A picture too fine for its kernel.
    #[error(
        "the filtered picture would have {0} nodes, more than the {most} that it may have: give a larger --sigma or a smaller --clip",
        most = MOST_NODES
    )]
    Nodes(usize),
    /// No decay.
    #[error(transparent)]
    Decay(#[from] DecayError),
    /// The weight's bound is no weight.
    #[error(
        "the largest weight must lie between 1 and {most:e} slices, not at {0}: beyond, sums in single precision lose what a slice adds; choose a smaller --max-weight",
        most = MOST_WEIGHT
    )]
    MaxWeight(f64),
    /// This machine lacks the instruction set.
    #[error("this machine has no {0}: choose --simd auto")]
    Simd(&'static str),
    /// Not even an empty volume has room.
    #[error("no memory for the volume: {0}")]
    Memory(String),
    /// Threads could not be started.
    #[error("{0} threads could not be started: {1}")]
    Threads(usize, String),
}
