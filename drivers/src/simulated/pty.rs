//! A virtual device on a pseudo-terminal, in real time.

use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use serialport::{SerialPort, TTYPort};

use sonoweave_core::clock::{Clock, MS, Monotonic};

use crate::transport::Peer;

/// Longest wait of a device before it checks whether it must end, ns.
const TURN: i64 = 20 * MS;

/// A virtual device that runs in a thread and uses a pseudo-terminal until this is dropped. The
/// line then hangs up, as when a plug is pulled.
pub struct Pty {
    path: PathBuf,
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

/// Longest time that bytes wait for a host that does not read. Later bytes are lost until it
/// reads again, as on a line without a listener.
const WRITE: Duration = Duration::from_secs(10);
/// After a vain wait, each successful write restores this much of the waiting time.
const AGAIN: Duration = Duration::from_millis(1);

impl Pty {
    /// Opens a pseudo-terminal and starts the device on it.
    ///
    /// # Errors
    /// The system's error if no pseudo-terminal is available.
    pub fn run<P: Peer + ?Sized + 'static>(peer: Arc<Mutex<P>>) -> std::io::Result<Self> {
        let (mut own, other) = TTYPort::pair().map_err(std::io::Error::other)?;
        let path =
            other.name().map(PathBuf::from).ok_or_else(|| std::io::Error::other("the pseudo-terminal has no name"))?;
        let ends = Arc::new(AtomicBool::new(false));
        let stop = Arc::clone(&ends);
        let thread = std::thread::Builder::new().name("twin".into()).spawn(move || {
            // Keeps the other end open, because reading would fail while no host has it open.
            let kept = other;
            let mut patience = WRITE;
            while !stop.load(Ordering::Relaxed) {
                if let Err(error) = turn(&*peer, &mut own, &mut patience) {
                    tracing::warn!("a twin's pseudo-terminal: {error}");
                    break;
                }
            }
            drop(kept);
        })?;
        Ok(Self { path, ends, thread: Some(thread) })
    }

    /// Returns the path to open.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for Pty {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the twin on {} has panicked", self.path.display());
        }
    }
}

/// Returns whether an error only means that no data are ready.
fn is_early(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted | ErrorKind::WouldBlock)
}

/// Waits for data from the host or from the device, whichever is first, and passes it on.
/// `patience` is the time that bytes wait for a host: none after a vain wait, and more again as
/// the host reads.
fn turn<P: Peer + ?Sized>(peer: &Mutex<P>, own: &mut TTYPort, patience: &mut Duration) -> std::io::Result<()> {
    let now = Monotonic.now_ns();
    // A pseudo-terminal has no rate.
    let sent = peer.lock().unwrap_or_else(PoisonError::into_inner).next(0, now, now).map_err(std::io::Error::other)?;
    if let Some((_, bytes)) = sent {
        own.set_timeout(*patience).map_err(std::io::Error::other)?;
        *patience = match own.write_all(&bytes) {
            Ok(()) => (*patience + AGAIN).min(WRITE),
            Err(error) if is_early(&error) => Duration::ZERO,
            Err(error) => return Err(error),
        };
    }
    let until = peer.lock().unwrap_or_else(PoisonError::into_inner).due(now).unwrap_or(i64::MAX).min(now + TURN);
    let left = u64::try_from(until - Monotonic.now_ns()).unwrap_or(0);
    own.set_timeout(Duration::from_nanos(left)).map_err(std::io::Error::other)?;
    let mut buffer = [0; 1024];
    match own.read(&mut buffer) {
        Ok(0) => return Ok(()),
        Ok(bytes) => {
            let now = Monotonic.now_ns();
            peer.lock().unwrap_or_else(PoisonError::into_inner).written(&buffer[..bytes], 0, now);
        }
        Err(error) if is_early(&error) => {}
        Err(error) => return Err(error),
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::LineError;
    use sonoweave_core::clock::SECOND;

    /// Sends a kilobyte at a time, each with its number.
    struct Chatter {
        number: u8,
        received: Vec<u8>,
    }

    impl Peer for Chatter {
        fn written(&mut self, bytes: &[u8], _baud: u32, _now_ns: i64) {
            self.received.extend(bytes);
        }

        fn next(&mut self, _: u32, now_ns: i64, _: i64) -> Result<Option<(i64, Vec<u8>)>, LineError> {
            self.number = self.number.wrapping_add(1);
            Ok(Some((now_ns, vec![self.number; 1024])))
        }

        fn due(&mut self, now_ns: i64) -> Option<i64> {
            Some(now_ns + MS)
        }
    }

    #[test]
    fn host_that_does_not_read_loses_bytes() {
        let chatter = Arc::new(Mutex::new(Chatter { number: 0, received: Vec::new() }));
        let (mut own, mut other) = TTYPort::pair().unwrap();
        let mut patience = 20 * AGAIN;
        // A pseudo-terminal holds about four of them.
        for _ in 0..200 {
            turn(&*chatter, &mut own, &mut patience).unwrap();
        }
        assert!(patience < 5 * AGAIN, "nobody is waited for");
        other.write_all(b"be quiet").unwrap();
        let end = Monotonic.now_ns() + 5 * SECOND;
        while chatter.lock().unwrap().received != b"be quiet" {
            assert!(Monotonic.now_ns() < end, "not heard");
            turn(&*chatter, &mut own, &mut patience).unwrap();
        }
        // Once the host reads, all new data arrive.
        other.set_timeout(Duration::from_millis(20)).unwrap();
        let mut buffer = [0; 65_536];
        while other.read(&mut buffer).is_ok() {}
        turn(&*chatter, &mut own, &mut patience).unwrap();
        assert!(patience >= AGAIN);
        let mut sent = [0; 1024];
        other.read_exact(&mut sent).unwrap();
        assert_eq!(sent, [chatter.lock().unwrap().number; 1024]);
    }
}
