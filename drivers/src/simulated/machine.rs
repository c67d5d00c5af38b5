//! Common interface of all virtual devices, for programs that run one.

use super::{Model, Simulated, Tally, ea1, microscribe, qsb};
use crate::transport::Peer;

/// A virtual device of any kind.
pub trait Machine: Peer {
    /// Unplugs it: data in transit are lost, and so is its state without power.
    fn pull(&mut self);

    /// Plugs it in again.
    fn plug_in(&mut self, now_ns: i64);

    /// Returns the statistics of everything that it sent.
    fn tally(&self) -> Tally;

    /// Returns the commands obeyed since the last call, as bytes. Programs that run a device for
    /// long must call this regularly, or the commands accumulate.
    fn take_obeyed(&mut self) -> Vec<Vec<u8>>;
}

impl<M: Model> Machine for Simulated<M> {
    fn pull(&mut self) {
        self.unplug();
    }

    fn plug_in(&mut self, _now_ns: i64) {
        self.plugged = true;
    }

    fn tally(&self) -> Tally {
        self.wire().tally()
    }

    fn take_obeyed(&mut self) -> Vec<Vec<u8>> {
        std::mem::take(&mut self.obeyed)
    }
}

impl Machine for ea1::Twin {
    fn pull(&mut self) {
        self.unplug();
    }

    fn plug_in(&mut self, now_ns: i64) {
        self.plugged = true;
        self.restart(now_ns);
    }

    fn tally(&self) -> Tally {
        self.wire().tally()
    }

    fn take_obeyed(&mut self) -> Vec<Vec<u8>> {
        std::mem::take(&mut self.obeyed)
    }
}

impl Machine for qsb::Twin {
    fn pull(&mut self) {
        self.unplug();
    }

    fn plug_in(&mut self, now_ns: i64) {
        self.plugged = true;
        self.reset(now_ns);
    }

    fn tally(&self) -> Tally {
        self.wire().tally()
    }

    fn take_obeyed(&mut self) -> Vec<Vec<u8>> {
        std::mem::take(&mut self.obeyed)
    }
}

impl Machine for microscribe::Twin {
    fn pull(&mut self) {
        self.unplug();
    }

    fn plug_in(&mut self, _now_ns: i64) {
        self.plugged = true;
    }

    fn tally(&self) -> Tally {
        self.wire().tally()
    }

    fn take_obeyed(&mut self) -> Vec<Vec<u8>> {
        self.sampled.clear();
        std::mem::take(&mut self.obeyed).into_iter().map(|byte| vec![byte]).collect()
    }
}
