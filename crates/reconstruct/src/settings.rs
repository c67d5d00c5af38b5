//! Settings of a reconstruction: lattice, kernel, compounding and resources.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};
use serde::{Deserialize, Serialize};

use mask::Mask;
use simd::Simd;
use simd::team::Team;
use volume::BrickVolume;
use volume::brick::BrickBox;

use super::compounding::{Compounding, Entry};
use super::decay::DecayError;
use super::gap_weights::GapWeights;
use super::kernel::{AxisKernel, KernelError, Method, Shape, Support};
use super::nodes::MOST_NODES;
use super::planar::Departure;
use super::shadow_weights::ShadowWeights;
use super::spline::SplineError;

/// Default support in the plane, where taps are cheap: the energy outside is so small that a
/// spline can fit the kink at the end. At 0.01 it cannot.
pub const IN_PLANE_SUPPORT: Support = Support::Energy(1e-3);
/// Default support across the plane, where it determines the cost of an insert.
pub const OFF_PLANE_SUPPORT: Support = Support::Energy(0.01);
/// In-plane σ as a multiple of the larger of voxel spacing and pixel size. Below 0.75 voxel a
/// sampled Gaussian no longer behaves like one (Lindeberg 2023).
pub const IN_PLANE_SIGMA: f64 = 0.75;
/// Off-plane σ if the scanner's resolution is unknown, mm.
pub const OFF_PLANE_SIGMA_MM: f64 = 1.0;
/// Default of [`Settings::max_weight`].
pub const MAX_WEIGHT: f64 = 256.0;
/// Largest [`Settings::max_weight`]. There the mean of equal slices may be off by 3 %, the
/// rounding of so long a sum in f32, and in proportion below. At ten or more times as much, a
/// constant does not stay constant at all.
pub const MOST_WEIGHT: f64 = 1e6;

/// Settings of a reconstruction. In files, they are without threads and instruction set, which give
/// the same volume on every machine, and without region.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Settings {
    /// Voxel spacing, mm.
    pub spacing_mm: DVec3,
    /// World position of the centre of the lattice's voxel (0, 0, 0), mm.
    pub lattice_origin_mm: DVec3,
    /// Columns are the directions of the lattice's axes in the world: orthonormal.
    pub lattice_direction: DMat3,
    /// Kind of the kernel.
    pub method: Method,
    /// Combination of the slices that reach the same voxel.
    pub compounding: Compounding,
    /// Nominal σ along u, v and the slice's normal, mm; `None` for the default of each. A
    /// method that interpolates between pixels uses only the last.
    pub sigma_mm: [Option<f64>; 3],
    /// Supports of a Gaussian, in the plane and across it; `None` for [`IN_PLANE_SUPPORT`] and
    /// [`OFF_PLANE_SUPPORT`].
    pub support: [Option<Support>; 2],
    /// Largest weight of a voxel, as a multiple of the kernel's peak, from 1 to
    /// [`MOST_WEIGHT`]. At this weight the mean keeps moving instead of freezing.
    pub max_weight: f64,
    /// Whether sums of squares are kept, from which a [standard error](super::standard_error) of
    /// each voxel follows: an eighth more memory. Only for [`Compounding::Mean`].
    #[serde(default)]
    pub standard_error: bool,
    /// Whether slices are to be [weighted](super::gap_weights) by the gaps beside them. Not for
    /// compoundings that [select](Compounding::selects).
    #[serde(default)]
    pub gap_weights: bool,
    /// Weights of pixels by the [shadows](super::shadow_weights) that they lie in; `None` if all
    /// count alike. Not for compoundings that [select](Compounding::selects).
    #[serde(default)]
    pub shadow_weights: Option<ShadowWeights>,
    /// Threads that filter and insert.
    #[serde(skip, default = "one")]
    pub threads: usize,
    /// Instruction set of the hot loops.
    #[serde(skip, default = "Simd::detect")]
    pub simd: Simd,
    /// Memory limit of the bricks, bytes.
    pub memory_bytes: u64,
    /// Part of the lattice that is reconstructed, on the general path: bricks outside are left
    /// out, and all others have the same bits as without it. `None` for all.
    #[serde(skip)]
    pub region: Option<BrickBox>,
}

fn one() -> usize {
    1
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
            standard_error: false,
            gap_weights: false,
            shadow_weights: None,
            threads: 1,
            simd: Simd::detect(),
            memory_bytes: 8 << 30,
            region: None,
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
        // The comparison is false for NaN.
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
        if let Some((number, value, range)) = self.shadow_weights.and_then(|shadows| shadows.beyond()) {
            return Err(SettingsError::ShadowNumber { number, value, range });
        }
        if mask.area() == 0 {
            return Err(SettingsError::EmptyMask);
        }
        Ok(())
    }

    /// Returns the memory that a brick takes on the general path, bytes.
    ///
    /// # Errors
    /// [`SettingsError`] for a decay that cannot be used, and for standard errors of anything but a
    /// mean.
    pub fn brick_bytes(&self) -> Result<u64, SettingsError> {
        Ok(BrickVolume::remembering(self.entry()?.memory()).brick_bytes())
    }

    /// Returns the setting that the planar path does not support, if any.
    pub fn beyond_planar(&self) -> Option<String> {
        if self.method.interpolates() || self.method == Method::Gaussian4 {
            Some(format!("the kernel {}", self.method.name()))
        } else if self.compounding.selects() {
            Some(format!("the compounding {}", self.compounding.name()))
        } else if self.standard_error {
            Some("standard errors".into())
        } else if self.gap_weights {
            Some("gap weights".into())
        } else if self.shadow_weights.is_some() {
            Some("shadow weights".into())
        } else if self.region.is_some() {
            Some("a part of the volume".into())
        } else {
            None
        }
    }

    /// Returns the weights of slices by the gaps beside them; `None` if they count alike.
    pub fn weights_by_gaps(&self) -> Option<GapWeights> {
        self.gap_weights.then(|| GapWeights::new(self.sigma_mm[2].unwrap_or(OFF_PLANE_SIGMA_MM)))
    }

    /// Returns the way a value enters a voxel.
    ///
    /// # Errors
    /// [`SettingsError`] for a decay that cannot be used, for standard errors of anything but a
    /// mean, and for weights of slices or pixels with a compounding that selects.
    pub(super) fn entry(&self) -> Result<Entry, SettingsError> {
        match self.compounding {
            other if self.gap_weights && other.selects() => Err(SettingsError::GapWeights(other.name())),
            other if self.shadow_weights.is_some() && other.selects() => {
                Err(SettingsError::ShadowWeights(other.name()))
            }
            Compounding::Mean if self.standard_error => Ok(Entry::MeanAndSquares),
            other if self.standard_error => Err(SettingsError::StandardError(other.name())),
            compounding => Ok(Entry::of(compounding)?),
        }
    }

    /// Starts the requested threads; `None` if the caller's is enough.
    pub(super) fn team(&self) -> Result<Option<Arc<Team>>, SettingsError> {
        let team = Team::new("insert", self.threads);
        Ok(team.map_err(|e| SettingsError::Threads(self.threads, e.to_string()))?.map(Arc::new))
    }

    /// Returns kernels along u, v and the normal for a pixel size, mm.
    ///
    /// # Errors
    /// [`KernelError`] when a σ or a support is invalid.
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

    /// Maps voxel indices to world mm.
    pub(super) fn world_from_lattice(&self) -> DAffine3 {
        DAffine3 {
            matrix3: self.lattice_direction * DMat3::from_diagonal(self.spacing_mm),
            translation: self.lattice_origin_mm,
        }
    }
}

/// Reason why the reconstructor cannot be used with these settings.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SettingsError {
    /// Invalid voxel spacing.
    #[error("the voxel spacing must be positive numbers of mm, not {0}")]
    Spacing(DVec3),
    /// The lattice's axes are not perpendicular, or not of length 1.
    #[error("the lattice's axes must be perpendicular and of length 1, not {0}")]
    Direction(DMat3),
    /// The planar path's tolerance is not a length.
    #[error("the tolerance about the scan's plane must be a number of voxels, 0 or more, not {0}")]
    Tolerance(f64),
    /// The planar path does not support the setting.
    #[error("the planar path does not support {0}: choose the general path")]
    BeyondPlanar(String),
    /// The planar path cannot hold data with this mask.
    #[error(transparent)]
    Planar(#[from] Departure),
    /// Invalid kernel.
    #[error(transparent)]
    Kernel(#[from] KernelError),
    /// No filter for the kernel.
    #[error("along image axis {axis}: {source}")]
    Spline {
        /// `u` or `v`.
        axis: char,
        /// Reason.
        #[source]
        source: SplineError,
    },
    /// No pixel of the image is data.
    #[error("the mask leaves no pixel of the picture: check the clip rectangle, the fan and the picture's size")]
    EmptyMask,
    /// The image is too fine for its kernel.
    #[error(
        "the filtered picture would have {0} nodes, more than the {most} that it may have: choose a larger σ or a smaller clip",
        most = MOST_NODES
    )]
    Nodes(usize),
    /// Standard errors were asked for with another compounding.
    #[error("a standard error is that of a mean: leave it out, or choose the compounding mean instead of {0}")]
    StandardError(&'static str),
    /// Gap weights were asked for with a compounding that selects one slice.
    #[error("gap weights are those of a mean: leave them out, or choose the compounding mean instead of {0}")]
    GapWeights(&'static str),
    /// Shadow weights were asked for with a compounding that selects one slice.
    #[error("shadow weights are those of a mean: leave them out, or choose the compounding mean instead of {0}")]
    ShadowWeights(&'static str),
    /// A number of the shadow weights is out of its range.
    #[error("shadow weights: {number} must lie between {} and {}, not at {value}", .range[0], .range[1])]
    ShadowNumber {
        /// The number's name.
        number: &'static str,
        /// Its value.
        value: f64,
        /// The least and the largest value.
        range: [f64; 2],
    },
    /// Invalid decay.
    #[error(transparent)]
    Decay(#[from] DecayError),
    /// Invalid limit of the weight.
    #[error(
        "the largest weight must lie between 1 and {most:e} slices, not at {0}: beyond, sums in single precision lose what a slice adds; choose a smaller largest weight",
        most = MOST_WEIGHT
    )]
    MaxWeight(f64),
    /// This machine lacks the instruction set.
    #[error("this machine has no {0}: choose automatic instructions")]
    Simd(&'static str),
    /// No memory even for an empty volume.
    #[error("no memory for the volume: {0}")]
    Memory(String),
    /// Threads could not be started.
    #[error("{0} threads could not be started: {1}")]
    Threads(usize, String),
}
