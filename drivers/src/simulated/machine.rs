//! A twin whatever its kind, for those who run one as a program.

use super::{Model, Simulated, Tally, ea1, microscribe, qsb};
use crate::transport::Peer;

/// What every twin is besides the other end of a line.
pub trait Machine: Peer {
    /// Its plug is pulled out: what is on its way is lost, and what it knows only while it has power.
    fn pull(&mut self);

    /// It is plugged in again.
    fn plug_in(&mut self, now_ns: i64);

    /// What became of all that it had to say.
    fn tally(&self) -> Tally;

    /// The commands that it has obeyed since this was asked last, by their bytes. Who runs a twin for long asks now and then, or they add up.
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
