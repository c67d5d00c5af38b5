//! Trackers on USB against the kernel's own USB, with simulated devices on its virtual host
//! controller: `make hardware-test`. Elsewhere every test is reported as ignored.
//!
//! - [`listing`]: devices that are plugged in, and those that can be opened.
//! - [`poses`]: poses equal the measured ones, for any division of the bytes.
//! - [`faults`]: unplugging, silence, refusals.
//! - [`vhci`], [`descriptors`]: a simulated device.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]
#![allow(clippy::print_stdout, reason = "a test of times says what they were")]

#[path = "../guest_grabber/allocations.rs"]
mod allocations;
mod descriptors;
mod faults;
#[path = "../guest/mod.rs"]
mod guest;
mod listing;
mod poses;
mod vhci;

use std::process::ExitCode;
use std::sync::{Arc, Mutex, MutexGuard};

use drivers::simulated::{Faults, Machine, Model, Simulated, fastrak, liberty, viper};
use drivers::tracker::polhemus::{self, Port, Settings};

use descriptors::Described;
use guest::{Rig, Truth};
use vhci::Plug;

fn main() -> ExitCode {
    guest::run(&[listing::TESTS, poses::TESTS, faults::TESTS])
}

/// A virtual unit with a plug that may be in or out.
struct Unit<M> {
    model: polhemus::Model,
    truth: Truth,
    twin: Arc<Mutex<Simulated<M>>>,
    described: Described,
    /// Port of the virtual controller.
    port: usize,
    plug: Option<Plug>,
}

impl<M: Model + 'static> Unit<M> {
    fn new(
        model: polhemus::Model,
        described: Described,
        make: impl FnOnce(drivers::simulated::Motion) -> Simulated<M>,
    ) -> Self {
        let truth = Truth::new();
        let mut twin = make(truth.motion());
        twin.wire.usb = true;
        Self { model, truth, twin: Arc::new(Mutex::new(twin)), described, port: 0, plug: None }
    }

    fn twin(&self) -> MutexGuard<'_, Simulated<M>> {
        self.twin.lock().unwrap()
    }

    fn plug(&self) -> &Plug {
        self.plug.as_ref().unwrap()
    }

    fn plug_in(&mut self) {
        self.twin().wire.plugged = true;
        self.plug = Some(Plug::into(self.port, self.described.clone(), Arc::clone(&self.twin)));
    }

    fn pull_out(&mut self) {
        self.plug = None;
        self.twin().unplug();
    }

    /// Opens the only unit of its kind.
    fn open(&self) -> Rig {
        self.open_with(None, Settings::default())
    }

    fn open_with(&self, which: Option<&str>, settings: Settings) -> Rig {
        guest::tracker(self.model, Port::Usb(which.map(ToOwned::to_owned)), settings)
    }
}

fn a_liberty(described: Described) -> Unit<liberty::Liberty> {
    Unit::new(polhemus::Model::Liberty, described, |motion| liberty::Twin::new(motion, Faults::default()))
}

/// Creates a LIBERTY of present manufacture, plugged in.
fn liberty() -> Unit<liberty::Liberty> {
    let mut unit = a_liberty(Described::new(0xff20, true, [0x04, 0x88]));
    unit.plug_in();
    unit
}

fn a_patriot(described: Described) -> Unit<liberty::Liberty> {
    Unit::new(polhemus::Model::Patriot, described, |motion| liberty::Twin::patriot(motion, Faults::default()))
}

fn a_viper() -> Unit<viper::Viper> {
    let described = Described::new(0xbf01, true, [0x02, 0x81]);
    Unit::new(polhemus::Model::Viper, described, |motion| viper::Twin::new(motion, Faults::default()))
}

fn a_fastrak(product: u16) -> Unit<fastrak::Fastrak> {
    let described = Described::new(product, false, [0x02, 0x81]);
    Unit::new(polhemus::Model::Fastrak, described, |motion| fastrak::Twin::new(motion, Faults::default()))
}
