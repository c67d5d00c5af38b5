//! A line within the process, to a simulated device, on a manually advanced clock. Ten seconds
//! of waiting take no time.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use sonoweave_core::clock::{Clock, Manual};

use super::{LineError, Opener, Received, Transport};

/// The device's side of a line: it receives the driver's bytes, and returns answers with their
/// times.
pub trait Peer: Send {
    /// Handles the driver's attempt to open the line.
    ///
    /// # Errors
    /// The error that the driver receives instead of a line.
    fn open(&mut self, _now_ns: i64) -> Result<(), LineError> {
        Ok(())
    }

    /// Receives bytes from the driver, sent at this rate; 0 on a line that has none.
    fn written(&mut self, bytes: &[u8], baud: u32, now_ns: i64);

    /// Returns the next bytes to the driver and their arrival time, at most `until_ns`. `None`
    /// for silence until then.
    ///
    /// # Errors
    /// An error if the line is gone.
    fn next(&mut self, baud: u32, now_ns: i64, until_ns: i64) -> Result<Option<(i64, Vec<u8>)>, LineError>;

    /// Returns the time of the next bytes if the driver sends nothing, ns; `None` if none will
    /// come.
    fn due(&mut self, now_ns: i64) -> Option<i64>;
}

/// Opens lines to a simulated device.
pub struct MemoryOpener<P> {
    peer: Arc<Mutex<P>>,
    clock: Manual,
    baud: u32,
}

impl<P: Peer> MemoryOpener<P> {
    /// Creates an opener for that device with this initial rate. Reads on its lines advance the
    /// clock.
    pub fn new(peer: Arc<Mutex<P>>, clock: Manual, baud: u32) -> Self {
        Self { peer, clock, baud }
    }
}

struct Line<P> {
    peer: Arc<Mutex<P>>,
    clock: Manual,
    baud: u32,
    /// Received bytes that did not fit into the caller's buffer.
    left: VecDeque<u8>,
}

fn locked<P>(peer: &Mutex<P>) -> MutexGuard<'_, P> {
    peer.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<P: Peer + 'static> Opener for MemoryOpener<P> {
    fn name(&self) -> &str {
        "a simulated line"
    }

    fn open(&mut self) -> Result<Box<dyn Transport>, LineError> {
        locked(&self.peer).open(self.clock.now_ns())?;
        let left = VecDeque::new();
        Ok(Box::new(Line { peer: Arc::clone(&self.peer), clock: self.clock.clone(), baud: self.baud, left }))
    }
}

impl<P: Peer> Transport for Line<P> {
    fn read(&mut self, into: &mut [u8], deadline_ns: i64) -> Result<Received, LineError> {
        if self.left.is_empty() {
            let now = self.clock.now_ns();
            match locked(&self.peer).next(self.baud, now, deadline_ns.max(now))? {
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
        locked(&self.peer).written(bytes, self.baud, self.clock.now_ns());
        Ok(())
    }

    fn set_baud(&mut self, baud: u32) -> Result<(), LineError> {
        self.baud = baud;
        self.left.clear();
        Ok(())
    }
}
