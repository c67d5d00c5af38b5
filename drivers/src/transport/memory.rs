//! A line within the process: what a simulated device says, at times of a clock that is turned by hand. Ten seconds of waiting pass in no time.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::{LineError, Opener, Received, Transport};
use crate::clock::{Clock, Manual};

/// The device's side of a line: it is told what the driver sends, and says what comes back and when.
pub trait Peer: Send {
    /// The driver has opened the line, or tries to.
    ///
    /// # Errors
    /// What the driver is to be told instead.
    fn open(&mut self, _now_ns: i64) -> Result<(), LineError> {
        Ok(())
    }

    /// The driver has sent bytes, at this rate; 0 on a line that has none.
    fn written(&mut self, bytes: &[u8], baud: u32, now_ns: i64);

    /// The next bytes to the driver and when they are there, no later than `until_ns`; `None` for silence until then.
    ///
    /// # Errors
    /// That the line is gone.
    fn next(&mut self, baud: u32, now_ns: i64, until_ns: i64) -> Result<Option<(i64, Vec<u8>)>, LineError>;

    /// When it will next say something if nothing is sent to it, ns; `None` where it will not.
    fn due(&self, now_ns: i64) -> Option<i64>;
}

/// Opens lines to a simulated device.
pub struct MemoryOpener<P> {
    peer: Arc<Mutex<P>>,
    clock: Manual,
    baud: u32,
}

impl<P: Peer> MemoryOpener<P> {
    /// To that device, at that rate at first. What the lines wait for turns the clock.
    pub fn new(peer: Arc<Mutex<P>>, clock: Manual, baud: u32) -> Self {
        Self { peer, clock, baud }
    }
}

struct Line<P> {
    peer: Arc<Mutex<P>>,
    clock: Manual,
    baud: u32,
    /// Bytes that were there and did not fit.
    left: VecDeque<u8>,
}

fn told<P>(peer: &Mutex<P>) -> MutexGuard<'_, P> {
    peer.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<P: Peer + 'static> Opener for MemoryOpener<P> {
    fn name(&self) -> &str {
        "a simulated line"
    }

    fn open(&mut self) -> Result<Box<dyn Transport>, LineError> {
        told(&self.peer).open(self.clock.now_ns())?;
        let left = VecDeque::new();
        Ok(Box::new(Line { peer: Arc::clone(&self.peer), clock: self.clock.clone(), baud: self.baud, left }))
    }
}

impl<P: Peer> Transport for Line<P> {
    fn read(&mut self, into: &mut [u8], deadline_ns: i64) -> Result<Received, LineError> {
        if self.left.is_empty() {
            let now = self.clock.now_ns();
            match told(&self.peer).next(self.baud, now, deadline_ns.max(now))? {
                Some((at_ns, bytes)) => {
                    self.clock.wait_until(at_ns);
                    self.left.extend(bytes);
                }
                None => self.clock.wait_until(deadline_ns),
            }
        }
        let bytes = self.left.len().min(into.len());
        for (into, byte) in into.iter_mut().zip(self.left.drain(..bytes)) {
            *into = byte;
        }
        Ok(Received { bytes, at_ns: self.clock.now_ns() })
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), LineError> {
        told(&self.peer).written(bytes, self.baud, self.clock.now_ns());
        Ok(())
    }

    fn set_baud(&mut self, baud: u32) -> Result<(), LineError> {
        self.baud = baud;
        self.left.clear();
        Ok(())
    }
}
