//! A serial-line gadget of the kernel, plugged into the same kernel. The host's side is
//! `cdc_acm`, as for arms built with microcontrollers.

use std::fs;
use std::io::ErrorKind;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::sync::{Arc, Mutex};

use drivers::arm::ea1::SampleFormat;
use drivers::arm::{ArmSettings, Model, Settings};
use drivers::simulated::ea1::Twin;
use drivers::simulated::{Faults, Machine};
use drivers::transport::serial;
use drivers::{Listing, OpenSettings, tracker::polhemus};
use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::reading::{Counts, Status};

use super::guest::{Rig, Test};
use super::spoken::Spoken;
use super::{a_fastrak, assert_exact, assert_survives_unplugging, open};

pub(crate) const TESTS: &[Test] = &[
    ("a_tracker_behind_cdc_acm_is_exact_and_survives_unplugging", tracker),
    ("an_arm_behind_cdc_acm_is_exact_and_survives_unplugging", arm),
    ("a_line_of_usb_is_listed_until_it_is_pulled_out", listing),
];

/// Device files of the host's side and of the gadget's side.
const HOST: &str = "/dev/ttyACM0";
const GADGET: &str = "/dev/ttyGS0";
const GADGETS: &str = "/sys/kernel/config/usb_gadget";

/// Creates the gadget once: a line like that of a microcontroller board.
fn make() {
    let gadget = Path::new(GADGETS).join("arm");
    if gadget.exists() {
        return;
    }
    for folder in ["strings/0x409", "configs/c.1", "functions/acm.0"] {
        fs::create_dir_all(gadget.join(folder)).unwrap();
    }
    for (name, value) in [
        ("idVendor", "0x2341"),
        ("idProduct", "0x0043"),
        ("strings/0x409/manufacturer", "Sonoweave"),
        ("strings/0x409/product", "Arm"),
        ("strings/0x409/serialnumber", "7"),
    ] {
        fs::write(gadget.join(name), value).unwrap();
    }
    symlink(gadget.join("functions/acm.0"), gadget.join("configs/c.1/acm.0")).unwrap();
}

/// Plugs the gadget in; returns the time, host ns.
fn plug_in() -> i64 {
    make();
    let now = Monotonic.now_ns();
    fs::write(format!("{GADGETS}/arm/UDC"), "dummy_udc.0").unwrap();
    now
}

fn pull_out() {
    // Unplugging fails if it is not plugged in.
    match fs::write(format!("{GADGETS}/arm/UDC"), "\n") {
        Err(error) if error.kind() != ErrorKind::NotFound && error.raw_os_error() != Some(19) => panic!("{error}"),
        _ => {}
    }
}

fn tracker() {
    plug_in();
    let (twin, truth) = a_fastrak();
    let spoken = Spoken::on(GADGET, 115_200, &twin);
    let mut rig = open(polhemus::Model::Fastrak, HOST, None);
    assert_exact(&mut rig, &truth, 240);
    assert_survives_unplugging(
        &mut rig,
        &truth,
        spoken,
        |_| {
            pull_out();
            twin.lock().unwrap().unplug();
        },
        || {
            twin.lock().unwrap().wire.plugged = true;
            let since = plug_in();
            (Spoken::on(GADGET, 115_200, &twin), since)
        },
    );
    rig.device.stop().unwrap();
    pull_out();
}

/// Counts, with the host times of their requests, ns.
type Requested = Arc<Mutex<Vec<(i64, [i64; 3])>>>;

/// Creates an arm whose joints turn at different speeds, and a log of its measured counts.
fn an_arm() -> (Arc<Mutex<Twin>>, Requested) {
    let requested = Requested::default();
    let log = Arc::clone(&requested);
    let joints = Arc::new(move |ns: i64| {
        let us = ns / 1000;
        let counts = [us / 100, -3 * us / 1000, (5000.0 * (us as f64 * 1e-6).sin()) as i64];
        log.lock().unwrap().push((ns, counts));
        [counts[0], counts[1], counts[2], 0, 0, 0]
    });
    (Arc::new(Mutex::new(Twin::new(joints, Faults::default()))), requested)
}

/// Checks that each sample equals the arm's counts at the time of its clock, less the counts at
/// home.
fn assert_true(counts: &[Counts], twin: &Mutex<Twin>, requested: &Requested, hz: i64) {
    let (zeros, born_ns) = {
        let (twin, now) = (twin.lock().unwrap(), Monotonic.now_ns());
        (twin.zeros, now - i64::from(twin.us(now)) * 1000)
    };
    let requested = requested.lock().unwrap();
    for counts in counts {
        let at_ns = born_ns + i64::try_from(counts.stamp.ticks.unwrap()).unwrap() * 1000;
        // The clock is read with 1 µs resolution, twice.
        let mut of_then = requested.iter().filter(|(ns, _)| (ns - at_ns).abs() < 3000);
        let is = of_then.any(|(_, truth)| (0..3).all(|axis| truth[axis] - zeros[axis] == counts.counts[axis]));
        assert!(is, "{counts:?} is not what it saw at {at_ns}, less {zeros:?}");
        let age = counts.stamp.host_ns.unwrap() - at_ns;
        assert!((-10_000..3 * SECOND).contains(&age), "taken {} µs before it was here", age / 1000);
    }
    for two in counts.windows(2) {
        let step = two[1].stamp.ticks.unwrap() - two[0].stamp.ticks.unwrap();
        assert!(step.abs_diff((1_000_000 / hz).cast_unsigned()) <= 1, "{step} µs");
    }
}

/// Homes the arm, and checks the samples after that.
fn assert_right(rig: &mut Rig, twin: &Mutex<Twin>, requested: &Requested) {
    let before = rig.counts(20);
    assert!(before.iter().all(|counts| counts.homed == 0 && counts.status != Status::Ok));
    assert!(rig.why().contains("home it"), "{}", rig.why());
    rig.device.home(7).unwrap();
    let end = Monotonic.now_ns() + 2 * SECOND;
    while rig.counts(1)[0].homed != 7 {
        assert!(Monotonic.now_ns() < end, "it was not homed: {:?}", rig.device.health());
    }
    let counts = rig.counts(200);
    assert!(counts.iter().all(|counts| counts.status == Status::Ok && counts.homed == 7), "{:?}", counts[0]);
    assert_true(&counts, twin, requested, 100);
    assert_eq!(rig.device.health().received.lost, 0);
}

fn arm() {
    for format in [SampleFormat::Lines, SampleFormat::Blocks] {
        plug_in();
        let (twin, requested) = an_arm();
        let mut spoken = Some(Spoken::on(GADGET, 115_200, &twin));
        let model = Model::Ea1 { path: HOST.into(), format };
        let settings = ArmSettings { model, settings: Settings::default(), keeps_raw: false };
        let mut rig = Rig::start(drivers::open(&OpenSettings::Arm(settings)).unwrap());
        rig.until(State::Running, 6 * SECOND);
        assert_right(&mut rig, &twin, &requested);
        // The same plug supplies its power: the arm loses its home position.
        spoken.as_ref().unwrap().fall_silent_mid_record();
        let mut last = rig.readings(30 * MS);
        pull_out();
        twin.lock().unwrap().unplug();
        let begin = Monotonic.now_ns();
        while rig.state() != State::Absent {
            last.extend(rig.readings(5 * MS));
            assert!(Monotonic.now_ns() < begin + 2 * SECOND, "{:?}", rig.device.health());
        }
        drop(spoken.take());
        assert!(rig.readings(700 * MS).is_empty());
        {
            let mut twin = twin.lock().unwrap();
            twin.wire.plugged = true;
            twin.restart(Monotonic.now_ns());
        }
        let plugged = plug_in();
        let again = Spoken::on(GADGET, 115_200, &twin);
        rig.until(State::Running, 6 * SECOND);
        let back = Monotonic.now_ns() - plugged - drivers::simulated::ea1::START;
        assert!(back < 2 * SECOND, "{} ms after it first answered", back / MS);
        assert_right(&mut rig, &twin, &requested);
        println!("{}: running {} ms after it first answered", rig.device.describe().name, back / MS);
        rig.device.stop().unwrap();
        drop(again);
        pull_out();
    }
}

fn lines() -> Vec<Listing> {
    let mut found = serial::list();
    found.retain(|listing| listing.id == HOST);
    found
}

fn listing() {
    let wait = |count: usize| {
        let begin = Monotonic.now_ns();
        while lines().len() != count {
            assert!(Monotonic.now_ns() < begin + 5 * SECOND, "{:?}", serial::list());
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
        (Monotonic.now_ns() - begin) / MS
    };
    pull_out();
    wait(0);
    plug_in();
    let arrived = wait(1);
    let listed = &lines()[0];
    assert_eq!(listed.description, "Sonoweave Arm (2341:0043), /dev/ttyACM0");
    assert_eq!(listed.unavailable, None);
    pull_out();
    println!("listed {arrived} ms after it was plugged in, and no more {} ms after it was pulled out", wait(0));
}
