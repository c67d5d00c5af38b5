//! An FTDI adapter and a legacy serial port (8250), at the two ends of one cable.

use std::path::Path;
use std::process::Command;
use std::sync::{Arc, Mutex};

use drivers::simulated::{Faults, Machine, liberty};
use drivers::tracker::polhemus::{self, Model, Port, Settings};
use drivers::transport;
use sonoweave_core::Next;
use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};
use sonoweave_core::health::State;

use super::guest::{self, Test, Truth};
use super::spoken::Spoken;
use super::{a_fastrak, allocations, assert_exact, assert_survives_unplugging, open};

pub(crate) const TESTS: &[Test] = &[
    ("a_tracker_behind_ftdi_sio_is_exact_and_survives_unplugging", ftdi),
    ("a_tracker_behind_8250_is_exact_at_every_rate", port_8250),
    ("a_liberty_is_exact_on_either", liberty),
    ("a_reading_asks_for_no_memory", no_allocations),
    ("a_line_that_is_in_use_is_refused_by_a_sentence", in_use),
    ("a_unit_that_does_not_answer_is_silent_and_not_absent", hung),
    ("ports_that_are_there_are_listed_and_no_others", listing),
];

const FTDI: &str = "/dev/ttyUSB0";
const PORT: &str = "/dev/ttyS1";
const LATENCY: &str = "/sys/bus/usb-serial/devices/ttyUSB0/latency_timer";

fn wait_for_adapter(there: bool) {
    let end = Monotonic.now_ns() + 10 * SECOND;
    while Path::new(FTDI).exists() != there {
        assert!(Monotonic.now_ns() < end, "{FTDI} is{} there", if there { " not" } else { "" });
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
}

/// Returns the kernel's settings of a line.
fn reported(path: &str) -> String {
    let output = Command::new("stty").args(["-F", path, "-a"]).output().unwrap();
    String::from_utf8(output.stdout).unwrap().replace(['\n', ';'], " ")
}

/// Checks the line's settings: raw, 8 bits, no parity, one stop bit, no handshake.
fn assert_set(path: &str, baud: u32) {
    let reported = reported(path);
    let words: Vec<&str> = reported.split_whitespace().collect();
    for word in
        "cs8 -parenb -cstopb cread clocal -crtscts -ixon -ixoff -icrnl -istrip -inpck -opost -isig -icanon -echo"
            .split(' ')
    {
        assert!(words.contains(&word), "{path} is not {word}: {reported}");
    }
    assert!(reported.contains(&format!("speed {baud} baud")), "{path} is not at {baud}: {reported}");
}

fn ftdi() {
    wait_for_adapter(true);
    std::fs::write(LATENCY, "16").unwrap();
    let (twin, truth) = a_fastrak();
    let spoken = Spoken::on(PORT, 115_200, &twin);
    let mut rig = open(Model::Fastrak, FTDI, None);
    assert_exact(&mut rig, &truth, 360);
    assert_set(FTDI, 115_200);
    assert_eq!(std::fs::read_to_string(LATENCY).unwrap().trim(), "1", "bytes are passed on at once");
    assert_survives_unplugging(
        &mut rig,
        &truth,
        spoken,
        |_| {
            twin.lock().unwrap().unplug();
            println!("\nGUEST-UNPLUG:adapter");
        },
        || {
            twin.lock().unwrap().wire.plugged = true;
            println!("\nGUEST-PLUG:adapter");
            wait_for_adapter(true);
            (Spoken::on(PORT, 115_200, &twin), Monotonic.now_ns())
        },
    );
    assert_eq!(std::fs::read_to_string(LATENCY).unwrap().trim(), "1");
}

fn port_8250() {
    wait_for_adapter(true);
    for baud in [115_200, 57_600, 38_400, 19_200, 9_600] {
        let (twin, truth) = a_fastrak();
        twin.lock().unwrap().wire.baud = baud;
        let _spoken = Spoken::on(FTDI, baud, &twin);
        let mut rig = open(Model::Fastrak, PORT, Some(baud));
        rig.until(State::Running, 6 * SECOND);
        assert_set(PORT, baud);
        // The unit omits poses that exceed a slow line's capacity; the others are complete.
        let poses = rig.poses(60);
        if baud >= 57_600 {
            truth.assert_exact(&poses);
        } else {
            poses.iter().for_each(|pose| _ = truth.assert_exact(std::slice::from_ref(pose)));
        }
        assert_eq!(rig.device.health().received.refused, 0);
        rig.device.stop().unwrap();
    }
}

fn liberty() {
    wait_for_adapter(true);
    // QEMU waits forever for its port to accept bytes from the adapter. The port's buffer holds
    // 16 bytes and is slower; on a busy machine, 10 kB/s are too much.
    for (driver, unit, rate_hz) in [(FTDI, PORT, 240.0), (PORT, FTDI, 60.0)] {
        let truth = Truth::new();
        let twin = Arc::new(Mutex::new(liberty::Twin::new(truth.motion(), Faults::default())));
        let _spoken = Spoken::on(unit, 115_200, &twin);
        let port = Port::Serial { path: driver.into(), baud: Some(115_200) };
        let mut rig = guest::tracker(Model::Liberty, port, Settings { rate_hz, ..Settings::default() });
        assert_exact(&mut rig, &truth, 2 * rate_hz as usize);
        let received = rig.device.health().received;
        assert_eq!((received.set_up, received.lost, received.refused), (1, 0, 0), "{received:?}");
        rig.device.stop().unwrap();
    }
}

fn no_allocations() {
    wait_for_adapter(true);
    for [driver, unit] in [[FTDI, PORT], [PORT, FTDI]] {
        let (twin, _) = a_fastrak();
        let _spoken = Spoken::on(unit, 115_200, &twin);
        let mut rig = open(Model::Fastrak, driver, Some(115_200));
        rig.until(State::Running, 6 * SECOND);
        rig.poses(60);
        let (mut readings, mut pauses) = (0, 0);
        let before = allocations::so_far();
        while readings < 240 {
            match rig.device.next(Monotonic.now_ns() + 2 * MS).unwrap() {
                Next::Reading(_) => readings += 1,
                _ => pauses += 1,
            }
        }
        let requested = allocations::so_far() - before;
        assert_eq!(requested, 0, "for {readings} readings and {pauses} times that nothing came");
        assert!(pauses > 50, "{pauses}");
    }
}

fn in_use() {
    wait_for_adapter(true);
    for path in [FTDI, PORT] {
        let (clock, baud) = (Arc::new(sonoweave_core::clock::Monotonic), 115_200);
        let mut opener = transport::SerialOpener::new(transport::PortPath { path: path.into(), baud }, clock);
        let first = transport::Opener::open(&mut opener).unwrap();
        let mut rig = open(Model::Fastrak, path, None);
        assert!(rig.readings(300 * MS).is_empty());
        assert_eq!(rig.state(), State::Absent);
        assert!(rig.why().contains("another program has it open; close that"), "{}", rig.why());
        // A line without a unit at the other end is silent, not absent.
        drop(first);
        rig.until(State::Silent, 10 * SECOND);
        assert!(rig.why().contains("does not answer at 115200, "), "{}", rig.why());
    }
}

fn hung() {
    wait_for_adapter(true);
    let (twin, truth) = a_fastrak();
    let _spoken = Spoken::on(PORT, 115_200, &twin);
    let mut rig = open(Model::Fastrak, FTDI, Some(115_200));
    assert_exact(&mut rig, &truth, 120);
    twin.lock().unwrap().wire.hung = true;
    let noticed = rig.until(State::Silent, 2 * SECOND);
    assert!(rig.readings(2 * SECOND).is_empty());
    assert_eq!(rig.state(), State::Silent);
    twin.lock().unwrap().wire.hung = false;
    let back = rig.until(State::Running, 4 * SECOND);
    assert!(back < 2 * SECOND, "{} ms", back / MS);
    truth.assert_exact(&rig.poses(60));
    assert_eq!(rig.device.health().received.opened, 1, "it was open all along");
    println!("silent after {} ms, running {} ms after it answered again", noticed / MS, back / MS);
}

fn listing() {
    wait_for_adapter(true);
    let listed = polhemus::list();
    let described = |path: &str| listed.iter().find(|l| l.id == path).map(|l| l.description.as_str());
    assert_eq!(described(FTDI), Some("QEMU QEMU USB SERIAL (0403:6001), /dev/ttyUSB0"));
    assert_eq!(described(PORT), Some("serial line, /dev/ttyS1"));
    // The kernel keeps names of ports that no present machine has.
    assert!(Path::new("/dev/ttyS3").exists());
    assert_eq!([described("/dev/ttyS2"), described("/dev/ttyS3")], [None; 2]);
}
