//! Flags for kernel and compounding.

use clap::{Args, ValueEnum};

use config::values::SigmaChoice;
use config::weighing::{CompoundName, DecayName, Weighing as Said};
use config::{Error, Settings as Config};
use pipeline::OffPlane;
use reconstruct::Settings;
use reconstruct::kernel::{Method, Support};

use crate::cli::{Failure, values};

/// Kernel and compounding.
#[derive(Debug, Args)]
#[command(next_help_heading = "Kernel and compounding")]
pub(in crate::cli) struct Weighing {
    /// Kernel: the weight of one slice at points beside its pixels
    #[arg(long, value_enum, default_value_t)]
    method: MethodName,
    /// Kernel σ along u, v and the slice's normal, mm; or auto: σ across the plane from the gaps
    /// between slices; or leave-one-out: the σ that predicts slices best from all others, which
    /// takes four to twelve times as long [default: 0.75 × the larger of spacing and pixel in the
    /// plane, 1.0 across]
    #[arg(long, value_name = "SU,SV,SN|auto|leave-one-out", value_parser = values::sigma, conflicts_with = "resolution")]
    sigma: Option<SigmaChoice>,
    /// Kernel size as half widths at half maximum of a Gaussian, mm
    #[arg(long, value_name = "HU,HV,HN", value_parser = values::lengths)]
    resolution: Option<[f64; 3]>,
    /// End of a Gaussian, in the plane and across it, or on all axes [default:
    /// energy=0.001,energy=0.01]
    #[arg(long, value_name = "CRITERION=E[,CRITERION=E]", value_parser = values::supports)]
    support: Option<Supports>,
    /// Short for --support energy=E
    #[arg(long, value_name = "E", value_parser = values::share, conflicts_with = "support")]
    leakage: Option<f64>,
    /// Largest weight of a voxel, in slices at their peak; a running mean follows beyond it
    #[arg(long, value_name = "SLICES", default_value_t = 256.0)]
    max_weight: f64,
    /// Compounding of slices that reach the same voxel
    #[arg(long, value_enum, default_value_t)]
    compound: CompoundName,
    /// Fading of the past under --compound decay [default: dead-time]
    #[arg(long, value_enum, value_name = "MODE")]
    decay: Option<DecayName>,
    /// Rate of fading, 1/s [default: 1]
    #[arg(long, value_name = "PER_S", allow_negative_numbers = true)]
    decay_rate: Option<f64>,
    /// Time before fading begins, s: longer than a sweep takes to pass over a voxel [default: 2]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    decay_wait: Option<f64>,
    /// Weight each slice by half the distance between its neighbours, for sweeps of uneven speed;
    /// takes the general path
    #[arg(long)]
    gap_weights: bool,
    /// Weight pixels in the shadow of bone or gas little, for places that several views have seen;
    /// takes the general path
    #[arg(long)]
    shadow_weights: bool,
}

// clap takes a bare array for a list.
type Supports = [Support; 2];

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum MethodName {
    /// Minus its value at the end of the support, so that it ends without a step: for slices far
    /// apart and fine voxels
    Gaussian,
    /// Truncated at the end of the support across the plane (Ohbuchi, Chen & Fuchs 1992)
    #[default]
    GaussianTruncated,
    /// Keeps small details by a kernel of fourth order in the plane, with negative lobes; across
    /// the plane like gaussian-truncated
    Gaussian4,
    /// Cubic B-spline of the same σ along all axes; twice differentiable
    Bspline3,
    /// Bilinear between pixels, gaussian across the plane
    Linear,
    /// The nearest pixel, the same weight across the plane
    Nearest,
}

impl Weighing {
    /// Puts the flags into the settings, with the configuration's values for missing flags.
    /// Returns the source of σ across the plane.
    ///
    /// # Errors
    /// [`Failure`] when flags contradict each other.
    pub(super) fn apply(&self, config: &Config, settings: &mut Settings) -> Result<OffPlane, Failure> {
        let said = Said {
            method: self.method(),
            sigma_mm: self.given(),
            hwhm_mm: self.resolution,
            support: self.support.or(self.leakage.map(|e| [Support::Energy(e); 2])),
            max_weight: self.max_weight,
            compound: self.compound,
            decay: self.decay,
            decay_rate: self.decay_rate,
            decay_wait: self.decay_wait,
            gap_weights: self.gap_weights,
            shadow_weights: self.shadow_weights,
        };
        said.apply(config.hwhm_mm, settings).map_err(|error| match error {
            Error::Setting { setting: "support", problem } => {
                Failure::flag(Error::Setting { setting: "support, leakage", problem })
            }
            other => Failure::flag(other),
        })?;
        Ok(if self.sigma == Some(SigmaChoice::Auto) { OffPlane::Auto } else { OffPlane::Settings })
    }

    /// Returns whether the kernel's widths are chosen by leave-one-out.
    pub(super) fn leaves_one_out(&self) -> bool {
        self.sigma == Some(SigmaChoice::LeaveOneOut)
    }

    /// Returns the given widths.
    fn given(&self) -> Option<[f64; 3]> {
        match self.sigma {
            Some(SigmaChoice::Given(sigma_mm)) => Some(sigma_mm),
            _ => None,
        }
    }

    /// Returns the kernel's method.
    pub(super) fn method(&self) -> Method {
        match self.method {
            MethodName::Gaussian => Method::Gaussian,
            MethodName::GaussianTruncated => Method::GaussianTruncated,
            MethodName::Gaussian4 => Method::Gaussian4,
            MethodName::Bspline3 => Method::BSpline3,
            MethodName::Linear => Method::Linear,
            MethodName::Nearest => Method::Nearest,
        }
    }

    /// Returns a note on flags that had no effect.
    pub(super) fn note(&self) -> Option<String> {
        let given = self.resolution.is_some() || self.given().is_some();
        (given && self.method().interpolates()).then(|| {
            format!(
                "the method {} interpolates between pixels: only the last of the three widths is used",
                self.method().name()
            )
        })
    }
}
