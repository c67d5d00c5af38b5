//! A twin on a pseudo-terminal, in real time.

use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use serialport::{SerialPort, TTYPort};

use crate::clock::{Clock, MS, Monotonic};
use crate::transport::Peer;

/// The longest that a twin waits before it looks again whether it was told to end, ns.
const TURN: i64 = 20 * MS;

/// A twin that runs in a thread and speaks on a pseudo-terminal until this is dropped: then the line hangs up, as by pulling out a plug.
pub struct Pty {
    path: PathBuf,
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

/// The longest time that bytes may wait for a host that does not read them.
const WRITE: Duration = Duration::from_secs(10);

impl Pty {
    /// Opens a pseudo-terminal and lets the twin speak on it.
    ///
    /// # Errors
    /// The system's, where there is no pseudo-terminal to be had.
    pub fn run<P: Peer + 'static>(peer: Arc<Mutex<P>>) -> std::io::Result<Self> {
        let (mut own, other) = TTYPort::pair().map_err(std::io::Error::other)?;
        let path =
            other.name().map(PathBuf::from).ok_or_else(|| std::io::Error::other("the pseudo-terminal has no name"))?;
        let ends = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&ends);
        let thread = std::thread::Builder::new().name("twin".into()).spawn(move || {
            // While nobody else has it open, its other end is kept so: else reading would fail.
            let kept = other;
            while !told.load(Ordering::Relaxed) {
                if let Err(error) = turn(&peer, &mut own) {
                    tracing::warn!("a twin's pseudo-terminal: {error}");
                    break;
                }
            }
            drop(kept);
        })?;
        Ok(Self { path, ends, thread: Some(thread) })
    }

    /// The file to open.
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

/// Waits for what the host sends or what the twin says next, whichever is first, and passes it on.
fn turn<P: Peer>(peer: &Mutex<P>, own: &mut TTYPort) -> std::io::Result<()> {
    let now = Monotonic.now_ns();
    // A pseudo-terminal has no rate.
    let said = peer.lock().unwrap_or_else(PoisonError::into_inner).next(0, now, now).map_err(std::io::Error::other)?;
    if let Some((_, bytes)) = said {
        own.set_timeout(WRITE).map_err(std::io::Error::other)?;
        own.write_all(&bytes)?;
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
        Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted | ErrorKind::WouldBlock) => {}
        Err(error) => return Err(error),
    }
    Ok(())
}
