//! Decay: older values count less when newer ones arrive at the same voxel.
//!
//! A voxel's sums are multiplied by d before a slice is added: r ← d·r + S and w ← d·w + W. d
//! falls from 1 with the time since the voxel was last written. Voxels that no slice reaches
//! keep their value, so decay needs no pass over the volume and no new rendering.
//!
//! - [`Decay::DeadTime`]: d = 1 for a while, then e^(−a·(dt − T)). A sweep passes over a voxel
//!   in the support's width divided by the probe's speed. During that time its slices are
//!   averaged as without decay; only later visits fade older values. Each voxel keeps its age,
//!   16 bits.
//! - [`Decay::Exponential`]: d = e^(−a·dt). Within one sweep this favours the later slices: in
//!   a sweep of speed v, each voxel shows the scene about a·σ²/v further along. Implemented as
//!   forward decay (Cormode et al. 2009): instead of dividing older sums, new ones are
//!   multiplied by e^(a·(t − t₀)), with one t₀ per brick.
//! - [`Decay::PaperLiteral`]: r ← d·r + (1 − d)·S as Ohbuchi, Chen & Fuchs (1992) print it. A
//!   slice that follows immediately has weight 0, and a voxel keeps the first sample that
//!   touched it. For experiments.
//!
//! A slice that gives a voxel less than [`LEAST_TOUCH`] of a slice's weight does not change it.
//! Such a touch would either refresh the age and stop the fading, or fade the older values anew
//! each time.

use serde::{Deserialize, Serialize};

use volume::brick::VOXELS;
use volume::brick_volume::SEEN;
use volume::memory::Epoch;

/// A numerator smaller than this becomes 0. Otherwise it could shrink to a subnormal number,
/// where bright values are followed by black and are faded or clamped for long. Such numbers
/// slow down every later slice (measured: inserts up to 2.3 times) and never become zero.
pub(crate) const LEAST_SUM: f32 = 1e-30;

/// Rule by which older values fade.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Decay {
    /// Immediately, at `rate_per_s`.
    Exponential {
        /// a, 1/s.
        rate_per_s: f64,
    },
    /// After `wait_s`, at `rate_per_s`.
    DeadTime {
        /// a, 1/s.
        rate_per_s: f64,
        /// T, s.
        wait_s: f64,
    },
    /// The formula as printed in the paper, with the factor of [`Decay::DeadTime`].
    PaperLiteral {
        /// a, 1/s.
        rate_per_s: f64,
        /// T, s.
        wait_s: f64,
    },
}

/// Reason why a decay cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum DecayError {
    /// Not positive, or too fast or slow for the time resolution.
    #[error("the decay's rate must lie between 1e-6 and 1e6 per second, not at {0}")]
    Rate(f64),
    /// Negative or too long.
    #[error("the decay's wait must lie between 0 and 1e6 seconds, not at {0}")]
    Wait(f64),
}

/// Least weight that changes a voxel under decay, relative to a slice's weight at its peak.
pub const LEAST_TOUCH: f32 = 2.0 * SEEN;

/// A factor of decay below this is zero.
pub(crate) const LEAST_FACTOR: f32 = 1e-20;

/// Weight that forward decay leaves of a voxel of any age: negligible beside new values, but
/// its value remains.
const LEAST_MEMORY: f32 = 1e-15;

/// Forward decay moves a brick's t₀ when a·(t − t₀) exceeds this: e⁴⁰ is far below the largest
/// f32.
const MOST_EXPONENT: f64 = 40.0;

/// A time step beyond this means that the clock was set, not a pause.
const MOST_STEP_NS: i128 = 86_400_000_000_000;
/// A time earlier than the newest by more than this means that the clock was set back, not a
/// slice out of order.
const MOST_LATENESS_NS: i128 = 10_000_000_000;

impl Decay {
    /// The name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Exponential { .. } => "exp",
            Self::DeadTime { .. } => "dead-time",
            Self::PaperLiteral { .. } => "paper-literal",
        }
    }

    /// a, 1/s.
    pub fn rate_per_s(self) -> f64 {
        let (Self::Exponential { rate_per_s }
        | Self::DeadTime { rate_per_s, .. }
        | Self::PaperLiteral { rate_per_s, .. }) = self;
        rate_per_s
    }

    /// T, s.
    pub fn wait_s(self) -> f64 {
        match self {
            Self::Exponential { .. } => 0.0,
            Self::DeadTime { wait_s, .. } | Self::PaperLiteral { wait_s, .. } => wait_s,
        }
    }

    /// d after `seconds`.
    pub fn factor(self, seconds: f64) -> f64 {
        libm::exp(-self.rate_per_s() * (seconds - self.wait_s()).max(0.0))
    }

    /// # Errors
    /// [`DecayError`] when a number is out of range.
    pub fn check(self) -> Result<(), DecayError> {
        if !(1e-6..=1e6).contains(&self.rate_per_s()) {
            return Err(DecayError::Rate(self.rate_per_s()));
        }
        if !(0.0..=1e6).contains(&self.wait_s()) {
            return Err(DecayError::Wait(self.wait_s()));
        }
        Ok(())
    }
}

/// Time since the first slice, robust against irregular stamps. It never runs backwards: a
/// slice out of order counts as one of the newest time, and a set clock counts as a step of at
/// most a day.
#[derive(Debug, Clone, Copy, Default)]
pub struct DecayClock {
    newest_ns: Option<i64>,
    elapsed_ns: i64,
    /// Slices whose time was earlier than the newest before them.
    pub backwards: u64,
    /// Slices whose time was more than a day after the newest before them, or more than ten
    /// seconds before it.
    pub absurd: u64,
}

impl DecayClock {
    /// Returns the clock after a slice of the given time.
    #[must_use]
    pub fn after(mut self, time_ns: i64) -> Self {
        let step = i128::from(time_ns) - i128::from(self.newest_ns.unwrap_or(time_ns));
        self.backwards += u64::from(step < 0);
        self.absurd += u64::from(!(-MOST_LATENESS_NS..=MOST_STEP_NS).contains(&step));
        // A slice out of order leaves the newest time unchanged.
        if !(-MOST_LATENESS_NS..0).contains(&step) {
            self.newest_ns = Some(time_ns);
            // At most a day, so that a hundred thousand steps still fit.
            self.elapsed_ns = self.elapsed_ns.saturating_add(step.clamp(0, MOST_STEP_NS) as i64);
        }
        self
    }

    /// Time since the first slice, ns.
    pub fn elapsed_ns(&self) -> i64 {
        self.elapsed_ns
    }
}

/// A decay in the units of the hot loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Fading {
    pub(crate) decay: Decay,
    /// Duration of a tick of a voxel's age, ns.
    tick_ns: i64,
    /// T in ticks.
    pub(crate) wait: f32,
    /// log₂ d of one tick more.
    pub(crate) per_tick: f32,
}

/// Effect of one slice on the times of one brick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct EpochChange {
    /// The brick's new epoch.
    pub(crate) epoch: Epoch,
    /// Factor for the slice's weights (forward decay).
    pub(crate) gain: f32,
    /// Factor for the brick's sums before insertion (forward decay); 1 for none.
    pub(crate) rebase: f32,
    /// The slice's time, in ticks since the epoch's base.
    pub(crate) now: u16,
    /// Ticks by which the voxels' ages are shifted before insertion.
    pub(crate) shift: u16,
}

impl EpochChange {
    /// Without decay.
    pub(crate) const NONE: Self =
        Self { epoch: Epoch { base_ns: 0, touched_ns: 0 }, gain: 1.0, rebase: 1.0, now: 0, shift: 0 };

    /// Whether the brick's base moves, and with it everything counted from it.
    pub(crate) fn moves(&self) -> bool {
        self.rebase != 1.0 || self.shift > 0
    }
}

impl Fading {
    pub(crate) fn new(decay: Decay) -> Self {
        // Fine relative to 1/a, so that rounding a time to ticks changes d by at most 1/2000.
        // Coarse enough that half the range of 16 bits outlasts both the wait and 16/a.
        let tick_s = (1.0 / (2048.0 * decay.rate_per_s())).max(decay.wait_s() / 16384.0);
        let tick_ns = ((tick_s * 1e9) as i64).max(1);
        let tick_s = tick_ns as f64 * 1e-9;
        Self {
            decay,
            tick_ns,
            wait: (decay.wait_s() / tick_s) as f32,
            per_tick: (-decay.rate_per_s() * tick_s * std::f64::consts::LOG2_E) as f32,
        }
    }

    /// Whether voxels keep ages, rather than only bricks.
    pub(crate) fn keeps_ages(&self) -> bool {
        !matches!(self.decay, Decay::Exponential { .. })
    }

    /// Returns the epoch and the age, in its ticks, of a voxel written at `written_ns`, in a
    /// brick created at `elapsed_ns`.
    pub(crate) fn dated(&self, written_ns: i64, elapsed_ns: i64) -> (Epoch, u16) {
        let base_ns = elapsed_ns - i64::from(u16::MAX) * self.tick_ns;
        let ticks = ((written_ns - base_ns) / self.tick_ns).clamp(0, i64::from(u16::MAX));
        (Epoch { base_ns, touched_ns: elapsed_ns }, ticks as u16)
    }

    /// Returns the factor that forward decay leaves at `elapsed_ns` of a voxel that had weight
    /// `w` when it was written.
    pub(crate) fn left(&self, written_ns: i64, elapsed_ns: i64, w: f32) -> f32 {
        (self.decay.factor((elapsed_ns - written_ns) as f64 * 1e-9) as f32).max(LEAST_MEMORY / w)
    }

    /// Computes the effect of a slice at `elapsed_ns` on a brick of the given epoch.
    pub(crate) fn epoch_change(&self, mut epoch: Epoch, elapsed_ns: i64) -> EpochChange {
        let since_ns = elapsed_ns - epoch.base_ns;
        epoch.touched_ns = elapsed_ns;
        if self.keeps_ages() {
            let ticks = since_ns / self.tick_ns;
            let most = i64::from(u16::MAX);
            let shift = if ticks > most { ticks - (most + 1) / 2 } else { 0 };
            epoch.base_ns += shift * self.tick_ns;
            // Ages beyond the range are clamped to it: by then d is below 1e-7.
            let saturated = u16::try_from(shift).unwrap_or(u16::MAX);
            return EpochChange { epoch, now: (ticks - shift) as u16, shift: saturated, ..EpochChange::NONE };
        }
        let exponent = self.decay.rate_per_s() * since_ns as f64 * 1e-9;
        if exponent <= MOST_EXPONENT {
            EpochChange { epoch, gain: libm::exp(exponent) as f32, ..EpochChange::NONE }
        } else {
            epoch.base_ns = elapsed_ns;
            EpochChange { epoch, rebase: libm::exp(-exponent) as f32, ..EpochChange::NONE }
        }
    }
}

/// Multiplies a brick's sums by `factor`, and keeps their ratio if the weight would vanish.
pub(crate) fn rebase(r: &mut [f32; VOXELS], w: &mut [f32; VOXELS], factor: f32) {
    for (r, w) in r.iter_mut().zip(w).filter(|(_, w)| **w > 0.0) {
        let factor = factor.max(LEAST_MEMORY / *w);
        let sum = *r * factor;
        *r = if sum.abs() <= LEAST_SUM { 0.0 } else { sum };
        *w *= factor;
    }
}

/// Shifts ages back.
pub(crate) fn shift(ages: &mut [u16; VOXELS], by: u16) {
    for age in ages {
        *age = age.saturating_sub(by);
    }
}
