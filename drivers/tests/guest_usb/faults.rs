//! Faults of USB devices.

use std::path::Path;

use drivers::simulated::{Machine, Model};
use drivers::tracker::polhemus::Settings;
use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::reading::Reading;

use super::descriptors::Described;
use super::guest::{Rig, Test};
use super::{Unit, a_fastrak, a_liberty, a_patriot, a_viper, liberty};

pub(crate) const TESTS: &[Test] = &[
    ("a_second_claim_is_refused_by_a_sentence", second_claim),
    ("a_driver_of_the_kernel_s_makes_way", kernel_driver),
    ("unplugged_in_the_midst_of_a_record_and_back_within_two_seconds", unplugged),
    ("unplugged_while_it_is_set_up", unplugged_early),
    ("a_unit_that_does_not_answer_is_silent_and_not_absent", hung),
    ("a_unit_that_takes_nothing_is_silent_and_not_absent", stuck),
    ("an_endpoint_that_stalls_is_cleared", stalled),
    ("a_device_without_bulk_endpoints_is_refused_by_a_sentence", no_endpoints),
    ("started_and_stopped_many_times", again_and_again),
];

fn second_claim() {
    let unit = liberty();
    let mut rig = unit.open();
    rig.until(State::Running, 5 * SECOND);
    let mut second = unit.open();
    assert!(second.readings(500 * MS).is_empty());
    assert_eq!(second.state(), State::Absent);
    assert_eq!(second.why(), "USB 0f44 cannot be opened: another program or a kernel driver has it; close that");
    // The first rig continues meanwhile, and releases the device when it stops.
    unit.truth.assert_exact(&rig.poses(100));
    rig.device.stop().unwrap();
    second.until(State::Running, 3 * SECOND);
    unit.truth.assert_exact(&second.poses(100));
}

/// The guest's `usbserial` is configured to claim this product as a serial line.
fn kernel_driver() {
    let mut unit = a_liberty(Described::new(0xff12, false, [0x02, 0x82]));
    unit.plug_in();
    let line = Path::new("/dev/ttyUSB0");
    let wait = |there: bool| {
        let end = Monotonic.now_ns() + 5 * SECOND;
        while line.exists() != there {
            assert!(Monotonic.now_ns() < end, "{} is{} there", line.display(), if there { " not" } else { "" });
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
    };
    wait(true);
    let mut rig = unit.open();
    rig.until(State::Running, 5 * SECOND);
    wait(false);
    unit.truth.assert_exact(&rig.poses(100));
    rig.device.stop().unwrap();
    // The kernel driver receives the device back on release.
    wait(true);
}

fn survives_unplugging<M: Model + 'static>(mut unit: Unit<M>, times: u64) {
    unit.plug_in();
    let mut rig = unit.open();
    rig.until(State::Running, 5 * SECOND);
    for round in 2..2 + times {
        unit.truth.assert_exact(&rig.poses(60));
        unit.plug.take().unwrap().leave_mid_record();
        unit.twin().unplug();
        let begin = Monotonic.now_ns();
        // Readings already on their way may still come.
        let mut last = Vec::new();
        while rig.state() != State::Absent {
            last.extend(rig.readings(2 * MS));
            assert!(Monotonic.now_ns() < begin + SECOND, "{:?}", rig.device.health());
        }
        let reported = Monotonic.now_ns() - begin;
        let last: Vec<_> =
            last.into_iter().map(|r| if let Reading::Pose(pose) = r { pose } else { panic!() }).collect();
        unit.truth.assert_exact(&last);
        assert!(rig.why().contains("was unplugged"), "{}", rig.why());
        // Neither an error nor a reading comes, and no deadline is missed.
        assert!(rig.readings(700 * MS).is_empty());
        assert_eq!(rig.why(), "USB 0f44 is not there: no such USB device; plug it in");
        unit.plug_in();
        rig.until(State::Running, 5 * SECOND);
        let back = Monotonic.now_ns() - unit.plug().since_ns;
        assert!(back < 2 * SECOND, "running {} ms after it was plugged in", back / MS);
        unit.truth.assert_exact(&rig.poses(60));
        let received = rig.device.health().received;
        assert_eq!((received.opened, received.set_up, received.lost), (round, round, 0), "{received:?}");
        println!(
            "{}: told {} ms after the plug was pulled, running {} ms after it was plugged in",
            rig.device.describe().name,
            reported / MS,
            back / MS
        );
    }
}

fn unplugged() {
    survives_unplugging(a_liberty(Described::new(0xff20, true, [0x04, 0x88])), 3);
    survives_unplugging(a_patriot(Described::new(0xef12, false, [0x02, 0x82])), 1);
    survives_unplugging(a_viper(), 1);
    survives_unplugging(a_fastrak(0x0003), 1);
}

fn unplugged_early() {
    let mut unit = liberty();
    let mut rig = unit.open();
    for ms in [5, 20, 60, 120, 250] {
        let end = Monotonic.now_ns() + 5 * SECOND;
        while rig.state() == State::Absent {
            rig.readings(2 * MS);
            assert!(Monotonic.now_ns() < end, "{:?}", rig.device.health());
        }
        rig.readings(ms * MS);
        unit.pull_out();
        rig.until(State::Absent, 2 * SECOND);
        assert!(rig.readings(100 * MS).is_empty());
        unit.plug_in();
    }
    rig.until(State::Running, 5 * SECOND);
    unit.truth.assert_exact(&rig.poses(100));
}

/// A hung unit is reported silent quickly, with a reason; it runs again on the same line when
/// it recovers.
fn hung() {
    let unit = liberty();
    let mut rig = unit.open();
    rig.until(State::Running, 5 * SECOND);
    rig.poses(100);
    unit.twin().wire.hung = true;
    let noticed = rig.until(State::Silent, 2 * SECOND);
    assert!(rig.readings(2 * SECOND).is_empty());
    assert_eq!(rig.state(), State::Silent);
    assert!(rig.why().contains("does not answer; check that the unit is switched on"), "{}", rig.why());
    unit.twin().wire.hung = false;
    let back = rig.until(State::Running, 4 * SECOND);
    assert!(back < 2 * SECOND, "{} ms", back / MS);
    unit.truth.assert_exact(&rig.poses(100));
    assert_eq!(rig.device.health().received.opened, 1, "it was open all along");
    println!("silent after {} ms, running {} ms after it answered again", noticed / MS, back / MS);
}

fn is_silent(rig: &mut Rig) {
    rig.until(State::Silent, 3 * SECOND);
    let end = Monotonic.now_ns() + 2 * SECOND;
    while Monotonic.now_ns() < end {
        assert!(rig.readings(50 * MS).is_empty());
        assert_eq!(rig.state(), State::Silent, "{}", rig.why());
    }
    assert!(rig.why().contains("does not answer; check that the unit is switched on"), "{}", rig.why());
}

/// The device refuses even commands: it stays busy forever.
fn stuck() {
    let mut unit = liberty();
    let mut rig = unit.open();
    rig.until(State::Running, 5 * SECOND);
    rig.poses(100);
    unit.plug().state().is_stuck = true;
    is_silent(&mut rig);
    unit.plug().state().is_stuck = false;
    let back = rig.until(State::Running, 4 * SECOND);
    assert!(back < 2 * SECOND, "{} ms", back / MS);
    unit.truth.assert_exact(&rig.poses(100));
    // Also when stuck from the start.
    rig.device.stop().unwrap();
    unit.plug().state().is_stuck = true;
    rig.device.start().unwrap();
    is_silent(&mut rig);
    // Unplugged, it is absent; plugged in, it runs again at once.
    unit.pull_out();
    rig.until(State::Absent, 2 * SECOND);
    unit.plug_in();
    rig.until(State::Running, 2 * SECOND);
    unit.truth.assert_exact(&rig.poses(100));
    println!("running {} ms after it took something again", back / MS);
}

fn stalled() {
    let unit = liberty();
    let mut rig = unit.open();
    rig.until(State::Running, 5 * SECOND);
    for round in 1..4 {
        rig.poses(50);
        unit.plug().state().is_halted[0] = true;
        let end = Monotonic.now_ns() + 2 * SECOND;
        while unit.plug().state().cleared < round {
            rig.readings(5 * MS);
            assert!(Monotonic.now_ns() < end, "{:?}", rig.device.health());
        }
        rig.poses(50);
        assert_eq!(rig.state(), State::Running);
    }
    let received = rig.device.health().received;
    assert_eq!((received.opened, received.set_up, received.lost), (1, 1, 0), "{received:?}");
    unit.truth.assert_exact(&rig.poses(100));
    // Both endpoints are halted, as another host may have left them.
    rig.device.stop().unwrap();
    unit.plug().state().is_halted = [true; 2];
    rig.device.start().unwrap();
    rig.until(State::Running, 2 * SECOND);
    unit.truth.assert_exact(&rig.poses(100));
    assert_eq!((unit.plug().state().cleared, rig.device.health().received.opened), (5, 2));
}

fn no_endpoints() {
    let mut described = Described::new(0xff20, true, [0x04, 0x88]);
    for endpoint in &mut described.endpoints {
        (endpoint.kind, endpoint.packet) = (3, 64);
    }
    let mut unit = a_liberty(described);
    unit.plug_in();
    let mut rig = unit.open();
    assert!(rig.readings(SECOND).is_empty());
    assert_eq!(rig.state(), State::Absent);
    assert!(rig.why().contains("has no bulk endpoints"), "{}", rig.why());
}

fn again_and_again() {
    let unit = liberty();
    let mut rig = unit.open_with(None, Settings::default());
    for _ in 0..10 {
        rig.until(State::Running, 5 * SECOND);
        unit.truth.assert_exact(&rig.poses(20));
        rig.device.stop().unwrap();
        rig.device.start().unwrap();
    }
}
