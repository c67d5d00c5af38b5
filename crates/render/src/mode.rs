//! Render modes of a volume.
//!
//! Each mode defines the data kept for a voxel, the value of a sample between voxels, and the
//! composition of the samples along a ray. The modes differ in nothing else: caches, blocks,
//! skipping and threads are the same for all.
//!
//! | mode | a voxel keeps | a sample is | samples are combined to |
//! |---|---|---|---|
//! | shaded | its lit colour and opacity | those, interpolated | their composite |
//! | shaded, by samples | intensity and gradient | those, interpolated, then classified and lit | their composite |
//! | opacity | its opacity, unlit and white | as shaded, or as shaded by samples | their composite |
//! | isosurface | intensity and gradient | opaque where the ray enters the surface before it | their composite |
//! | maximum | intensity | that | the largest |
//! | average | intensity | that | their mean |
//!
//! Unseen voxels are transparent in all modes, and the end of coverage gives neither surface nor
//! rim. Intensities are interpolated together with their seen share, c = Σ seen · intensity and
//! s = Σ seen, and read as c / s. If s is below one half, the maximum and the isosurface treat a
//! sample as unseen; the average of a ray is Σ c / Σ s. The transfer function's colours display
//! the projected intensity.

use super::RenderError;
use super::classify::transfer::Transfer;
use super::rays::composite::CompositeMode;
use super::real::{Number as _, Real};

/// A ray that has seen less than this share of one sample counts as empty. An average below it
/// would consist of rounding errors.
const LEAST_SEEN: f64 = 1.0 / 64.0;

/// The data that are classified and lit.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Shading {
    /// Voxels: their colours are interpolated. Only changed voxels cost work.
    #[default]
    Voxel,
    /// Samples: intensity and gradient are interpolated. Sharper, but many times the work; for
    /// still pictures.
    Sample,
}

impl Shading {
    /// Returns the name on the command line and in statistics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Voxel => "voxel",
            Self::Sample => "sample",
        }
    }
}

/// The aspect of a volume that a picture shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mode {
    /// Lit tissue, with the transfer function's opacity.
    Shaded(Shading),
    /// The hidden share of the background: white where everything behind is hidden.
    Opacity(Shading),
    /// The largest intensity along each ray.
    Maximum,
    /// The mean of the intensities along each ray.
    Average,
    /// The opaque surface of one intensity, in grey levels. Unseen is below every intensity. The
    /// surface has the transfer function's colour of that intensity. It is white if that
    /// function is grey, so that only the light determines brightness.
    Isosurface(f64),
}

impl Default for Mode {
    fn default() -> Self {
        Self::Shaded(Shading::Voxel)
    }
}

/// The data voxels keep for a mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum VoxelData {
    /// Premultiplied colour and opacity.
    Lit,
    /// The intensity, and that it was seen.
    Intensity,
    /// The intensity, its gradient, and that they were seen.
    SampleClassifier,
}

impl Mode {
    /// Returns the name on the command line and in statistics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Shaded(_) => "shaded",
            Self::Opacity(_) => "opacity",
            Self::Maximum => "mip",
            Self::Average => "average",
            Self::Isosurface(_) => "iso",
        }
    }

    /// Returns the data that are classified, if any.
    pub fn shading(self) -> Option<Shading> {
        match self {
            Self::Shaded(shading) | Self::Opacity(shading) => Some(shading),
            _ => None,
        }
    }

    /// Returns the surface's intensity.
    pub fn isovalue(self) -> Option<f64> {
        match self {
            Self::Isosurface(value) => Some(value),
            _ => None,
        }
    }

    /// Returns whether the mode uses lighting.
    pub fn is_lit(self) -> bool {
        matches!(self, Self::Shaded(_) | Self::Isosurface(_))
    }

    pub(super) fn check(self) -> Result<(), RenderError> {
        match self {
            Self::Isosurface(value) if !value.is_finite() => Err(RenderError::Isovalue { value }),
            _ => Ok(()),
        }
    }

    pub(super) fn voxel_data(self) -> VoxelData {
        match self {
            Self::Shaded(Shading::Voxel) | Self::Opacity(Shading::Voxel) => VoxelData::Lit,
            Self::Maximum | Self::Average => VoxelData::Intensity,
            Self::Shaded(Shading::Sample) | Self::Opacity(Shading::Sample) | Self::Isosurface(_) => {
                VoxelData::SampleClassifier
            }
        }
    }

    /// Returns whether one channel is enough for the colour of a sample.
    pub(super) fn is_grey(self, transfer: &Transfer) -> bool {
        match self {
            Self::Shaded(_) | Self::Isosurface(_) => transfer.is_grey(),
            Self::Opacity(_) | Self::Maximum | Self::Average => true,
        }
    }

    pub(super) fn composite_mode(self, transfer: &Transfer) -> CompositeMode {
        match self {
            Self::Shaded(_) | Self::Opacity(_) | Self::Isosurface(_) => CompositeMode::Over,
            Self::Average => CompositeMode::Thin,
            // Beyond the last colour all intensities look the same.
            Self::Maximum => CompositeMode::Most { top: f32::from_f64(transfer.colours().span()[1]) },
        }
    }

    /// Returns the samples behind a place that depend on it. A surface between two samples
    /// belongs to the one behind it.
    pub(super) fn reach(self) -> u32 {
        u32::from(matches!(self, Self::Isosurface(_)))
    }

    /// Returns premultiplied red, green, blue, and transmittance of a pixel, from the composite
    /// of its ray's samples.
    pub(super) fn pixel<T: Real>(self, colour: [T; 3], transmittance: T, transfer: &Transfer) -> [T; 4] {
        let least = match self {
            Self::Shaded(_) | Self::Opacity(_) | Self::Isosurface(_) => {
                let [r, g, b] = colour;
                return [r, g, b, transmittance];
            }
            Self::Maximum => T::ZERO,
            Self::Average => T::from_f64(LEAST_SEEN),
        };
        let seen = T::ONE - transmittance;
        if seen <= least {
            return [T::ZERO, T::ZERO, T::ZERO, T::ONE];
        }
        let [r, g, b] = transfer.colour(colour[0] / seen);
        [r, g, b, T::ZERO]
    }
}
