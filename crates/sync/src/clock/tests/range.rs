//! Times and counts at any scale: tests are built with overflow checks, so a sum that leaves its
//! type fails here. Times must also follow from the published clock, and bounds be positive.

use proptest::prelude::*;

use super::*;

/// A step of a clock or a count: from one unit to a third of i64's range, either way.
fn step() -> impl Strategy<Value = i64> {
    prop_oneof![
        6 => (0_u32..62, 0_i64..1000).prop_map(|(bits, rest)| (1_i64 << bits) + (rest << bits) / 1000),
        1 => (0_u32..62).prop_map(|bits| -(1_i64 << bits)),
        1 => Just(0),
    ]
}

/// Settings of a device with this rate, wrapping count and delay.
fn settings(ticks: Ticks, hz: Option<f64>, wraps_at: Option<u64>, latency_ns: i64) -> ClockSettings {
    let timing = sonoweave_core::Timing { ticks, tick_hz: hz, rate_hz: hz, wraps_at, ..Default::default() };
    ClockSettings::new(&timing, latency_ns)
}

fn any_ticks() -> impl Strategy<Value = Ticks> {
    prop_oneof![Just(Ticks::None), Just(Ticks::Time), Just(Ticks::Measurements)]
}

fn any_rate() -> impl Strategy<Value = Option<f64>> {
    prop_oneof![Just(None), (-1.0_f64..9.5).prop_map(|exponent| Some(libm::pow(10.0, exponent)))]
}

fn any_wrap() -> impl Strategy<Value = Option<u64>> {
    prop_oneof![Just(None), (8_u32..64).prop_map(|bits| Some(1_u64 << bits)), Just(Some(u64::MAX))]
}

/// Pushes a sample and checks its time.
fn push(clock: &mut ClockMap, host_ns: i64, ticks: Option<u64>) -> Result<(), TestCaseError> {
    let timed = clock.push(host_ns, ticks);
    prop_assert!(timed.bound_ns >= 0);
    prop_assert_eq!(timed.time_ns, clock.mapping().time(timed.basis));
    prop_assert_eq!(timed.mapping, clock.mapping().number);
    prop_assert!(clock.mapping().ns_per_tick_q32 >= 0);
    Ok(())
}

proptest! {
    #[test]
    fn steps_of_any_size_give_times(
        ticks in any_ticks(), hz in any_rate(), wraps_at in any_wrap(), latency_ns in step(), first in any::<i64>(),
        steps in prop::collection::vec((step(), step()), 0..80),
    ) {
        let mut clock = ClockMap::new(settings(ticks, hz, wraps_at, latency_ns));
        let (mut host_ns, mut tick) = (first, 0_i64);
        for (passed, counted) in steps {
            (host_ns, tick) = (host_ns.saturating_add(passed), tick.saturating_add(counted));
            push(&mut clock, host_ns, Some(tick as u64))?;
            clock.advance(host_ns.saturating_add(passed));
        }
    }

    /// A steady device with pauses of any length, in which its clock runs on.
    #[test]
    fn years_of_silence_give_times(
        ticks in any_ticks(), period_ns in (0.0_f64..9.5).prop_map(|e| libm::pow(10.0, e) as i64), stated: bool,
        wraps_at in any_wrap(), drift in -0.35_f64..0.35, first in any::<i64>(),
        parts in prop::collection::vec((1_usize..30, step()), 1..8),
    ) {
        let hz = stated.then_some(1e9 / period_ns as f64);
        let mut clock = ClockMap::new(settings(ticks, hz, wraps_at, 0));
        let (mut host_ns, mut tick) = (first, 0_u64);
        let actual_ns = (period_ns as f64 * (1.0 + drift)) as i64;
        for (count, pause_ns) in parts {
            for _ in 0..count {
                (host_ns, tick) = (host_ns.saturating_add(actual_ns), tick.wrapping_add(1));
                push(&mut clock, host_ns, Some(wraps_at.map_or(tick, |at| tick % at)))?;
            }
            host_ns = host_ns.saturating_add(pause_ns);
            tick = tick.wrapping_add_signed(pause_ns / actual_ns.max(1));
            clock.advance(host_ns);
        }
    }

    /// Points anywhere, of the range that `ClockMap::point` gives.
    #[test]
    fn envelope_takes_points_of_whole_range(
        limit_ppb in 1_000_i64..=envelope::FREE_PPB, first in -(1_i64 << 62) + 1..1 << 62,
        steps in prop::collection::vec((step(), -(1_i64 << 62) + 1..1 << 62, 0_u32..62), 1..120),
    ) {
        let mut envelope = Envelope::new(limit_ppb);
        let most = (1_i64 << 62) - 1;
        let mut x = first;
        for (along, z, shift) in steps {
            // Half of the points lie near 0.
            x = x.saturating_add(along).clamp(-most, most);
            envelope.insert(Point { x, z: z >> shift });
            let doubt = envelope.doubt();
            prop_assert!((0..=UNKNOWN_NS).contains(&doubt.bound_ns), "{:?}", doubt);
            prop_assert!((0..=UNKNOWN_NS).contains(&doubt.spread_ns) && doubt.growth_ppb >= 0, "{:?}", doubt);
            let slope = envelope.line().map_or(0.0, Line::slope);
            prop_assert!(slope.abs() <= envelope.limit_ppb() as f64 * 1e-9 + 1e-15, "{}", slope);
        }
    }

    /// Any published clock, as a recording may contain it.
    #[test]
    fn recorded_mapping_gives_any_time(
        numbers in prop::collection::vec(prop_oneof![any::<i64>(), Just(i64::MAX), Just(i64::MIN)], 8),
        basis in any::<i64>(), at_ns in any::<i64>(),
    ) {
        let nothing = *ClockMap::new(settings(Ticks::Time, None, None, 0)).mapping();
        let [tick, time_ns, ns_per_tick_q32, bound_ns, bound_until_ns, growth_ppb, delay_ns, ticks] = numbers[..] else {
            unreachable!("eight");
        };
        let mapping =
            Mapping { tick, time_ns, ns_per_tick_q32, bound_ns, bound_until_ns, growth_ppb, delay_ns, ..nothing };
        mapping.bound(at_ns);
        mapping.time(Basis::Received(basis));
        let time = mapping.time(Basis::Ticks(ticks));
        prop_assert!(ticks != tick || time == time_ns);
    }
}
