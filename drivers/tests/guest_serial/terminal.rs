//! A pseudo-terminal of the guest's kernel.

use std::os::unix::fs::symlink;
use std::path::Path;
use std::sync::{Arc, Mutex};

use serialport::{SerialPort, TTYPort};

use drivers::simulated::Machine;
use drivers::tracker::polhemus::Model;
use drivers::transport::Peer;
use sonoweave_core::clock::{Clock, Monotonic};

use super::guest::Test;
use super::spoken::Spoken;
use super::{a_fastrak, assert_exact, assert_survives_unplugging, open};

pub(crate) const TESTS: &[Test] = &[("a_terminal_that_hangs_up_mid_record_is_opened_when_it_is_back", hang_up)];

/// A persistent name, like that of a udev rule.
const NAME: &str = "/tmp/tracker";

/// Connects the unit to a new terminal. The unit's end is closed when the result is dropped.
fn speak<T: Peer + 'static>(peer: &Arc<Mutex<T>>) -> Spoken {
    let (own, other) = TTYPort::pair().unwrap();
    let path = other.name().unwrap();
    let _ = std::fs::remove_file(NAME);
    symlink(path, NAME).unwrap();
    // Reading one end fails while nobody has the other end open, so both ends are kept.
    let mut once = Some(own);
    Spoken::by(peer, move || {
        let _kept = &other;
        once.take()
    })
}

fn hang_up() {
    let (twin, truth) = a_fastrak();
    twin.lock().unwrap().continuous = true;
    let spoken = speak(&twin);
    let mut rig = open(Model::Fastrak, NAME, None);
    assert_exact(&mut rig, &truth, 240);
    assert_survives_unplugging(
        &mut rig,
        &truth,
        spoken,
        |spoken| {
            *spoken = None;
            std::fs::remove_file(NAME).unwrap();
            twin.lock().unwrap().unplug();
        },
        || {
            twin.lock().unwrap().wire.plugged = true;
            (speak(&twin), Monotonic.now_ns())
        },
    );
    assert!(!Path::new("/dev/pts/99").exists(), "terminals are let go");
}
