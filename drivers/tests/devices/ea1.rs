//! EA1 arms, in their initial states and with faults.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use drivers::arm::Settings;
use drivers::arm::ea1::{Framing, Record, Sample, SampleFormat, Unit};
use drivers::connection::{Connection, Protocol};
use drivers::simulated::ea1::Twin;
use drivers::simulated::{Faults, Machine, Pty};
use drivers::transport::{PortPath, SerialOpener};
use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::reading::{Counts, Reading, Status};
use sonoweave_core::{Device, Next};

use crate::bench::{BEGIN, Rig, refused_setting, replays};
use crate::joints::{SOON, at_rest, counts, is_true, moving, split, text};

fn rig(twin: Twin, settings: Settings, format: SampleFormat) -> Rig<Twin, Unit> {
    let mut rig = Rig::new(twin, Unit::new("a line", settings, format).unwrap(), false);
    rig.device.start().unwrap();
    rig
}

fn usual() -> Rig<Twin, Unit> {
    rig(Twin::new(moving(), Faults::default()), Settings::default(), SampleFormat::Lines)
}

/// Waits until the arm runs, and homes it.
fn homed(mut rig: Rig<Twin, Unit>) -> Rig<Twin, Unit> {
    rig.until(State::Running, SOON);
    rig.device.protocol_mut().home(7);
    let last = counts(rig.readings(200 * MS)).pop().unwrap();
    assert_eq!((&last.status, last.homed), (&Status::Ok, 7), "{last:?}");
    rig
}

/// Returns the host time of a sample by the arm's clock, which is exact here to 1 µs.
fn time_of(counts: &Counts, born_ns: i64) -> i64 {
    born_ns + i64::try_from(counts.stamp.ticks.unwrap()).unwrap() * 1000
}

fn born(rig: &Rig<Twin, Unit>) -> i64 {
    let now = rig.clock.now_ns();
    now - i64::from(rig.twin.lock().unwrap().us(now)) * 1000
}

#[test]
fn counts_match_joints_at_stamp_times() {
    for (format, bytes) in [(SampleFormat::Lines, 45), (SampleFormat::Blocks, 29)] {
        let mut rig = rig(Twin::new(moving(), Faults::default()), Settings::default(), format);
        let took = rig.until(State::Running, SOON);
        assert!((1600 * MS..2000 * MS).contains(&took), "it starts in 1.6 s: {} ms", took / MS);
        let before = rig.readings(100 * MS);
        assert!(counts(before).iter().all(|c| c.homed == 0 && text(c).contains("not homed")));
        assert!(rig.device.health().why.contains("home it"), "{}", rig.device.health().why);
        rig = homed(rig);
        assert_eq!(rig.device.health().why, "");
        let zeros = rig.twin.lock().unwrap().zeros;
        let found = counts(rig.readings(5 * SECOND));
        let (timing, born) = (rig.device.describe().timing, born(&rig));
        assert_eq!((timing.tick_hz, timing.wraps_at, timing.rate_hz), (Some(1e6), Some(1 << 32), Some(100.0)));
        assert_eq!(timing.wire_ns, bytes * 10 * SECOND / 115_200);
        assert!((499..=501).contains(&found.len()), "{}", found.len());
        for (n, c) in found.iter().enumerate() {
            assert_eq!((c.first, c.axes, c.homed, c.buttons), (0, 3, 7, 0));
            assert_eq!(c.stamp.item, found[0].stamp.item + n as u64);
            let time = time_of(c, born);
            // The test reads its clock with 1 µs resolution, twice.
            assert!(is_true(&moving(), c, time - 1000, 3000, &zeros), "{c:?}");
            let late = c.stamp.host_ns.unwrap() - time;
            // The sample's own bytes, and sometimes an answer before them.
            assert!((2 * MS..8 * MS).contains(&late) || format == SampleFormat::Lines && late < 8 * MS, "{late}");
        }
        let received = rig.device.health().received;
        assert_eq!((received.set_up, received.lost, received.refused, received.skipped), (1, 0, 0, received.skipped));
        let trip = rig.device.protocol().round_trip_ns().unwrap();
        assert!((MS..8 * MS).contains(&trip), "{trip}");
    }
}

#[test]
fn homing_loses_no_sample() {
    for ms in 0..10 {
        let mut rig = usual();
        rig.until(State::Running, SOON);
        rig.readings(100 * MS + ms * MS);
        // Homing restarts the virtual arm's timer, so that the next sample is late by up to one
        // period.
        rig = homed(rig);
        rig.readings(SECOND);
        let received = rig.device.health().received;
        assert_eq!((received.lost, received.refused), (0, 0), "{ms} ms: {received:?}");
    }
}

#[test]
fn arm_in_any_initial_state_is_set_up() {
    for left in 0..32 {
        let mut twin = Twin::new(moving(), Faults::default());
        twin.starts_when_opened = left & 1 != 0;
        twin.rate_hz = if left & 2 != 0 { 100 } else { 0 };
        twin.framing = if left & 4 != 0 { Framing::Blocks } else { Framing::Lines };
        if left & 8 != 0 {
            twin.wire.send(b"00,1024,-300,65536,07*1E\r\n\x04\x01\x03", 0, BEGIN);
        }
        let expected = if left & 16 != 0 { SampleFormat::Blocks } else { SampleFormat::Lines };
        let mut rig = rig(twin, Settings::default(), expected);
        let took = rig.until(State::Running, SOON);
        // Waiting is in vain for an arm that is quiet and was not started.
        let most = if left & 3 == 0 { 2700 * MS } else { 2000 * MS };
        assert!(took < most, "{left}: {} ms", took / MS);
        assert!(counts(rig.readings(SECOND)).len() > 98, "{left}");
        let framing = rig.twin.lock().unwrap().framing;
        assert_eq!(framing == Framing::Blocks, expected == SampleFormat::Blocks);
    }
}

#[test]
fn sent_commands_match_document() {
    let mut twin = Twin::new(moving(), Faults::default());
    twin.starts_when_opened = false;
    let mut rig = rig(twin, Settings { rate_hz: 150, ..Settings::default() }, SampleFormat::Lines);
    rig.until(State::Running, SOON);
    rig.readings(500 * MS);
    rig.device.protocol_mut().home(5);
    rig.readings(100 * MS);
    rig.device.stop().unwrap();
    let sent: Vec<String> =
        rig.twin.lock().unwrap().wire.obeyed.iter().map(|b| String::from_utf8(b.clone()).unwrap()).collect();
    // The zeroed axes are stored from bit 29 of the ping's number.
    let zeroed = format!("!T{}\n", 5_u32 << 29 | 2);
    assert_eq!(sent, ["!R0\n", "!I\n", "!R150\n", "!T1\n", "!Z5\n", &zeroed, "!R0\n"]);
}

#[test]
fn clock_number_and_counts_survive_wrap() {
    let mut rig = homed(usual());
    {
        let mut twin = rig.twin.lock().unwrap();
        // Counts just below 2³¹ at present; the arm must be homed for that, and stays so in its
        // own view.
        for (axis, ahead) in [-1500, 300, 0].into_iter().enumerate() {
            let now = moving()(rig.clock.now_ns())[axis];
            twin.zeros[axis] = now - (ahead - i64::from(i32::MIN));
        }
        twin.zeros[1] = moving()(rig.clock.now_ns())[1] + i64::from(i32::MAX);
        twin.seq = u32::MAX - 150;
        twin.set_clock(rig.clock.now_ns(), u32::MAX - 1_500_000);
    }
    // The driver treats all of it as a new start. It is homed again, with the counters
    // unchanged.
    rig.readings(100 * MS);
    assert!(rig.device.health().why.contains("begun anew"), "{}", rig.device.health().why);
    let zeros = rig.twin.lock().unwrap().zeros;
    let before = rig.device.health().received;
    let found = counts(rig.readings(3 * SECOND));
    let received = rig.device.health().received;
    assert_eq!((received.lost, received.refused), (before.lost, before.refused), "nothing is lost at a wrap");
    assert!(found.windows(2).any(|two| two[0].stamp.ticks > two[1].stamp.ticks), "the clock wraps");
    assert!(found.iter().any(|c| c.counts[0] > i64::from(i32::MAX)), "the first counter wraps");
    for two in found.windows(2) {
        let ticks = [0, 1].map(|n| two[n].stamp.ticks.unwrap() as u32);
        assert_eq!(ticks[1].wrapping_sub(ticks[0]) / 9_900, 1);
        assert!((two[1].counts[0] - two[0].counts[0] - 100).abs() <= 1, "{two:?}");
        assert!((two[1].counts[1] - two[0].counts[1] + 30).abs() <= 1, "{two:?}");
    }
    assert!(zeros[0] < 0);
}

#[test]
fn jump_requires_homing() {
    let mut rig = homed(usual());
    rig.twin.lock().unwrap().slip(1, 50_000);
    let [before, after] = split(counts(rig.readings(SECOND)), |c| c.status != Status::Ok);
    assert!(before.len() <= 1 && after.len() > 97);
    assert!(
        text(&after[0]).starts_with("axis 2 of 3 jumped by ") && text(&after[0]).ends_with("home it"),
        "{}",
        text(&after[0])
    );
    assert!(text(&after[0]).contains("499") || text(&after[0]).contains("500"), "{}", text(&after[0]));
    assert!(after.iter().all(|c| c.homed == 0b101 && text(c).contains("axis 2")), "until it is homed");
    assert!(after.windows(2).all(|two| two[0].stamp.ticks < two[1].stamp.ticks), "each, and in order");
    assert!(rig.device.health().why.starts_with("axis 2 of 3 jumped by"), "{}", rig.device.health().why);
    let lost = rig.device.health().received.lost;
    rig.device.protocol_mut().home(0b010);
    let [_, after] = split(counts(rig.readings(SECOND)), |c| c.status == Status::Ok);
    assert!(after.len() > 95 && after.iter().all(|c| c.homed == 7 && c.status == Status::Ok));
    let zeros = rig.twin.lock().unwrap().zeros;
    let born = born(&rig);
    assert!(after.iter().all(|c| is_true(&moving(), c, time_of(c, born) - 1000, 3000, &zeros)));
    assert_eq!((rig.device.health().why.as_str(), rig.device.health().received.lost), ("", lost));
}

#[test]
fn fastest_allowed_movement_is_no_jump() {
    let mut rig = homed(usual());
    // The settings allow 4000 counts in 10 ms.
    rig.twin.lock().unwrap().slip(0, 3500);
    let found = counts(rig.readings(SECOND));
    assert!(found.iter().all(|c| c.status == Status::Ok && c.homed == 7));
}

#[test]
fn restarted_arm_resumes_and_requires_homing() {
    let mut rig = homed(usual());
    let now = rig.clock.now_ns();
    rig.twin.lock().unwrap().restart(now);
    let [before, after] = split(counts(rig.readings(5 * SECOND)), |c| c.homed != 7);
    assert!(before.len() < 3);
    // The arm is silent for 1.6 s, and runs within 2 s of its identification.
    let first = after[0].stamp.host_ns.unwrap() - now;
    assert!(first < 3600 * MS, "{} ms", first / MS);
    assert!(after.iter().all(|c| c.homed == 0 && text(c).contains("home")));
    // A power-supply glitch in the middle of samples: the arm continues at once.
    let mut rig = homed(rig);
    {
        let mut twin = rig.twin.lock().unwrap();
        (twin.seq, twin.homed) = (0, 0);
        twin.set_clock(rig.clock.now_ns(), 0);
    }
    let [_, after] = split(counts(rig.readings(SECOND)), |c| c.homed != 7);
    assert!(after.len() > 97 && text(&after[0]).contains("begun anew"), "{}", text(&after[0]));
    assert!(rig.device.health().why.contains("begun anew"), "{}", rig.device.health().why);
}

#[test]
fn index_marks_home_arm_without_jump() {
    let mut twin = Twin::new(moving(), Faults::default());
    // Two marks are passed 4 s and 5 s after the beginning; the third never is.
    twin.marks = [Some(40_000), Some(-15_000), Some(9_999)];
    let mut rig = rig(twin, Settings::default(), SampleFormat::Lines);
    let found = counts(rig.readings(8 * SECOND));
    let masks = found.iter().fold(vec![0], |mut masks, c| {
        if masks.last() != Some(&c.homed) {
            masks.push(c.homed);
        }
        masks
    });
    assert_eq!(masks, [0, 0b001, 0b011]);
    let born = born(&rig);
    let last = found.last().unwrap();
    assert!(is_true(
        &moving(),
        last,
        time_of(last, born) - 1000,
        3000,
        &[40_000, -15_000, rig.twin.lock().unwrap().zeros[2]]
    ));
    assert!(text(last).contains("axis 3 is not homed"), "{}", text(last));
    assert_eq!(rig.device.health().received.refused, 0);
}

#[test]
fn flags_qualify_readings() {
    let mut rig = homed(usual());
    rig.twin.lock().unwrap().faults = 0b100;
    rig.twin.lock().unwrap().buttons = 1;
    let last = counts(rig.readings(100 * MS)).pop().unwrap();
    assert_eq!((last.homed, last.buttons), (0b011, 1));
    assert!(text(&last).starts_with("axis 3 has lost steps"), "{}", text(&last));
    let mut rig = homed(rig);
    rig.twin.lock().unwrap().rate_hz = 400;
    let begin = rig.twin.lock().unwrap().sampled;
    let seen = rig.device.health().received;
    let found = counts(rig.readings(SECOND));
    assert!(rig.device.health().why.contains("more samples than it can send"), "{}", rig.device.health().why);
    assert!(found.iter().all(|c| c.homed == 7));
    let (taken, now) = (rig.twin.lock().unwrap().sampled - begin, rig.device.health().received);
    // Two may be in transit.
    let missing = taken - found.len() as u64;
    assert!(
        missing > 100 && (now.lost + now.refused - seen.lost - seen.refused).abs_diff(missing) <= 2,
        "{missing} {now:?}"
    );
}

#[test]
fn lost_homing_answer_is_handled() {
    let mut rig = usual();
    rig.until(State::Running, SOON);
    // The answer is lost twice: after a repeated request, the zero counts.
    rig.twin.lock().unwrap().mute_pings = 2;
    rig.readings(1200 * MS);
    rig.twin.lock().unwrap().mute_pings = 2;
    rig.device.protocol_mut().home(7);
    let last = counts(rig.readings(SECOND)).pop().unwrap();
    assert_eq!((last.homed, &last.status), (7, &Status::Ok), "the arm's flags tell, too");
    rig.twin.lock().unwrap().mute_pings = 3;
    rig.device.protocol_mut().home(1);
    rig.readings(2 * SECOND);
    assert!(rig.device.health().why.contains("home it once more"), "{}", rig.device.health().why);
    homed(rig);
}

#[test]
fn lost_bytes_count_as_lost_readings_without_wrong_ones() {
    for format in [SampleFormat::Lines, SampleFormat::Blocks] {
        let mut rig = homed(rig(Twin::new(moving(), Faults::default()), Settings::default(), format));
        rig.twin.lock().unwrap().wire.set_faults(Faults { drop: 0.002, dropout: 0.01, ..Faults::default() });
        let (zeros, before) = (rig.twin.lock().unwrap().zeros, rig.device.health().received);
        let begin = rig.twin.lock().unwrap().sampled;
        let found = counts(rig.readings(60 * SECOND));
        let end = rig.twin.lock().unwrap().sampled;
        let born = born(&rig);
        let wrong = found.iter().filter(|c| !is_true(&moving(), c, time_of(c, born) - 1000, 3000, &zeros)).count();
        assert_eq!(wrong, 0, "{format:?}");
        assert!(found.iter().all(|c| c.status == Status::Ok));
        let received = rig.device.health().received;
        let lost = received.lost - before.lost;
        // One may be in transit at either end.
        assert!((lost + found.len() as u64).abs_diff(end - begin) <= 2, "{lost} {} {}", found.len(), end - begin);
        assert!((100..1500).contains(&lost) && received.skipped > 100, "{received:?}");
    }
}

#[test]
fn damage_missed_by_checksum_is_detected() {
    // Damage to sample 5: its number, its time, one of its counts.
    let damages: [fn(&mut Sample); 4] =
        [|s| s.seq += 2, |s| s.seq -= 4, |s| s.t_us += 100_000, |s| s.counts[1] += 100_000];
    for (kind, damage) in damages.into_iter().enumerate() {
        let mut unit = Unit::new("x", Settings::default(), SampleFormat::Lines).unwrap();
        unit.resume();
        let (mut found, mut bytes) = (VecDeque::new(), Vec::new());
        for n in 0..10 {
            let mut sample = Sample {
                seq: 100 + n,
                t_us: 5000 + 10_000 * n,
                counts: [7, -8, 9],
                flags: 7,
                buttons: 0,
                framing: Framing::Lines,
            };
            if n == 5 {
                damage(&mut sample);
            }
            bytes.clear();
            Record::Sample(sample).write(&mut bytes);
            unit.decode(&bytes, BEGIN + i64::from(n) * 10 * MS, &mut found);
        }
        assert_eq!(found.len(), 9, "{kind}");
        for (c, n) in counts(found.into()).iter().zip((0..10).filter(|n| *n != 5)) {
            assert_eq!(
                (c.stamp.ticks, c.homed, &c.counts[..3]),
                (Some(5000 + 10_000 * n), 7, &[7, -8, 9][..]),
                "{kind}"
            );
        }
        let lost = unit.lost();
        assert_eq!((lost.readings, lost.refused, lost.skipped), (1, 1, 0), "{kind}");
    }
}

#[test]
fn noise_gives_no_wrong_sample() {
    let mut rig = homed(rig(Twin::new(moving(), Faults::default()), Settings::default(), SampleFormat::Blocks));
    let zeros = rig.twin.lock().unwrap().zeros;
    rig.twin.lock().unwrap().wire.set_faults(Faults { noise: 0.01, ..Faults::default() });
    let found = counts(rig.readings(60 * SECOND));
    let born = born(&rig);
    assert!(found.len() > 4000, "{}", found.len());
    assert!(
        found.iter().all(|c| is_true(&moving(), c, time_of(c, born) - 1000, 3000, &zeros) && c.status == Status::Ok)
    );
    rig.twin.lock().unwrap().wire.set_faults(Faults { noise: 0.4, ..Faults::default() });
    rig.readings(5 * SECOND);
    rig.twin.lock().unwrap().wire.set_faults(Faults::default());
    assert!(rig.until(State::Running, SOON) <= 2 * SECOND);
}

#[test]
fn unplugged_arm_is_absent_then_runs_again() {
    let mut rig = homed(usual());
    for _ in 0..3 {
        rig.twin.lock().unwrap().unplug();
        assert!(rig.until(State::Absent, SECOND) < 20 * MS, "told at once");
        assert!(rig.device.health().why.contains("unplugged"), "{}", rig.device.health().why);
        assert!(rig.readings(3 * SECOND).is_empty());
        assert!(rig.device.health().why.contains("plug it in"));
        rig.twin.lock().unwrap().wire.plugged = true;
        // A board needs 1.6 s to start, and sends its first line then.
        let back = rig.until(State::Running, SOON);
        assert!(back < 1600 * MS + SECOND / 2, "{} ms", back / MS);
        let first = counts(rig.readings(100 * MS)).remove(0);
        assert!(first.homed == 0 && text(&first).contains("home it"));
    }
}

#[test]
fn hung_arm_is_silent_not_absent() {
    let mut twin = Twin::new(moving(), Faults::default());
    twin.starts_when_opened = false;
    let mut rig = homed(rig(twin, Settings::default(), SampleFormat::Lines));
    rig.twin.lock().unwrap().wire.hung = true;
    let noticed = rig.until(State::Silent, 2 * SECOND);
    assert!(noticed < 600 * MS, "{} ms", noticed / MS);
    assert!(rig.readings(6 * SECOND).is_empty());
    assert!(rig.device.health().why.contains("does not answer"), "{}", rig.device.health().why);
    rig.twin.lock().unwrap().wire.hung = false;
    let back = rig.until(State::Running, SOON);
    assert!(back < 2 * SECOND, "{} ms", back / MS);
    // The arm never lost power, and reports that it is still homed.
    assert_eq!(counts(rig.readings(100 * MS)).pop().unwrap().homed, 7);
    assert_eq!(rig.device.health().received.opened, 1);
}

#[test]
fn bare_numbers_are_refused_or_used_with_a_warning() {
    let bare = || {
        let mut twin = Twin::new(moving(), Faults::default());
        (twin.bare, twin.rate_hz) = (true, 50);
        twin
    };
    let mut strict = rig(bare(), Settings::default(), SampleFormat::Lines);
    assert!(strict.readings(5 * SECOND).is_empty());
    assert_eq!(strict.device.health().state, State::Silent);
    assert!(strict.device.health().why.contains("bare numbers"), "{}", strict.device.health().why);
    let mut rig = rig(bare(), Settings::default(), SampleFormat::BareNumbers);
    rig.until(State::Running, SOON);
    assert!(rig.device.health().why.contains("not homed"), "{}", rig.device.health().why);
    rig.device.protocol_mut().home(7);
    let found = counts(rig.readings(2 * SECOND));
    assert!(found.len() > 95);
    let first = &found[1];
    for (n, c) in found[1..].iter().enumerate() {
        assert!(c.homed == 7 && c.stamp.ticks.is_none() && c.status == Status::Ok, "{c:?}");
        assert!((c.counts[0] - first.counts[0] - 200 * n as i64).abs() <= 1);
    }
    assert!(found[0].counts[..3].iter().all(|count| count.abs() <= 200), "from home");
    assert!(rig.device.health().why.contains("not to be relied on"));
}

#[test]
fn mismatched_arm_is_refused() {
    let refused = |counts_per_turn, rate_hz, baud| {
        let settings = Settings { counts_per_turn, rate_hz, baud, ..Settings::default() };
        let mut rig = rig(Twin::new(at_rest(), Faults::default()), settings, SampleFormat::Lines);
        assert!(rig.readings(4 * SECOND).is_empty());
        rig.device.health().why.clone()
    };
    let why = refused([40_000, 30_000, 1], 100, None);
    assert!(why.contains("axis 2 has 20000 counts a turn and not 30000"), "{why}");
    let why = refused([0; 3], 400, None);
    assert!(why.contains("cannot send 400 samples"), "{why}");
    let why = refused([0; 3], 100, Some(9600));
    assert!(why.contains("does not answer at 9600"), "{why}");
    let wrong = |settings: Settings| refused_setting(Unit::new("x", settings, SampleFormat::Lines).err());
    assert_eq!(wrong(Settings { rate_hz: 0, ..Settings::default() }), "rate_hz");
    assert_eq!(wrong(Settings { fastest: 0, ..Settings::default() }), "fastest");
    assert_eq!(wrong(Settings { baud: Some(10), ..Settings::default() }), "baud");
}

#[test]
fn raw_bytes_replay_same_readings() {
    let faults = Faults { drop: 0.001, packet_ns: 16 * MS, ..Faults::default() };
    let unit = || Unit::new("a line", Settings::default(), SampleFormat::Lines).unwrap();
    let mut rig = Rig::new(Twin::new(moving(), faults), unit(), true);
    rig.device.start().unwrap();
    let mut readings = rig.readings(5 * SECOND);
    rig.device.protocol_mut().home(7);
    readings.extend(rig.readings(5 * SECOND));
    rig.twin.lock().unwrap().slip(0, 100_000);
    readings.extend(rig.readings(5 * SECOND));
    rig.device.protocol_mut().home(1);
    readings.extend(rig.readings(5 * SECOND));
    let homed = counts(readings.clone()).iter().filter(|c| c.homed == 7).count();
    let found = replays(&readings, unit);
    assert!(found > 1500 && (800..found - 300).contains(&homed), "{found} {homed}");
}

#[test]
fn pseudo_terminal_counts_are_exact_until_hangup() {
    let begin = Monotonic.now_ns();
    let joints: drivers::simulated::Joints = Arc::new(move |ns| [(ns - begin) / MS, 7, -9, 0, 0, 0]);
    let mut left = Twin::new(Arc::clone(&joints), Faults::default());
    (left.rate_hz, left.homed) = (100, 7);
    left.set_clock(begin, 0);
    let twin = Arc::new(Mutex::new(left));
    let pty = Pty::run(Arc::clone(&twin)).unwrap();
    let opener = SerialOpener::new(PortPath { path: pty.path().into(), baud: 9600 }, Arc::new(Monotonic));
    let unit = Unit::new("a terminal", Settings::default(), SampleFormat::Blocks).unwrap();
    let mut device = Connection::new(Box::new(opener), Arc::new(Monotonic), unit, false);
    device.start().unwrap();
    let end = Monotonic.now_ns() + 20 * SECOND;
    let mut found = Vec::new();
    while found.len() < 100 {
        assert!(Monotonic.now_ns() < end, "{:?}", device.health());
        match device.next(Monotonic.now_ns() + 50 * MS).unwrap() {
            Next::Reading(Reading::Counts(counts)) => found.push(counts),
            Next::Reading(other) => panic!("{other:?}"),
            Next::Pending => {}
            Next::End => panic!("the end"),
        }
    }
    for c in &found {
        assert_eq!((c.homed, &c.status), (7, &Status::Ok));
        let time = time_of(c, begin);
        assert!(is_true(&joints, c, time, 1000, &[0; 3]), "{c:?}");
        let age = c.stamp.host_ns.unwrap() - time;
        assert!((MS..2 * SECOND).contains(&age), "{age}");
    }
    drop(pty);
    while device.health().state != State::Absent {
        assert!(Monotonic.now_ns() < end + 5 * SECOND, "{:?}", device.health());
        device.next(Monotonic.now_ns() + 50 * MS).unwrap();
    }
}
