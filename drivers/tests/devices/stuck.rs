//! An open line that accepts nothing: a USB device that is always busy, or an adapter that was
//! told to wait.

use std::sync::{Arc, Mutex};

use drivers::connection::Connection;
use drivers::simulated::Faults;
use drivers::simulated::liberty::Twin;
use drivers::tracker::polhemus::liberty::Unit;
use drivers::tracker::polhemus::{Line, Settings};
use drivers::transport::{LineError, MemoryOpener, Opener, Received, Transport};
use sonoweave_core::clock::{Clock, MS, Manual, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::{Device, Next};

use crate::bench::{BEGIN, ticking};

/// Time that a blocked write waits, ns.
const WRITE: i64 = 250 * MS;

/// A line that accepts sent bytes, or does not.
struct Stubborn {
    line: Box<dyn Transport>,
    clock: Manual,
    /// Whether it accepts nothing, and the bytes sent in vain.
    refuses: Arc<Mutex<(bool, Vec<Vec<u8>>)>>,
}

impl Transport for Stubborn {
    fn read(&mut self, into: &mut [u8], deadline_ns: i64) -> Result<Received, LineError> {
        self.line.read(into, deadline_ns)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), LineError> {
        let mut refuses = self.refuses.lock().unwrap();
        if !refuses.0 {
            return self.line.write(bytes);
        }
        refuses.1.push(bytes.to_vec());
        self.clock.pass(WRITE);
        Err(LineError::Stuck)
    }

    fn set_baud(&mut self, baud: u32) -> Result<(), LineError> {
        self.line.set_baud(baud)
    }
}

struct StubbornOpener {
    opener: MemoryOpener<Twin>,
    clock: Manual,
    refuses: Arc<Mutex<(bool, Vec<Vec<u8>>)>>,
}

impl Opener for StubbornOpener {
    fn name(&self) -> &str {
        "a line"
    }

    fn open(&mut self) -> Result<Box<dyn Transport>, LineError> {
        let (clock, refuses) = (self.clock.clone(), Arc::clone(&self.refuses));
        Ok(Box::new(Stubborn { line: self.opener.open()?, clock, refuses }))
    }
}

#[test]
fn unit_accepting_nothing_is_silent_and_rarely_reset() {
    let (clock, refuses) = (Manual::at(BEGIN), Arc::new(Mutex::new((true, Vec::new()))));
    let mut twin = Twin::new(ticking(), Faults::default());
    twin.wire.usb = true;
    let twin = Arc::new(Mutex::new(twin));
    let opener = StubbornOpener {
        opener: MemoryOpener::new(Arc::clone(&twin), clock.clone(), 0),
        clock: clock.clone(),
        refuses: Arc::clone(&refuses),
    };
    let unit = Unit::new("a line", Settings::default(), Line::Usb).unwrap();
    let mut device = Connection::new(Box::new(opener), Arc::new(clock.clone()), unit, false);
    device.start().unwrap();
    let pass = |device: &mut Connection<Unit>, ns: i64| {
        let end = clock.now_ns() + ns;
        let mut readings = 0;
        while clock.now_ns() < end {
            let deadline = clock.now_ns() + 10 * MS;
            readings += usize::from(matches!(device.next(deadline).unwrap(), Next::Reading(_)));
            assert!(clock.now_ns() <= deadline + WRITE, "longer than a write takes");
        }
        readings
    };
    assert_eq!(pass(&mut device, 2 * SECOND), 0);
    assert_eq!((device.health().state, device.health().received.opened), (State::Silent, 1));
    assert!(device.health().why.contains("does not answer; check that the unit is switched on"));
    assert_eq!(pass(&mut device, 118 * SECOND), 0);
    assert_eq!((device.health().state, device.health().received.opened), (State::Silent, 1));
    let restarts = refuses.lock().unwrap().1.iter().filter(|bytes| bytes.ends_with(b"\x19\r")).count();
    assert!((1..=4).contains(&restarts), "{restarts} in two minutes");
    refuses.lock().unwrap().0 = false;
    pass(&mut device, 2 * SECOND);
    assert_eq!(device.health().state, State::Running);
    // In the middle of a stream only received data counts.
    refuses.lock().unwrap().0 = true;
    assert!(pass(&mut device, SECOND) > 200);
    assert_eq!(device.health().state, State::Running);
    device.stop().unwrap();
    assert_eq!(device.health().state, State::Stopped);
}
