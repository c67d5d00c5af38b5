//! Weighting and compounding of slices, shared by flags and files.

use clap::ValueEnum;

use reconstruct::kernel::{Method, Support, sigma_from_hwhm};
use reconstruct::{Compounding, Decay, Settings, ShadowWeights};

use super::Error;

/// Default rate of decay, 1/s.
pub const DECAY_RATE: f64 = 1.0;
/// Default wait, s. A slow sweep at 5 mm/s passes the default support of 2.6 mm to either side
/// in half of it.
pub const DECAY_WAIT: f64 = 2.0;

/// Compounding of slices that reach the same voxel.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum CompoundName {
    /// Their weighted mean
    #[default]
    Mean,
    /// The brightest of those that pass within half a voxel or the kernel's half width
    Maximum,
    /// The latest of those, by the frames' times
    Latest,
    /// The mean with less weight for earlier slices: see --decay
    Decay,
}

/// Fading of the past.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum DecayName {
    /// Not at all: the plain mean
    None,
    /// Exponentially from the first moment on
    Exp,
    /// Exponentially after a waiting time: a sweep is averaged as without decay
    #[default]
    DeadTime,
    /// By the formula as printed in Ohbuchi, Chen & Fuchs (1992), which preserves the earliest
    /// values; for experiments
    PaperLiteral,
}

/// Kernel and compounding; `None` for a setting that was not given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weighing {
    /// The kernel.
    pub method: Method,
    /// σ along u, v and the slice's normal, mm.
    pub sigma_mm: Option<[f64; 3]>,
    /// The same as half widths at half maximum.
    pub hwhm_mm: Option<[f64; 3]>,
    /// End of a Gaussian, in the plane and across it.
    pub support: Option<[Support; 2]>,
    /// Largest weight of a voxel, slices.
    pub max_weight: f64,
    /// Compounding of slices that reach the same voxel.
    pub compound: CompoundName,
    /// Fading of the past.
    pub decay: Option<DecayName>,
    /// Rate of fading, 1/s.
    pub decay_rate: Option<f64>,
    /// Time before fading begins, s.
    pub decay_wait: Option<f64>,
    /// Whether slices are weighted by the gaps beside them.
    pub gap_weights: bool,
    /// Whether pixels are weighted by their shadows.
    pub shadow_weights: bool,
}

impl Weighing {
    /// Puts this into the settings. Without a given kernel width, σ across the plane is the
    /// calibration's resolution, if it has one.
    ///
    /// # Errors
    /// [`Error::Setting`] when settings contradict each other.
    pub fn apply(&self, calibrated_hwhm_mm: Option<[f64; 3]>, settings: &mut Settings) -> Result<(), Error> {
        settings.method = self.method;
        settings.support = self.support.map_or([None; 2], |ends| ends.map(Some));
        if self.support.is_some() && !self.method.takes_support() {
            return Err(Error::setting(
                "support",
                format!(
                    "the kernel {} has a fixed support; leave it out, or choose the method gaussian",
                    self.method.name()
                ),
            ));
        }
        if self.sigma_mm.is_some() && self.hwhm_mm.is_some() {
            return Err(Error::setting(
                "sigma",
                "the kernel's width is given twice, as σ and as resolution; give one of them",
            ));
        }
        let given = self.sigma_mm.or(self.hwhm_mm.map(|hwhm| hwhm.map(sigma_from_hwhm)));
        settings.sigma_mm = match (given, calibrated_hwhm_mm) {
            (Some(sigma), _) => sigma.map(Some),
            (None, Some(hwhm)) => [None, None, Some(sigma_from_hwhm(hwhm[2]))],
            (None, None) => [None; 3],
        };
        settings.max_weight = self.max_weight;
        settings.compounding = self.compounding()?;
        settings.gap_weights = self.gap_weights;
        settings.shadow_weights = self.shadow_weights.then(ShadowWeights::default);
        let weights = [(self.gap_weights, "gap_weights", "gap"), (self.shadow_weights, "shadow_weights", "shadow")];
        if let Some((_, setting, of)) = weights.into_iter().find(|(is_given, ..)| *is_given)
            && settings.compounding.selects()
        {
            return Err(Error::setting(
                setting,
                format!(
                    "{of} weights are those of a mean; leave them out, or choose the compounding mean instead of {}",
                    settings.compounding.name()
                ),
            ));
        }
        Ok(())
    }

    fn compounding(&self) -> Result<Compounding, Error> {
        if self.compound != CompoundName::Decay {
            let unused = [
                (self.decay.is_some(), "decay"),
                (self.decay_rate.is_some(), "decay_rate"),
                (self.decay_wait.is_some(), "decay_wait"),
            ];
            if let Some((_, setting)) = unused.iter().find(|(given, _)| *given) {
                return Err(Error::setting(setting, "needs the compounding decay; choose it, or leave this out"));
            }
        }
        match self.compound {
            CompoundName::Mean => Ok(Compounding::Mean),
            CompoundName::Maximum => Ok(Compounding::Maximum),
            CompoundName::Latest => Ok(Compounding::Latest),
            CompoundName::Decay => self.decay(),
        }
    }

    fn decay(&self) -> Result<Compounding, Error> {
        let rate_per_s = self.decay_rate.unwrap_or(DECAY_RATE);
        let wait_s = self.decay_wait.unwrap_or(DECAY_WAIT);
        let mode = self.decay.unwrap_or_default();
        let unused = match mode {
            DecayName::None => self.decay_rate.or(self.decay_wait),
            DecayName::Exp => self.decay_wait,
            DecayName::DeadTime | DecayName::PaperLiteral => None,
        };
        if unused.is_some() {
            let setting = if mode == DecayName::Exp { "decay_wait" } else { "decay_rate, decay_wait" };
            return Err(Error::setting(setting, "has no effect with this decay; leave it out, or choose dead-time"));
        }
        Ok(Compounding::Decay(match mode {
            DecayName::None => return Ok(Compounding::Mean),
            DecayName::Exp => Decay::Exponential { rate_per_s },
            DecayName::DeadTime => Decay::DeadTime { rate_per_s, wait_s },
            DecayName::PaperLiteral => Decay::PaperLiteral { rate_per_s, wait_s },
        }))
    }
}
