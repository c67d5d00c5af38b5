#![allow(clippy::print_stdout, reason = "figures of the simulation, for who asks with --nocapture")]

use super::simulation::{DELAY_NS, Device, Jitter, MS, Run, SECOND, Sample};
use super::*;

const STATES: [State; 3] = [State::Acquiring, State::Locked, State::Holdover];

/// In every state except lost, the truth lies within the bound for at least 99 of 100 samples.
fn check(name: &str, run: &Run) {
    for state in STATES {
        let [count, within] = run.within(state);
        let [rms, bias, bound] = run.errors_ms(state);
        if count > 0 {
            println!(
                "{name}, {}: {count} samples, {:.2} % within; error {rms:.3} ms rms, {bias:+.3} mean, bound {bound:.3} ms",
                state.word(),
                100.0 * within as f64 / count as f64,
            );
        }
    }
    for state in STATES {
        let [count, within] = run.within(state);
        assert!(within * 100 >= count * 99, "{name}, {}: {within} of {count}", state.word());
    }
    assert_eq!(run.clock.work().coarsened, 0, "{name}");
}

const JITTERS: [(&str, Jitter); 8] = [
    ("no jitter", Jitter::None),
    ("uniform 4 ms", Jitter::Uniform(4 * MS)),
    ("uniform 40 ms", Jitter::Uniform(40 * MS)),
    ("exponential 1 ms", Jitter::Exponential(MS)),
    ("exponential 10 ms", Jitter::Exponential(10 * MS)),
    ("packets of 16 ms", Jitter::Packets(16 * MS)),
    ("stalls", Jitter::Stalls(MS, 0.2)),
    ("late by 200 ms", Jitter::Late(MS, 0.1)),
];

#[test]
fn truth_within_bound_for_all_devices_and_delays() {
    let devices = [
        ("LIBERTY", Device::LIBERTY),
        ("EA1", Device::EA1),
        ("grabber", Device::GRABBER),
        ("FASTRAK", Device::FASTRAK),
    ];
    for (kind, device) in devices {
        for (name, jitter) in JITTERS {
            for (seed, drift_ppm) in [(1, 100.0), (2, -100.0), (3, 0.0)] {
                let device = Device { seed, jitter, drift_ppm, ..device };
                let run = Run::of(device.settings(), &device.samples(60));
                check(&format!("{kind}, {name}, {drift_ppm} ppm"), &run);
            }
        }
    }
}

/// A minute of a LIBERTY, with every sample from the middle on changed.
fn changed(device: Device, change: impl Fn(usize, &mut Sample)) -> Run {
    let mut samples = device.samples(60);
    let middle = samples.len() / 2;
    samples[middle..].iter_mut().enumerate().for_each(|(n, sample)| change(n, sample));
    Run::of(device.settings(), &samples)
}

#[test]
fn counter_wrap_changes_nothing() {
    for wraps_at in [1 << 32, 1 << 16, 3000] {
        let device = Device { wraps_at: Some(wraps_at), ..Device::LIBERTY };
        let plain = Run::of(device.settings(), &Device { first_tick: 0, wraps_at: None, ..device }.samples(30));
        let wrapped = Run::of(device.settings(), &Device { first_tick: wraps_at - 200, ..device }.samples(30));
        let times = |run: &Run| run.timed.iter().map(|(_, timed, _)| timed.time_ns).collect::<Vec<_>>();
        assert_eq!(times(&plain), times(&wrapped));
        assert_eq!(wrapped.clock.mapping().epoch, 0);
    }
}

#[test]
fn counter_wrap_during_silence_counted() {
    // 4096 counts at 240 Hz are 17 s; 40 s are missing.
    let device = Device { wraps_at: Some(4096), ..Device::LIBERTY };
    let mut samples = device.samples(80);
    samples.retain(|sample| !(13 * SECOND..53 * SECOND).contains(&sample.true_ns));
    let run = Run::of(device.settings(), &samples);
    check("40 s of silence", &run);
    assert_eq!(run.clock.mapping().epoch, 0);
}

#[test]
fn unit_reset_begins_new_epoch() {
    let counted = [("LIBERTY", Device::LIBERTY), ("EA1", Device::EA1), ("grabber", Device::GRABBER)];
    for (name, device) in counted {
        let start = device.samples(60).len() / 2;
        let first = device.samples(60)[start].ticks.unwrap();
        let run = changed(device, |_, sample| sample.ticks = sample.ticks.map(|ticks| ticks - first));
        check(&format!("{name}, reset"), &run);
        assert_eq!(run.clock.mapping().epoch, 1, "{name}");
        assert_eq!(run.clock.state(), State::Locked);
    }
}

#[test]
fn clock_steps_are_followed() {
    // The count steps by half a second; the host's time by 30 ms to half a second.
    for ticks in [120_i64, 12, -12, -120] {
        let run = changed(Device::LIBERTY, |_, s| s.ticks = s.ticks.map(|t| t.wrapping_add_signed(ticks)));
        check(&format!("{ticks} ticks"), &run);
        let [locked, _] = run.within(State::Locked);
        assert!(locked > 11_000, "{ticks}: {locked}");
        let last = run.timed.last().unwrap();
        assert!((last.1.time_ns - last.0.true_ns).abs() < MS, "{ticks}");
    }
    for ms in [500, 30, -30, -500] {
        let run = changed(Device::LIBERTY, |_, sample| {
            // The truth is given on the host's clock.
            sample.host_ns += ms * MS;
            sample.true_ns += ms * MS;
        });
        let wrong =
            |(sample, timed, _): &&(Sample, Timed, State)| (timed.time_ns - sample.true_ns).abs() > timed.bound_ns;
        let dishonest = run.timed.iter().filter(wrong).count();
        println!("host by {ms} ms: {dishonest} of {} outside their bound", run.timed.len());
        assert!(dishonest * 100 < run.timed.len(), "{ms}: {dishonest}");
        let last = run.timed.last().unwrap();
        assert!((last.1.time_ns - last.0.true_ns).abs() < MS, "{ms}");
        assert_eq!(run.clock.state(), State::Locked);
    }
}

#[test]
fn silence_gives_holdover_then_lost() {
    for (name, device) in [("LIBERTY", Device::LIBERTY), ("FASTRAK", Device::FASTRAK), ("grabber", Device::GRABBER)] {
        let mut clock = ClockMap::new(device.settings());
        let samples = device.samples(60);
        let [mut outside, mut states] = [0, 0];
        for sample in samples.iter().filter(|s| !(25 * SECOND..35 * SECOND).contains(&s.true_ns)) {
            if sample.true_ns > 35 * SECOND && states == 0 {
                states = 1;
                // No query before this one: a clock runs on by itself.
                assert_eq!(clock.advance(26 * SECOND + 50 * MS), State::Holdover, "{name}");
                assert_eq!(clock.advance(34 * SECOND), State::Holdover, "{name}");
                let held = *clock.mapping();
                assert!(held.bound(34 * SECOND) > held.bound(25 * SECOND), "{name}: the bound grows");
            }
            let timed = clock.push(sample.host_ns, sample.ticks);
            outside += u32::from((timed.time_ns - sample.true_ns).abs() > timed.bound_ns);
        }
        assert!(outside * 100 < samples.len() as u32, "{name}: {outside}");
        assert_eq!(clock.state(), State::Locked, "{name}");
        let end = samples.last().unwrap().host_ns;
        assert_eq!(clock.advance(end + 30 * SECOND), State::Holdover);
        assert_eq!(clock.advance(end + 61 * SECOND), State::Lost);
        assert_eq!(clock.state(), State::Lost);
    }
}

#[test]
fn occasional_wrong_stamps_change_nothing() {
    // Every fiftieth stamp is the next one's, every seventieth is too early, every ninetieth
    // too late, and some samples change places.
    let device = Device::LIBERTY;
    let mut samples = device.samples(60);
    let clean = Run::of(device.settings(), &samples);
    for n in (600..samples.len()).step_by(50) {
        samples[n - 1].host_ns = samples[n].host_ns;
    }
    for n in (600..samples.len()).step_by(70) {
        samples[n].host_ns -= 40 * MS;
    }
    for n in (600..samples.len()).step_by(90) {
        samples[n].host_ns += 700 * MS;
    }
    for n in (603..samples.len() - 1).step_by(110) {
        samples.swap(n, n + 1);
    }
    let run = Run::of(device.settings(), &samples);
    assert_eq!(run.clock.mapping().epoch, 0);
    let right = |run: &Run| run.timed.iter().filter(|(s, t, _)| (t.time_ns - s.true_ns).abs() <= t.bound_ns).count();
    assert!(right(&run) * 1000 >= samples.len() * 995, "{} of {}", right(&run), samples.len());
    let [[rms, ..], [clean_rms, ..]] = [&run, &clean].map(|run| run.errors_ms(State::Locked));
    println!("{rms:.4} ms rms with wrong stamps, {clean_rms:.4} without");
    let by_ticks = run.timed.iter().filter(|(_, timed, _)| matches!(timed.basis, Basis::Ticks(_)));
    let worst = by_ticks.map(|(s, t, _)| (t.time_ns - s.true_ns).abs()).max().unwrap();
    assert!(worst < 3 * MS, "{worst} ns");
    let count = |flag| run.timed.iter().filter(|(_, timed, _)| timed.flags.has(flag)).count();
    assert!(count(TimeFlags::OUT_OF_ORDER) > 100 && count(TimeFlags::LATE) > 100 && count(TimeFlags::EARLY) > 150);
}

#[test]
fn rate_far_from_nominal_found() {
    for (name, device) in [("LIBERTY", Device::LIBERTY), ("FASTRAK", Device::FASTRAK)] {
        for ppm in [6_000.0, -6_000.0] {
            let device = Device { drift_ppm: ppm, ..device };
            let run = Run::of(device.settings(), &device.samples(60));
            let [locked, _] = run.within(State::Locked);
            let drift = run.clock.mapping().drift_ppm();
            let last = run.timed.last().unwrap();
            let error = (last.1.time_ns - last.0.true_ns) as f64 / MS as f64;
            println!("{name} {ppm} ppm: {drift:.0} ppm found, {locked} samples locked, {error:+.3} ms at the end");
            assert!((drift - ppm).abs() < 30.0 && error.abs() < 1.0, "{name}: {drift} {error}");
        }
    }
    let unstated = Device { stated: false, drift_ppm: 0.0, ..Device::LIBERTY };
    let run = Run::of(unstated.settings(), &unstated.samples(60));
    check("an unstated rate", &run);
    let unstated = Device { stated: false, drift_ppm: 0.0, loss: 0.0, ..Device::FASTRAK };
    let run = Run::of(unstated.settings(), &unstated.samples(60));
    check("neither rate nor ticks", &run);
}

#[test]
fn initial_buffered_records_give_no_rate() {
    for (stated, hz) in [(true, 60.0), (true, 120.0), (false, 120.0)] {
        let device = Device { stated, hz, tick_hz: hz, loss: 0.0, ..Device::FASTRAK };
        for held in [2, 5, 9, 15, 16, 17, 25, 32, 40, 146] {
            let mut samples = device.samples(40);
            let read_ns = samples[held].host_ns;
            for (n, sample) in samples[..held].iter_mut().enumerate() {
                sample.host_ns = read_ns - (held - n) as i64 * 30_000;
            }
            let mut run = Run::of(device.settings(), &samples);
            // The time that they spent in the buffer is unknown.
            run.timed.drain(..held);
            let name = format!("{held} records of {hz} Hz at once, {}", if stated { "stated" } else { "unstated" });
            check(&name, &run);
            let [locked, _] = run.within(State::Locked);
            assert!(locked as f64 > if stated { 34.0 } else { 30.0 } * hz, "{name}: {locked}");
            let last = run.timed.last().unwrap();
            assert!((last.1.time_ns - last.0.true_ns).abs() < MS, "{name}");
        }
    }
}

#[test]
fn rate_change_without_ticks_is_found() {
    for (before, after) in [(120.0, 60.0), (120.0, 40.0), (60.0, 7.5)] {
        let device = Device { hz: before, tick_hz: before, loss: 0.0, ..Device::FASTRAK };
        let mut samples = device.samples(20);
        let last_ns = samples.last().unwrap().true_ns + (1e9 / after) as i64;
        let slower = Device { hz: after, ..device }.samples(60);
        let first = slower[0].true_ns;
        samples.extend(slower.into_iter().map(|sample| Sample {
            true_ns: last_ns + sample.true_ns - first,
            host_ns: last_ns + sample.host_ns - first,
            ..sample
        }));
        let run = Run::of(device.settings(), &samples);
        let name = format!("{before} Hz, then {after} Hz");
        check(&name, &run);
        assert_eq!((run.clock.state(), run.clock.mapping().epoch), (State::Locked, 1), "{name}");
        let period_ns = run.clock.mapping().ns_per_tick_q32 as f64 / 4_294_967_296.0;
        assert!((period_ns * after / 1e9 - 1.0).abs() < 1e-3, "{name}: {period_ns} ns");
    }
}

#[test]
fn recorded_mappings_give_same_times() {
    for (device, jitter) in [
        (Device::LIBERTY, Jitter::Stalls(MS, 0.1)),
        (Device::FASTRAK, Jitter::Exponential(MS)),
        (Device::EA1, Jitter::Uniform(4 * MS)),
    ] {
        let device = Device { jitter, ..device };
        let half = device.samples(60).len() / 2;
        let mut samples = device.samples(60);
        samples[half..].iter_mut().for_each(|s| s.ticks = s.ticks.map(|ticks| ticks.wrapping_sub(900)));
        let run = Run::of(device.settings(), &samples);
        let recorded: Vec<String> =
            run.mappings.iter().map(|mapping| serde_json::to_string(mapping).unwrap()).collect();
        let replayed: Vec<Mapping> = recorded.iter().map(|text| serde_json::from_str(text).unwrap()).collect();
        assert!(replayed.iter().zip(0..).all(|(mapping, number)| mapping.number == number), "all, in order");
        for (_, timed, _) in &run.timed {
            let timed: Timed = serde_json::from_str(&serde_json::to_string(timed).unwrap()).unwrap();
            assert_eq!(replayed[timed.mapping as usize].time(timed.basis), timed.time_ns);
        }
        println!("{} publications in 60 s", replayed.len());
        assert!(replayed.len() < 400, "{}", replayed.len());
        let again = Run::of(device.settings(), &samples);
        assert!(again.timed.iter().zip(&run.timed).all(|(a, b)| a.1 == b.1));
    }
}

#[test]
fn known_delays_are_subtracted() {
    let device = Device { jitter: Jitter::None, loss: 0.0, wander_ppm: 0.0, ..Device::LIBERTY };
    assert_eq!(device.settings().delay_ns, DELAY_NS);
    let run = Run::of(device.settings(), &device.samples(20));
    let (sample, timed, _) = run.timed.last().unwrap();
    assert!((timed.time_ns - sample.true_ns).abs() <= 2, "{}", timed.time_ns - sample.true_ns);
    assert_eq!(run.timed[100].1.missing, 0);
    let lossy = Device { loss: 0.02, ..Device::LIBERTY };
    let run = Run::of(lossy.settings(), &lossy.samples(60));
    let missing: i64 = run.timed.iter().map(|(_, timed, _)| timed.missing).sum();
    assert_eq!(missing, 60 * 240 - run.timed.len() as i64 - i64::from(run.timed[0].1.basis != Basis::Ticks(1000)));
}

/// The filter of PLUS: a least-squares line through the last 20 pairs of index and time,
/// evaluated at the newest; the raw time if it is off by more than half a second.
struct PlusFilter(std::collections::VecDeque<(f64, f64)>);

impl PlusFilter {
    fn push(&mut self, index: f64, time_s: f64) -> f64 {
        self.0.push_back((index, time_s));
        if self.0.len() > 20 {
            self.0.pop_front();
        }
        let count = self.0.len() as f64;
        if count < 20.0 {
            return time_s;
        }
        let mean = |of: fn(&(f64, f64)) -> f64| self.0.iter().map(of).sum::<f64>() / count;
        let (index_mean, time_mean) = (mean(|pair| pair.0), mean(|pair| pair.1));
        let across: f64 = self.0.iter().map(|(i, t)| (i - index_mean) * (t - time_mean)).sum();
        let along: f64 = self.0.iter().map(|(i, _)| (i - index_mean).powi(2)).sum();
        let line = time_mean + across / along * (index - index_mean);
        if (line - time_s).abs() > 0.5 { time_s } else { line }
    }
}

#[test]
fn error_is_a_tenth_of_least_squares() {
    for (name, jitter) in [
        ("exponential, mean 1 ms", Jitter::Exponential(MS)),
        ("exponential, mean 4 ms", Jitter::Exponential(4 * MS)),
        ("even, to 4 ms", Jitter::Uniform(4 * MS)),
        ("packets of 16 ms", Jitter::Packets(16 * MS)),
        ("mean 1 ms, stalls of 200 ms", Jitter::Stalls(MS, 0.1)),
    ] {
        let device = Device { jitter, hz: 60.0, tick_hz: 60.0, ..Device::LIBERTY };
        let samples = device.samples(120);
        let run = Run::of(device.settings(), &samples);
        let mut plus = PlusFilter(Default::default());
        let mut errors = [Vec::new(), Vec::new(), Vec::new()];
        for ((sample, timed, _), at) in run.timed.iter().zip(0..) {
            let filtered = plus.push(sample.ticks.unwrap() as f64, (sample.host_ns - DELAY_NS) as f64 * 1e-9) * 1e3;
            // Both have settled.
            if at >= 600 {
                let true_ms = sample.true_ns as f64 * 1e-6;
                errors[0].push((sample.host_ns - DELAY_NS) as f64 * 1e-6 - true_ms);
                errors[1].push(filtered - true_ms);
                errors[2].push(timed.time_ns as f64 * 1e-6 - true_ms);
            }
        }
        let figures = errors.each_ref().map(|errors| {
            let count = errors.len() as f64;
            [(errors.iter().map(|e| e * e).sum::<f64>() / count).sqrt(), errors.iter().sum::<f64>() / count]
        });
        let [[raw, raw_bias], [plus, plus_bias], [ours, bias]] = figures;
        // A constant mean could be calibrated away; this is the deviation around it.
        let about = |rms: f64, mean: f64| (rms * rms - mean * mean).max(0.0).sqrt();
        println!(
            "{name}: ms rms (mean, about it): raw {raw:.3} ({raw_bias:+.3}, {:.3}), PLUS' filter {plus:.3} ({plus_bias:+.3}, {:.3}), ours {ours:.3} \
             ({bias:+.3}, {:.3})",
            about(raw, raw_bias),
            about(plus, plus_bias),
            about(ours, bias)
        );
        assert!(ours < 0.1 * plus && bias.abs() < 0.1 * plus_bias.abs(), "{name}: {ours} {plus}");
        assert!(about(ours, bias) < 0.1 * about(plus, plus_bias), "{name}");
    }
}

mod range;

mod anything {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_sample_gets_a_time(
            ticks in prop_oneof![Just(Ticks::None), Just(Ticks::Time), Just(Ticks::Measurements)],
            hz in prop_oneof![Just(None), Just(Some(240.0)), Just(Some(1e6)), Just(Some(f64::NAN)), Just(Some(1e-9))],
            wraps_at in prop_oneof![Just(None), Just(Some(1_u64 << 32)), Just(Some(0)), Just(Some(u64::MAX))],
            wild in prop::collection::vec((any::<i64>(), any::<Option<u64>>()), 0..40),
            tame in prop::collection::vec((0_i64..50 * MS, 0_u64..20), 0..200),
        ) {
            let timing = sonoweave_core::Timing { ticks, tick_hz: hz, rate_hz: hz, wraps_at, ..Default::default() };
            let mut clock = ClockMap::new(ClockSettings::new(&timing, 0));
            let (mut host, mut tick) = (0, 0);
            let tame = tame.into_iter().map(|(passed, counted)| {
                (host, tick) = (host + passed, tick + counted);
                (host, Some(tick))
            });
            for (host_ns, ticks) in tame.chain(wild) {
                let timed = clock.push(host_ns, ticks);
                prop_assert!(timed.bound_ns >= 0);
                clock.advance(host_ns);
            }
        }
    }
}
