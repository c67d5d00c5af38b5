//! Measures the time from the last byte on a pseudo-terminal to the stamped reading: median and
//! 99th percentile.

#![allow(clippy::unwrap_used, reason = "a bench fails so")]
#![allow(clippy::print_stdout, reason = "its figures are its output")]

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use drivers::connection::Connection;
use drivers::simulated::fastrak::Twin;
use drivers::simulated::{Faults, Placed, Pty};
use drivers::tracker::polhemus::Settings;
use drivers::tracker::polhemus::fastrak::Unit;
use drivers::transport::{LineError, Peer, PortPath, SerialOpener};
use sonoweave_core::clock::{Clock, Monotonic, SECOND};
use sonoweave_core::reading::Reading;
use sonoweave_core::{Device, Next};

/// A twin that records when it hands out each record.
struct Noting {
    twin: Twin,
    handed: Arc<Mutex<VecDeque<i64>>>,
}

impl Peer for Noting {
    fn written(&mut self, bytes: &[u8], baud: u32, now_ns: i64) {
        self.twin.written(bytes, baud, now_ns);
    }

    fn next(&mut self, baud: u32, now_ns: i64, until_ns: i64) -> Result<Option<(i64, Vec<u8>)>, LineError> {
        let text = self.twin.next(baud, now_ns, until_ns)?;
        if let Some((_, bytes)) = &text
            && bytes.first() == Some(&b'0')
        {
            let now = Monotonic.now_ns();
            self.handed.lock().unwrap().extend(std::iter::repeat_n(now, bytes.len() / 33));
        }
        Ok(text)
    }

    fn due(&mut self, now_ns: i64) -> Option<i64> {
        self.twin.due(now_ns)
    }
}

fn main() {
    let quick = std::env::args().any(|argument| argument == "--quick");
    let expected = if quick { 240 } else { 3600 };
    let place = Placed { position_cm: [10.0, -5.5, 30.25], quaternion_wxyz: [0.5, -0.5, 0.5, -0.5] };
    let handed = Arc::new(Mutex::new(VecDeque::new()));
    let twin = Twin::new(Arc::new(move |_, _| place), Faults::default());
    let pty = Pty::run(Arc::new(Mutex::new(Noting { twin, handed: Arc::clone(&handed) }))).unwrap();
    let opener = SerialOpener::new(PortPath { path: pty.path().into(), baud: 115_200 }, Arc::new(Monotonic));
    let unit = Unit::new("a terminal", Settings::default(), Some(115_200)).unwrap();
    let mut device = Connection::new(Box::new(opener), Arc::new(Monotonic), unit, false);
    device.start().unwrap();
    let end = Monotonic.now_ns() + 120 * SECOND;
    let (mut whole, mut stamped, mut wrong) = (Vec::new(), Vec::new(), 0);
    while whole.len() < expected {
        let Next::Reading(Reading::Pose(pose)) = device.next(end).unwrap() else { panic!("{:?}", device.health()) };
        let now = Monotonic.now_ns();
        wrong += u32::from(pose.position_cm != place.position_cm);
        let handed = handed.lock().unwrap().pop_front().unwrap();
        whole.push(now - handed);
        stamped.push(pose.stamp.host_ns.unwrap() - handed);
    }
    // The first record waits for the second, which confirms it.
    for (what, times) in [("handed over", &mut whole), ("stamped", &mut stamped)] {
        times.remove(0);
        times.sort_unstable();
        let at = |share: f64| times[(share * (times.len() - 1) as f64) as usize] as f64 / 1e3;
        println!(
            "pseudo-terminal, byte to reading {what}: median {:.0} µs, 99 % {:.0} µs, most {:.0} µs; {} readings, {wrong} wrong",
            at(0.5),
            at(0.99),
            at(1.0),
            times.len()
        );
    }
    assert_eq!(wrong, 0, "a wrong answer is not timed");
}
