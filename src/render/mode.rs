//! Ways to look at a volume.
//!
//! Each is a rule for what a voxel keeps, what a sample between voxels is, and how the samples along a ray make one. That is all that sets them apart: caches,
//! blocks, skipping and threads are the same for all.
//!
//! | mode | a voxel keeps | a sample is | samples make |
//! |---|---|---|---|
//! | shaded | its lit colour and opacity | those, interpolated | what is seen through them |
//! | shaded, by samples | intensity and gradient | those, interpolated, then classified and lit | what is seen through them |
//! | opacity | its opacity, unlit and white | as shaded, or as shaded by samples | what is seen through them |
//! | isosurface | intensity and gradient | opaque where the ray enters the surface before it | what is seen through them |
//! | maximum | intensity | that | the largest |
//! | average | intensity | that | their mean |
//!
//! What was not seen is transparent in all of them, and the end of coverage neither surface nor rim: intensities are interpolated together with how much
//! of them was seen, c = Σ seen · intensity and s = Σ seen, and read as c / s. Where s is below one half, a sample counts as not seen by the maximum and the
//! isosurface; the average of a ray is Σ c / Σ s. The transfer function's colours say how the projected intensity is shown.

use super::RenderError;
use super::law::Law;
use super::real::{Number as _, Real};
use super::transfer::Transfer;

/// A ray that has seen less than this share of one sample has seen nothing. Below it an average would be one of rounding.
const LEAST_SEEN: f64 = 1.0 / 64.0;

/// What is classified and lit.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Shading {
    /// Voxels: their colours are interpolated. A change costs what it changes.
    #[default]
    Voxel,
    /// Samples: intensity and gradient are interpolated. Sharper, and many times the work; for stills.
    Sample,
}

impl Shading {
    /// The name on the command line and in statistics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Voxel => "voxel",
            Self::Sample => "sample",
        }
    }
}

/// What of a volume a picture shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mode {
    /// Lit matter, as opaque as the transfer function says.
    Shaded(Shading),
    /// How much of what lies behind is hidden: white where all is.
    Opacity(Shading),
    /// The largest intensity along each ray.
    Maximum,
    /// The mean of the intensities along each ray.
    Average,
    /// The opaque surface of one intensity, in grey levels. Unseen is below every intensity. It has the transfer function's colour of that intensity, and is
    /// white where that function is grey: then brightness is the light's alone.
    Isosurface(f64),
}

impl Default for Mode {
    fn default() -> Self {
        Self::Shaded(Shading::Voxel)
    }
}

/// What voxels keep for a mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Keeps {
    /// Premultiplied colour and opacity.
    Lit,
    /// The intensity, and that it was seen.
    Intensity,
    /// The intensity, its gradient, and that they were seen.
    Matter,
}

impl Mode {
    /// The name on the command line and in statistics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Shaded(_) => "shaded",
            Self::Opacity(_) => "opacity",
            Self::Maximum => "mip",
            Self::Average => "average",
            Self::Isosurface(_) => "iso",
        }
    }

    /// What is classified, where anything is.
    pub fn shading(self) -> Option<Shading> {
        match self {
            Self::Shaded(shading) | Self::Opacity(shading) => Some(shading),
            _ => None,
        }
    }

    /// The surface's intensity.
    pub fn isovalue(self) -> Option<f64> {
        match self {
            Self::Isosurface(value) => Some(value),
            _ => None,
        }
    }

    /// Whether light falls on what is shown.
    pub fn is_lit(self) -> bool {
        matches!(self, Self::Shaded(_) | Self::Isosurface(_))
    }

    pub(super) fn check(self) -> Result<(), RenderError> {
        match self {
            Self::Isosurface(value) if !value.is_finite() => Err(RenderError::Isovalue { value }),
            _ => Ok(()),
        }
    }

    pub(super) fn keeps(self) -> Keeps {
        match self {
            Self::Shaded(Shading::Voxel) | Self::Opacity(Shading::Voxel) => Keeps::Lit,
            Self::Maximum | Self::Average => Keeps::Intensity,
            Self::Shaded(Shading::Sample) | Self::Opacity(Shading::Sample) | Self::Isosurface(_) => Keeps::Matter,
        }
    }

    /// Whether one channel holds all there is to the colour of a sample.
    pub(super) fn is_grey(self, transfer: &Transfer) -> bool {
        match self {
            Self::Shaded(_) | Self::Isosurface(_) => transfer.is_grey(),
            Self::Opacity(_) | Self::Maximum | Self::Average => true,
        }
    }

    pub(super) fn law(self, transfer: &Transfer) -> Law {
        match self {
            Self::Shaded(_) | Self::Opacity(_) | Self::Isosurface(_) => Law::Over,
            Self::Average => Law::Thin,
            // From the last colour on all intensities look the same.
            Self::Maximum => Law::Most { top: f32::from_f64(transfer.colours().span()[1]) },
        }
    }

    /// Samples behind a place that depend on it: a surface between two samples is the one's behind it.
    pub(super) fn reach(self) -> u32 {
        u32::from(matches!(self, Self::Isosurface(_)))
    }

    /// Red, green, blue, each premultiplied, and transmittance of a pixel, from what its ray's samples made.
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
