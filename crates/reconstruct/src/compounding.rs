//! Compounding: combination of the slices that reach the same voxel.

use serde::{Deserialize, Serialize};

use volume::BrickVolume;
use volume::brick_volume::Slot;
use volume::memory::Memory;

use super::decay::{Decay, DecayError, EpochChange, Fading};

/// Rule by which slices that reach a voxel determine its value.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Compounding {
    /// The mean, weighted by the kernel (Ohbuchi, Chen & Fuchs 1992).
    #[default]
    Mean,
    /// The largest of the in-plane filtered values: keeps bright reflectors.
    Maximum,
    /// The in-plane filtered value of the slice with the latest time. Among slices at one time,
    /// to a ten-thousandth of a second, the one inserted last counts.
    Latest,
    /// The mean, with older values fading.
    Decay(Decay),
}

impl Compounding {
    /// The name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mean => "mean",
            Self::Maximum => "maximum",
            Self::Latest => "latest",
            Self::Decay(_) => "decay",
        }
    }

    /// Whether one slice is chosen for each voxel. Then a slice counts only within half a voxel
    /// or the kernel's half width at half maximum, whichever is more. All such slices have
    /// equal weight.
    pub fn selects(self) -> bool {
        matches!(self, Self::Maximum | Self::Latest)
    }
}

impl std::fmt::Display for Compounding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Decay(decay) => {
                write!(f, "decay {} {:?} 1/s after {:?} s", decay.name(), decay.rate_per_s(), decay.wait_s())
            }
            _ => f.write_str(self.name()),
        }
    }
}

/// The way a value enters a voxel: [`Compounding`] in the form that the hot loop needs.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Entry {
    Mean,
    /// The mean, with sums of squares beside it.
    MeanAndSquares,
    Maximum,
    Latest,
    Decay(Fading),
}

impl Entry {
    /// # Errors
    /// [`DecayError`] for a decay that cannot be used.
    pub(crate) fn of(compounding: Compounding) -> Result<Self, DecayError> {
        Ok(match compounding {
            Compounding::Mean => Self::Mean,
            Compounding::Maximum => Self::Maximum,
            Compounding::Latest => Self::Latest,
            Compounding::Decay(decay) => {
                decay.check()?;
                Self::Decay(Fading::new(decay))
            }
        })
    }

    /// Computes the effect of a slice at `elapsed_ns` on a brick's times.
    pub(crate) fn epoch_change(self, volume: &BrickVolume, slot: Slot, elapsed_ns: i64) -> EpochChange {
        match self {
            Self::Decay(fading) => fading.epoch_change(volume.epoch(slot), elapsed_ns),
            Self::Mean | Self::MeanAndSquares | Self::Maximum | Self::Latest => EpochChange::NONE,
        }
    }

    /// Data that a volume must keep for it.
    pub(crate) fn memory(self) -> Memory {
        match self {
            Self::Mean | Self::Maximum => Memory::Sums,
            Self::MeanAndSquares => Memory::Squares,
            Self::Latest => Memory::Stamps,
            Self::Decay(fading) if fading.keeps_ages() => Memory::Ages,
            Self::Decay(fading) => Memory::Epochs { rate_per_s: fading.decay.rate_per_s() },
        }
    }
}

/// Duration of a tick of a voxel's time stamp, ns.
const TICK_NS: i128 = 100_000;
/// Stamp of the first slice: halfway, so that equal time fits before and after it.
const FIRST: i128 = 1 << 31;

/// Converts times into the stamps that voxels keep: 32-bit ticks, up to 59 hours on either side
/// of the first slice.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct StampClock {
    first_ns: Option<i64>,
}

impl StampClock {
    /// Returns the stamp of a time; `None` if it is out of range. Never 0, which marks unseen
    /// voxels.
    pub(crate) fn stamp(&self, time_ns: i64) -> Option<u32> {
        let since = i128::from(time_ns) - i128::from(self.first_ns.unwrap_or(time_ns));
        u32::try_from(since.div_euclid(TICK_NS) + FIRST).ok().filter(|stamp| *stamp > 0)
    }

    /// Sets the time of the first slice, unless it is set already.
    pub(crate) fn start(&mut self, time_ns: i64) {
        self.first_ns.get_or_insert(time_ns);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_keep_order_of_times_for_any_start() {
        for first in [0, -5, 1_763_700_000_000_000_000, i64::MIN, i64::MAX] {
            let mut clock = StampClock::default();
            assert_eq!(clock.stamp(first), Some(1 << 31));
            clock.start(first);
            clock.start(first.wrapping_add(77));
            let at = |after_ns: i64| first.checked_add(after_ns).and_then(|t| clock.stamp(t));
            let hour = 3_600_000_000_000;
            for (earlier, later) in [(-59 * hour, -1), (-1, 0), (0, 100_000), (100_000, 59 * hour)] {
                if let (Some(a), Some(b)) = (at(earlier), at(later)) {
                    assert!(a < b, "{first}: {earlier} {later}");
                }
            }
            assert!(at(60 * hour).is_none() && at(-60 * hour).is_none());
            assert_eq!(at(99_999), first.checked_add(99_999).map(|_| 1 << 31));
        }
    }
}
