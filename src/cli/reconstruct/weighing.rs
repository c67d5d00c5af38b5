//! Flags that say how slices are weighed and compounded.

use clap::{Args, ValueEnum};

use crate::cli::{Failure, values};
use crate::config::Settings as Config;
use crate::pipeline::OffPlane;
use crate::reconstruct::kernel::{Method, Support, sigma_from_hwhm};
use crate::reconstruct::{Compounding, Decay, Settings};

/// Kernel and compounding.
#[derive(Debug, Args)]
#[command(next_help_heading = "Kernel and compounding")]
pub(in crate::cli) struct Weighing {
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
    /// Where a Gaussian ends, in the plane and across it, or on all axes [default: energy=0.001,energy=0.01]
    #[arg(long, value_name = "CRITERION=E[,CRITERION=E]", value_parser = values::supports)]
    support: Option<Supports>,
    /// Short for --support energy=E
    #[arg(long, value_name = "E", value_parser = values::share, conflicts_with = "support")]
    leakage: Option<f64>,
    /// Largest weight of a voxel, in slices at their peak; from there on the mean moves
    #[arg(long, value_name = "SLICES", default_value_t = 256.0)]
    max_weight: f64,
    /// What becomes of slices that reach the same voxel
    #[arg(long, value_enum, default_value_t)]
    compound: CompoundName,
    /// How the past fades under --compound decay [default: dead-time]
    #[arg(long, value_enum, value_name = "MODE")]
    decay: Option<DecayName>,
    /// How fast it fades, 1/s [default: 1]
    #[arg(long, value_name = "PER_S", allow_negative_numbers = true)]
    decay_rate: Option<f64>,
    /// For how long it does not fade, s: longer than a sweep takes to pass over a voxel [default: 2]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    decay_wait: Option<f64>,
}

/// Default rate of decay, 1/s.
const DECAY_RATE: f64 = 1.0;
/// Default wait, s: at 5 mm/s, a slow sweep, the default support of 2.6 mm to either side passes in half of it.
const DECAY_WAIT: f64 = 2.0;

// clap takes an `Option<Option<…>>` for its own notation of optional values; a named type is a single value to it.
type SigmaChoice = Option<[f64; 3]>;
// And a bare array for a list.
type Supports = [Support; 2];

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum MethodName {
    /// Less its value at the end of the support, so that it ends without a step: for slices far apart and fine voxels
    Gaussian,
    /// Cut at the end of the support across the plane (Ohbuchi, Chen & Fuchs 1992)
    #[default]
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
    /// The mean, in which what was seen earlier counts less: see --decay
    Decay,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum DecayName {
    /// Not at all: the plain mean
    None,
    /// Exponentially from the first moment on
    Exp,
    /// Not for a while, then exponentially: a sweep is averaged as without decay
    #[default]
    DeadTime,
    /// By the formula as printed in Ohbuchi, Chen & Fuchs (1992), which keeps what came first; for experiments
    PaperLiteral,
}

impl Weighing {
    /// Puts the flags, and what the configuration says where they are silent, into the settings; returns where σ across the plane comes from.
    ///
    /// # Errors
    /// [`Failure`] when flags contradict each other.
    pub(super) fn apply(&self, config: &Config, settings: &mut Settings) -> Result<OffPlane, Failure> {
        settings.method = self.method();
        let support = self.support.or(self.leakage.map(|e| [Support::Energy(e); 2]));
        settings.support = support.map_or([None; 2], |ends| ends.map(Some));
        if support.is_some() && !settings.method.takes_support() {
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
            CompoundName::Decay => self.decay()?,
        };
        if self.compound != CompoundName::Decay {
            let unused = [
                (self.decay.is_some(), "--decay"),
                (self.decay_rate.is_some(), "--decay-rate"),
                (self.decay_wait.is_some(), "--decay-wait"),
            ];
            if let Some((_, flag)) = unused.iter().find(|(given, _)| *given) {
                return Err(Failure(format!("{flag}: nothing decays; add --compound decay, or leave the flag out")));
            }
        }
        Ok(off_plane)
    }

    fn decay(&self) -> Result<Compounding, Failure> {
        let rate_per_s = self.decay_rate.unwrap_or(DECAY_RATE);
        let wait_s = self.decay_wait.unwrap_or(DECAY_WAIT);
        let mode = self.decay.unwrap_or_default();
        let unused = match mode {
            DecayName::None => self.decay_rate.or(self.decay_wait),
            DecayName::Exp => self.decay_wait,
            DecayName::DeadTime | DecayName::PaperLiteral => None,
        };
        if unused.is_some() {
            let flag = if mode == DecayName::Exp { "--decay-wait" } else { "--decay-rate, --decay-wait" };
            return Err(Failure(format!("{flag}: means nothing to this --decay; leave it out, or choose dead-time")));
        }
        Ok(Compounding::Decay(match mode {
            DecayName::None => return Ok(Compounding::Mean),
            DecayName::Exp => Decay::Exponential { rate_per_s },
            DecayName::DeadTime => Decay::DeadTime { rate_per_s, wait_s },
            DecayName::PaperLiteral => Decay::PaperLiteral { rate_per_s, wait_s },
        }))
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
