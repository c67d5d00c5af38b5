//! A session runs for a day: memory does not grow, and a reading allocates nothing.

#![allow(clippy::unwrap_used, reason = "tests fail so")]
#![allow(clippy::print_stdout, reason = "what was held is the test's figure")]
#![allow(unsafe_code, reason = "an allocator that counts is one by the trait's own terms")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use drivers::arm::microscribe::{self, Family};
use drivers::arm::{self, ea1, qsb};
use drivers::connection::{Connection, Protocol};
use drivers::simulated::fastrak::Twin;
use drivers::simulated::{self, Faults, Joints, Machine, Placed, Pty};
use drivers::tracker::polhemus::fastrak::Unit;
use drivers::tracker::polhemus::{Settings, isotrak, liberty, viper};
use drivers::transport::{MemoryOpener, Opener, Peer, PortPath, SerialOpener};
use sonoweave_core::clock::{Clock, MS, Manual, Monotonic, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::reading::Reading;
use sonoweave_core::{Device, Next};

/// Counts the memory held by this process, and the requests of this thread.
struct Counting;

static HELD: AtomicI64 = AtomicI64::new(0);

thread_local! {
    static REQUESTED: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: every call is passed unchanged to the system's allocator. Counting neither allocates
// nor unwinds (the thread's cell is constant and without a destructor).
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        HELD.fetch_add(layout.size() as i64, Ordering::Relaxed);
        REQUESTED.with(|requested| requested.set(requested.get() + 1));
        // SAFETY: the caller's promise is the system allocator's condition.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size() as i64, Ordering::Relaxed);
        // SAFETY: the memory came from the system's allocator, by `alloc` above, with this
        // layout.
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Runs the tests one at a time, because the held memory is counted for the whole process.
static ALONE: Mutex<()> = Mutex::new(());

fn still() -> drivers::simulated::Motion {
    Arc::new(|_, _| Placed { position_cm: [10.0, -5.5, 30.25], quaternion_wxyz: [0.5, -0.5, 0.5, -0.5] })
}

/// Reads a device until it runs, and 120 readings further. Checks that neither a reading nor an
/// empty wait allocates.
fn allocates_nothing(name: &str, device: &mut dyn Device, is_true: impl Fn(&Reading) -> bool) {
    device.start().unwrap();
    // Ends what hangs.
    let end = Monotonic.now_ns() + 180 * SECOND;
    let mut since = 0;
    let [mut readings, mut empty, mut allocated] = [0; 3];
    while readings < 170 || empty < 20 {
        assert!(Monotonic.now_ns() < end, "{name}: {readings} readings, {empty} waits, {:?}", device.health());
        // Shorter than the pause between two readings, so that some waits end empty.
        let limit = Monotonic.now_ns() + 3 * MS;
        let before = REQUESTED.get();
        let next = device.next(limit).unwrap();
        let requested = REQUESTED.get() - before;
        // On a busy machine, a twin that does not run falls silent, and the unit is set up again.
        if device.health().since_ns != since {
            since = device.health().since_ns;
            [readings, empty, allocated] = [0; 3];
        }
        let runs = readings >= 50;
        match next {
            Next::Reading(reading) => {
                assert!(is_true(&reading), "{name}: {reading:?}");
                readings += 1;
            }
            Next::Pending => empty += u64::from(runs),
            other => panic!("{name}: {other:?}"),
        }
        allocated += if runs { requested } else { 0 };
    }
    assert_eq!(allocated, 0, "{name}: allocations in {} readings and {empty} waits without one", readings - 50);
}

/// Does so for a unit with its twin on a pseudo-terminal.
fn unit_allocates_nothing(
    name: &str,
    twin: impl Peer + 'static,
    unit: impl Protocol,
    is_true: impl Fn(&Reading) -> bool,
) {
    let pty = Pty::run(Arc::new(Mutex::new(twin))).unwrap();
    let mut device = Connection::new(opener(&pty), Arc::new(Monotonic), unit, false);
    allocates_nothing(name, &mut device, is_true);
}

fn opener(pty: &Pty) -> Box<dyn Opener> {
    Box::new(SerialOpener::new(PortPath { path: pty.path().into(), baud: 115_200 }, Arc::new(Monotonic)))
}

#[test]
fn arm_reading_allocates_nothing() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let joints: Joints = Arc::new(|_| [1, 2, 3, 0, 0, 0]);
    // Homed or not, as lines or blocks; pings are sent meanwhile.
    for (homed, format) in [(7, ea1::SampleFormat::Lines), (5, ea1::SampleFormat::Blocks)] {
        let mut twin = simulated::ea1::Twin::new(Arc::clone(&joints), Faults::default());
        (twin.rate_hz, twin.homed) = (100, homed);
        let unit = ea1::Unit::new("a terminal", arm::Settings::default(), format).unwrap();
        unit_allocates_nothing(
            "EA1",
            twin,
            unit,
            |reading| matches!(reading, Reading::Counts(counts) if counts.as_slice() == [1, 2, 3] && u16::from(counts.homed) == homed),
        );
    }
    let twin = |axis| simulated::qsb::Twin::new(Arc::clone(&joints), axis, Faults::default());
    let lines = [0, 1, 2].map(|axis| Pty::run(Arc::new(Mutex::new(twin(axis)))).unwrap());
    let openers = lines.each_ref().map(opener);
    let mut device = qsb::Arm::new(openers, Arc::new(Monotonic), &arm::Settings::default(), false).unwrap();
    allocates_nothing("QSB", &mut device, |reading| matches!(reading, Reading::Counts(counts) if counts.axes == 1));
    let twin = simulated::microscribe::Twin::new(joints, Faults::default());
    let unit = microscribe::Unit::new("a terminal", arm::Settings::default(), Family::MicroScribe, 6).unwrap();
    // Counts start at the encoders' values at home.
    unit_allocates_nothing(
        "MicroScribe",
        twin,
        unit,
        |reading| matches!(reading, Reading::Counts(counts) if counts.as_slice().starts_with(&[8193, 12_002, 14_003])),
    );
}

#[test]
fn tracker_reading_allocates_nothing() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let (settings, faults) = (Settings::default(), Faults::default());
    let text = Settings { binary: false, ..Settings::default() };
    let is_true = |reading: &Reading| {
        let Reading::Pose(pose) = reading else { return false };
        pose.position_cm.iter().zip([10.0, -5.5, 30.25]).all(|(cm, expected)| (cm - expected).abs() < 0.003)
    };
    let unit = |settings: &Settings| Unit::new("a terminal", settings.clone(), Some(115_200)).unwrap();
    unit_allocates_nothing("FASTRAK", Twin::new(still(), faults), unit(&settings), is_true);
    unit_allocates_nothing("FASTRAK's text", Twin::new(still(), faults), unit(&text), is_true);
    let twin = || simulated::isotrak::Twin::new(still(), faults);
    let unit = |settings: Settings| isotrak::Unit::new("a terminal", settings, Some(115_200)).unwrap();
    unit_allocates_nothing("ISOTRAK", twin(), unit(settings.clone()), is_true);
    unit_allocates_nothing("ISOTRAK's text", twin(), unit(text), is_true);
    let unit = liberty::Unit::new("a terminal", settings.clone(), Some(115_200)).unwrap();
    unit_allocates_nothing("LIBERTY", simulated::liberty::Twin::new(still(), faults), unit, is_true);
    let unit = viper::Unit::new("a terminal", settings, Some(115_200)).unwrap();
    unit_allocates_nothing("VIPER", simulated::viper::Twin::new(still(), faults), unit, is_true);
}

#[test]
fn day_of_faults_keeps_memory_constant() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    // The run includes faults, pulled plugs and silences. The full length is a day, else an
    // hour.
    let hours = if std::env::var("SONOWEAVE_STRESS").is_ok_and(|length| length == "full") { 24 } else { 1 };
    let faults = Faults { drop: 1e-4, dropout: 1e-3, jitter_ns: 3 * MS, ..Faults::default() };
    let twin = Arc::new(Mutex::new(Twin::new(still(), faults)));
    let clock = Manual::at(0);
    let opener = MemoryOpener::new(Arc::clone(&twin), clock.clone(), 115_200);
    let unit = Unit::new("a line", Settings::default(), None).unwrap();
    let mut device = Connection::new(Box::new(opener), Arc::new(clock.clone()), unit, false);
    device.start().unwrap();
    let mut poses = 0_u64;
    let mut held = Vec::new();
    for minute in 1..=hours * 60_i64 {
        while clock.now_ns() < minute * 60 * SECOND {
            if let Next::Reading(_) = device.next(clock.now_ns() + 50 * MS).unwrap() {
                poses += 1;
            }
        }
        let mut twin = twin.lock().unwrap();
        twin.wire.plugged = true;
        twin.wire.hung = false;
        match minute % 60 {
            20 => twin.unplug(),
            40 => twin.wire.hung = true,
            // Once an hour all is well again, and the held memory must be unchanged.
            0 => {
                twin.wire.obeyed = Vec::new();
                held.push(HELD.load(Ordering::Relaxed));
            }
            _ => {}
        }
    }
    let received = device.health().received;
    assert_eq!(device.health().state, State::Running);
    assert!(received.opened == 1 + hours as u64 && received.set_up > 2 * hours as u64, "{received:?}");
    // 120 poses per second, less two minutes of each hour and the cost of the faults.
    let expected = 120 * 58 * 60 * hours as u64;
    assert!((expected * 95 / 100..expected).contains(&poses), "{poses} of {expected}");
    let [low, high] = [held.iter().min().unwrap(), held.iter().max().unwrap()];
    println!("{hours} h: {poses} poses, {received:?}, {low} to {high} bytes held at the hours' ends");
    assert!(high - low < 16 * 1024, "{held:?}");
}
