//! A line within the process, to a simulated device: on a manually advanced clock, where ten
//! seconds of waiting take no time, or in real time.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use sonoweave_core::clock::{Clock, Manual, Monotonic};

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
pub struct MemoryOpener<P: ?Sized> {
    peer: Arc<Mutex<P>>,
    clock: Arc<dyn Clock>,
    baud: u32,
    is_exact: bool,
}

impl<P: Peer + ?Sized> MemoryOpener<P> {
    /// Creates an opener for that device with this initial rate. Reads on its lines advance the
    /// clock.
    pub fn new(peer: Arc<Mutex<P>>, clock: Manual, baud: u32) -> Self {
        Self { peer, clock: Arc::new(clock), baud, is_exact: false }
    }

    /// Creates an opener for that device on the machine's clock. All bytes have the times at
    /// which they arrive on the simulated line, however late the host reads them: a loaded
    /// machine does not displace readings in time. As on a pseudo-terminal, the rate is 0.
    pub fn in_real_time(peer: Arc<Mutex<P>>) -> Self {
        Self { peer, clock: Arc::new(Monotonic), baud: 0, is_exact: true }
    }
}

struct Line<P: ?Sized> {
    peer: Arc<Mutex<P>>,
    clock: Arc<dyn Clock>,
    baud: u32,
    /// Whether each read returns bytes of one arrival time, and that time.
    is_exact: bool,
    /// Arrival time of the last bytes, host ns.
    at_ns: Option<i64>,
    /// Received bytes that did not fit into the caller's buffer.
    left: VecDeque<u8>,
}

fn locked<P: ?Sized>(peer: &Mutex<P>) -> MutexGuard<'_, P> {
    peer.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<P: Peer + ?Sized + 'static> Opener for MemoryOpener<P> {
    fn name(&self) -> &str {
        "a virtual line"
    }

    fn open(&mut self) -> Result<Box<dyn Transport>, LineError> {
        locked(&self.peer).open(self.clock.now_ns())?;
        Ok(Box::new(Line {
            peer: Arc::clone(&self.peer),
            clock: Arc::clone(&self.clock),
            baud: self.baud,
            is_exact: self.is_exact,
            at_ns: None,
            left: VecDeque::new(),
        }))
    }
}

impl<P: Peer + ?Sized> Transport for Line<P> {
    fn read(&mut self, into: &mut [u8], deadline_ns: i64) -> Result<Received, LineError> {
        if self.left.is_empty() {
            let now = self.clock.now_ns();
            // From the last arrival on, the device returns bytes of one arrival time; from now on,
            // it returns all that have arrived.
            let from = self.at_ns.filter(|_| self.is_exact).unwrap_or(now);
            let next = locked(&self.peer).next(self.baud, from, deadline_ns.max(now))?;
            match next {
                Some((at_ns, bytes)) => {
                    self.clock.wait_until(at_ns);
                    self.at_ns = Some(at_ns);
                    self.left.extend(bytes);
                }
                None => self.clock.wait_until(deadline_ns),
            }
        }
        let bytes = self.left.len().min(into.len());
        for (into, byte) in into.iter_mut().zip(self.left.drain(..bytes)) {
            *into = byte;
        }
        let now = self.clock.now_ns();
        Ok(Received { bytes, at_ns: self.at_ns.filter(|_| self.is_exact && bytes > 0).unwrap_or(now) })
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), LineError> {
        locked(&self.peer).written(bytes, self.baud, self.clock.now_ns());
        Ok(())
    }

    fn set_baud(&mut self, baud: u32) -> Result<(), LineError> {
        if !self.is_exact {
            self.baud = baud;
        }
        self.left.clear();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use sonoweave_core::clock::MS;

    use super::*;
    use crate::simulated::{Faults, Wire};

    /// A device that sends a byte every 10 ms.
    struct Ticker {
        wire: Wire,
        sent: u8,
    }

    impl Peer for Ticker {
        fn written(&mut self, _bytes: &[u8], _baud: u32, _now_ns: i64) {}

        fn next(&mut self, _: u32, now_ns: i64, until_ns: i64) -> Result<Option<(i64, Vec<u8>)>, LineError> {
            while i64::from(self.sent) * 10 * MS <= until_ns.max(now_ns) {
                self.wire.send(&[self.sent], 0, i64::from(self.sent) * 10 * MS);
                self.sent += 1;
            }
            let due = self.wire.due().filter(|at| *at <= until_ns);
            Ok(due.and_then(|at| self.wire.receive(at.max(now_ns))))
        }

        fn due(&mut self, _now_ns: i64) -> Option<i64> {
            self.wire.due()
        }
    }

    #[test]
    fn late_reads_get_arrival_times_on_an_exact_line_only() {
        for is_exact in [false, true] {
            let clock = Manual::at(0);
            let ticker = Ticker { wire: Wire::new(1_000_000, Faults::default()), sent: 1 };
            let peer = Arc::new(Mutex::new(ticker));
            let mut opener = MemoryOpener { is_exact, ..MemoryOpener::new(peer, clock.clone(), 0) };
            let mut line = opener.open().unwrap();
            let mut read = |deadline_ns| {
                let mut bytes = [0; 16];
                let received = line.read(&mut bytes, deadline_ns).unwrap();
                (bytes[..received.bytes].to_vec(), received.at_ns / MS)
            };
            assert_eq!(read(5 * MS), (vec![], 5));
            assert_eq!(read(25 * MS), (vec![1], 10));
            // The host is late by 32 ms.
            clock.wait_until(62 * MS);
            if is_exact {
                assert_eq!([(); 5].map(|()| read(62 * MS)), [2, 3, 4, 5, 6].map(|n| (vec![n], 10 * i64::from(n))));
            } else {
                assert_eq!(read(62 * MS), (vec![2, 3, 4, 5, 6], 62));
            }
            assert_eq!(read(65 * MS), (vec![], 65));
            assert_eq!(read(75 * MS), (vec![7], 70));
        }
    }
}
