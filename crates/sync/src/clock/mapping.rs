//! A published clock, in integers, so that every user computes the same times, bit for bit.

use serde::{Deserialize, Serialize};

/// Reliability of a clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum State {
    /// Too little was received since the start, or the bound is too wide.
    #[default]
    Acquiring,
    /// Timely samples arrive, and the bound is narrow.
    Locked,
    /// Nothing timely has arrived for a while: the clock runs on its last rate, and its bound
    /// grows.
    Holdover,
    /// Nothing has arrived for so long that the bound is meaningless.
    Lost,
}

impl State {
    /// Name of the state.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Acquiring => "acquiring",
            Self::Locked => "locked",
            Self::Holdover => "holdover",
            Self::Lost => "lost",
        }
    }
}

/// Maps a device's ticks to host time. Valid from its publication to the next one's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mapping {
    /// Number of the publication, from 0.
    pub number: u64,
    /// Number of the epoch. An epoch begins when the device's ticks restart; ticks of different
    /// epochs are unrelated.
    pub epoch: u32,
    /// Reliability of the clock.
    pub state: State,
    /// Host time of the sample, or the moment, that caused the publication, ns.
    pub published_ns: i64,
    /// Reference tick, unwrapped.
    pub tick: i64,
    /// Time of the reference tick, host ns.
    pub time_ns: i64,
    /// Time from each tick to the next, in 2⁻³² ns; 0 while nothing is known of ticks.
    pub ns_per_tick_q32: i64,
    /// Rate of the host's clock relative to the device's nominal rate, minus 1, parts in 10⁹.
    pub drift_ppb: i64,
    /// Bound on the error up to `bound_until_ns`, ns.
    pub bound_ns: i64,
    /// Host time up to which `bound_ns` holds, ns.
    pub bound_until_ns: i64,
    /// Growth of the bound after that, parts in 10⁹ of the elapsed time.
    pub growth_ppb: i64,
    /// Known delay between measurement and receipt, ns, for times taken from the receipt.
    pub delay_ns: i64,
}

/// Basis of a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Basis {
    /// The device's ticks, unwrapped or inferred.
    Ticks(i64),
    /// The time of receipt, host ns.
    Received(i64),
}

impl Mapping {
    /// Time of a measurement, host ns.
    pub fn time(&self, basis: Basis) -> i64 {
        match basis {
            Basis::Ticks(tick) => {
                let ticks = i128::from(tick) - i128::from(self.tick);
                // Rounded to the nearest, halves up.
                let away = (ticks * i128::from(self.ns_per_tick_q32) + (1 << 31)) >> 32;
                clamped(i128::from(self.time_ns) + away)
            }
            Basis::Received(host_ns) => host_ns.saturating_sub(self.delay_ns),
        }
    }

    /// Bound on the error of a time given by ticks, ns.
    pub fn bound(&self, time_ns: i64) -> i64 {
        let after = i128::from(time_ns) - i128::from(self.bound_until_ns);
        clamped(i128::from(self.bound_ns) + after.max(0) * i128::from(self.growth_ppb) / 1_000_000_000)
    }

    /// Drift of the device's clock, parts in a million; positive if its ticks are too long.
    pub fn drift_ppm(&self) -> f64 {
        self.drift_ppb as f64 * 1e-3
    }
}

/// Returns the nearest i64.
pub(super) fn clamped(wide: i128) -> i64 {
    i64::try_from(wide).unwrap_or(if wide > 0 { i64::MAX } else { i64::MIN })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MAPPING: Mapping = Mapping {
        number: 7,
        epoch: 1,
        state: State::Locked,
        published_ns: 5_000_000_000,
        tick: 1000,
        time_ns: 4_999_000_000,
        // 240 Hz: 4166666.67 ns.
        ns_per_tick_q32: (4_166_666_i64 << 32) + 2_863_311_531,
        drift_ppb: 12_000,
        bound_ns: 40_000,
        bound_until_ns: 5_000_000_000,
        growth_ppb: 20_000,
        delay_ns: 8_000_000,
    };

    #[test]
    fn ticks_map_to_nearest_nanosecond() {
        assert_eq!(MAPPING.time(Basis::Ticks(1000)), 4_999_000_000);
        assert_eq!(MAPPING.time(Basis::Ticks(1240)), 5_999_000_000);
        assert_eq!(MAPPING.time(Basis::Ticks(997)), 4_999_000_000 - 12_500_000);
        assert_eq!(MAPPING.time(Basis::Received(90_000_000)), 82_000_000);
        assert_eq!(MAPPING.time(Basis::Ticks(i64::MAX)), i64::MAX, "no overflow");
    }

    #[test]
    fn bound_grows_after_its_end() {
        assert_eq!(MAPPING.bound(4_000_000_000), 40_000);
        assert_eq!(MAPPING.bound(15_000_000_000), 240_000);
    }

    proptest! {
        #[test]
        fn mapping_survives_recording(
            tick: i64, time_ns: i64, rate in 0_i64..1 << 60, bound in 0_i64..1 << 40, ticks in prop::collection::vec(any::<i64>(), 8),
        ) {
            let mapping = Mapping { tick, time_ns, ns_per_tick_q32: rate, bound_ns: bound, ..MAPPING };
            let again: Mapping = serde_json::from_str(&serde_json::to_string(&mapping).unwrap()).unwrap();
            prop_assert_eq!(again, mapping);
            for tick in ticks {
                prop_assert_eq!(again.time(Basis::Ticks(tick)), mapping.time(Basis::Ticks(tick)));
            }
        }
    }
}
