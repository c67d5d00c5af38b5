//! An arm whose home position can be confirmed while it runs.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use sonoweave_core::{Description, Device, Error, Health, Next};

/// All axes that there can be.
const ALL: u8 = u8::MAX;

/// An arm with a flag for the home position. Only the user knows when the arm is there: encoders
/// measure movements, not positions.
pub(super) struct Homed {
    arm: Box<dyn Device>,
    at_home: Arc<AtomicBool>,
}

impl Homed {
    /// Returns the arm, and the flag to set when it is at home.
    pub(super) fn new(arm: Box<dyn Device>) -> (Self, Arc<AtomicBool>) {
        let at_home = Arc::new(AtomicBool::new(false));
        (Self { arm, at_home: Arc::clone(&at_home) }, at_home)
    }
}

impl Device for Homed {
    fn start(&mut self) -> Result<(), Error> {
        self.arm.start()
    }

    fn next(&mut self, deadline_ns: i64) -> Result<Next, Error> {
        if self.at_home.swap(false, Ordering::Relaxed) {
            tracing::info!("{}: is said to be in its home position", self.arm.describe().name);
            self.arm.home(ALL)?;
        }
        self.arm.next(deadline_ns)
    }

    fn stop(&mut self) -> Result<(), Error> {
        self.arm.stop()
    }

    fn home(&mut self, axes: u8) -> Result<(), Error> {
        self.arm.home(axes)
    }

    fn describe(&self) -> &Description {
        self.arm.describe()
    }

    fn health(&self) -> &Health {
        self.arm.health()
    }
}
