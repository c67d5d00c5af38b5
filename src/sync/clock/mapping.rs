//! A clock as it is published: whole numbers, so that whoever holds them gets the same times, bit for bit.

use serde::{Deserialize, Serialize};

/// How far a clock is to be believed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum State {
    /// Too little was received since it began, or its bound is too wide.
    #[default]
    Acquiring,
    /// Timely samples come, and the bound is narrow.
    Locked,
    /// Nothing timely has come for a while: the clock goes on by its rate, and its bound grows.
    Holdover,
    /// For so long that the bound says nothing.
    Lost,
}

impl State {
    /// One word.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Acquiring => "acquiring",
            Self::Locked => "locked",
            Self::Holdover => "holdover",
            Self::Lost => "lost",
        }
    }
}

/// From a device's ticks to host time. Valid from its publication to the next one's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mapping {
    /// Counts the publications of a clock, from 0.
    pub number: u64,
    /// Counts the beginnings of its device's ticks: ticks of different epochs do not belong together.
    pub epoch: u32,
    /// How far it is to be believed.
    pub state: State,
    /// Host time of the sample, or the moment, that made it, ns.
    pub published_ns: i64,
    /// A tick, unwrapped,
    pub tick: i64,
    /// when it was, host ns,
    pub time_ns: i64,
    /// and ns from each tick to the next, in units of 2⁻³² ns; 0 while nothing is known of ticks.
    pub ns_per_tick_q32: i64,
    /// How much faster the host's clock runs than the device's says, by its nominal rate, parts in 10⁹.
    pub drift_ppb: i64,
    /// How far the truth may lie from it, ns, up to `bound_until_ns`,
    pub bound_ns: i64,
    /// host ns,
    pub bound_until_ns: i64,
    /// and what is added after that, parts in 10⁹ of the time that has passed.
    pub growth_ppb: i64,
    /// What is known to lie between measurement and receipt, ns: for what is timed by its receipt.
    pub delay_ns: i64,
}

/// What a time was made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Basis {
    /// The device's ticks, unwrapped or inferred.
    Ticks(i64),
    /// The time of receipt, host ns.
    Received(i64),
}

impl Mapping {
    /// The time of what was measured, host ns.
    pub fn time(&self, basis: Basis) -> i64 {
        match basis {
            Basis::Ticks(tick) => {
                let ticks = i128::from(tick) - i128::from(self.tick);
                // To the nearest, halves up.
                let away = (ticks * i128::from(self.ns_per_tick_q32) + (1 << 31)) >> 32;
                clamped(i128::from(self.time_ns) + away)
            }
            Basis::Received(host_ns) => host_ns.saturating_sub(self.delay_ns),
        }
    }

    /// How far the truth may lie from a time given by ticks, ns.
    pub fn bound(&self, time_ns: i64) -> i64 {
        let after = i128::from(time_ns) - i128::from(self.bound_until_ns);
        clamped(i128::from(self.bound_ns) + after.max(0) * i128::from(self.growth_ppb) / 1_000_000_000)
    }

    /// Parts in a million by which the device's clock is slow: its ticks last so much longer than they should.
    pub fn drift_ppm(&self) -> f64 {
        self.drift_ppb as f64 * 1e-3
    }
}

/// The nearest i64.
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
    fn ticks_become_times_to_the_nearest_nanosecond() {
        assert_eq!(MAPPING.time(Basis::Ticks(1000)), 4_999_000_000);
        assert_eq!(MAPPING.time(Basis::Ticks(1240)), 5_999_000_000);
        assert_eq!(MAPPING.time(Basis::Ticks(997)), 4_999_000_000 - 12_500_000);
        assert_eq!(MAPPING.time(Basis::Received(90_000_000)), 82_000_000);
        assert_eq!(MAPPING.time(Basis::Ticks(i64::MAX)), i64::MAX, "no overflow");
    }

    #[test]
    fn the_bound_grows_once_its_time_is_over() {
        assert_eq!(MAPPING.bound(4_000_000_000), 40_000);
        assert_eq!(MAPPING.bound(15_000_000_000), 240_000);
    }

    proptest! {
        #[test]
        fn a_recorded_mapping_is_the_same_mapping(
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
