//! Flags that say how slices are weighed and compounded.

use clap::{Args, ValueEnum};

use super::Failure;
use crate::cli::values;
use crate::config::Settings as Config;
use crate::pipeline::OffPlane;
use crate::reconstruct::kernel::{Method, Support, sigma_from_hwhm};
use crate::reconstruct::{Compounding, Settings};

/// Kernel and compounding.
#[derive(Debug, Args)]
#[command(next_help_heading = "Kernel and compounding")]
pub(super) struct Weighing {
    /// The kernel: what one slice says about a point beside its pixels
    #[arg(long, value_enum, default_value_t)]
    method: MethodName,
    /// Kernel σ along u, v and the slice's normal, mm; or auto: σ across the plane from the gaps between slices [default: 0.75 × the
    /// larger of spacing and pixel in the plane, 1.0 across]
    #[arg(long, value_name = "SU,SV,SN|auto", value_parser = values::sigma, conflicts_with = "resolution")]
    sigma: Option<SigmaChoice>,
    /// The same as half widths at half maximum of a Gaussian, mm
    #[arg(long, value_name = "HU,HV,HN", value_parser = values::lengths)]
    resolution: Option<[f64; 3]>,
    /// Where a Gaussian ends [default: energy=0.01 across the plane, energy=0.0001 in it]
    #[arg(long, value_name = "CRITERION=E", value_parser = values::support)]
    support: Option<Support>,
    /// Short for --support energy=E
    #[arg(long, value_name = "E", value_parser = values::share, conflicts_with = "support")]
    leakage: Option<f64>,
    /// Largest weight of a voxel, in slices at their peak; from there on the mean moves
    #[arg(long, value_name = "SLICES", default_value_t = 256.0)]
    max_weight: f64,
    /// What becomes of slices that reach the same voxel
    #[arg(long, value_enum, default_value_t)]
    compound: CompoundName,
}

// clap takes an `Option<Option<…>>` for its own notation of optional values; a named type is a single value to it.
type SigmaChoice = Option<[f64; 3]>;

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum MethodName {
    /// Less its value at the end of the support, so that it ends without a step
    #[default]
    Gaussian,
    /// Cut at the end of the support (Ohbuchi, Chen & Fuchs 1992)
    GaussianTruncated,
    /// Cubic B-spline of the same σ along all axes; twice differentiable
    Bspline3,
    /// Bilinear between pixels, gaussian across the plane
    Linear,
    /// The nearest pixel, the same weight across the plane
    Nearest,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum CompoundName {
    /// Their weighted mean
    #[default]
    Mean,
    /// The brightest of those that pass within half a voxel or the kernel's half width
    Maximum,
    /// The latest of those, by the frames' times
    Latest,
}

impl Weighing {
    /// Puts the flags, and what the configuration says where they are silent, into the settings; returns where σ across the plane comes from.
    ///
    /// # Errors
    /// [`Failure`] when flags contradict each other.
    pub(super) fn apply(&self, config: &Config, settings: &mut Settings) -> Result<OffPlane, Failure> {
        settings.method = self.method();
        settings.support = self.support.or(self.leakage.map(Support::Energy));
        if settings.support.is_some() && !settings.method.takes_support() {
            return Err(Failure(format!(
                "--support, --leakage: the kernel {} ends of itself; leave the flag out, or choose --method gaussian",
                settings.method.name()
            )));
        }
        settings.sigma_mm[2] = config.hwhm_mm.map(|hwhm| sigma_from_hwhm(hwhm[2]));
        let mut off_plane = OffPlane::Settings;
        match (self.sigma, self.resolution) {
            (Some(Some(sigma)), _) => settings.sigma_mm = sigma.map(Some),
            (Some(None), _) => off_plane = OffPlane::Auto,
            (None, Some(hwhm)) => settings.sigma_mm = hwhm.map(|h| Some(sigma_from_hwhm(h))),
            (None, None) => {}
        }
        settings.max_weight = self.max_weight;
        settings.compounding = match self.compound {
            CompoundName::Mean => Compounding::Mean,
            CompoundName::Maximum => Compounding::Maximum,
            CompoundName::Latest => Compounding::Latest,
        };
        Ok(off_plane)
    }

    /// The kernel's kind.
    pub(super) fn method(&self) -> Method {
        match self.method {
            MethodName::Gaussian => Method::Gaussian,
            MethodName::GaussianTruncated => Method::GaussianTruncated,
            MethodName::Bspline3 => Method::BSpline3,
            MethodName::Linear => Method::Linear,
            MethodName::Nearest => Method::Nearest,
        }
    }

    /// What the user should know of flags that had no effect.
    pub(super) fn note(&self) -> Option<String> {
        let given = self.resolution.is_some() || matches!(self.sigma, Some(Some(_)));
        (given && self.method().interpolates()).then(|| {
            format!(
                "the method {} goes from pixel to pixel: only the last of the three widths is used",
                self.method().name()
            )
        })
    }
}
