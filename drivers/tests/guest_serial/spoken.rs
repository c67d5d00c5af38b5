//! A virtual unit that communicates on a serial line of the kernel, in real time.

use std::io::{ErrorKind, Read, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use serialport::{SerialPort, TTYPort};

use drivers::transport::Peer;
use sonoweave_core::clock::{Clock, MS, Monotonic};

/// The longest wait of the unit's thread, ns.
const TURN: i64 = 10 * MS;
/// The longest time that bytes may wait for a host that does not read them.
const WRITE: Duration = Duration::from_secs(5);

/// Communicates until dropped; reopens its end of the line after a hang-up.
pub(crate) struct Spoken {
    ends: Arc<AtomicBool>,
    breaks_off: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Spoken {
    /// Communicates on this file.
    pub(crate) fn on<T: Peer + 'static>(path: &str, baud: u32, peer: &Arc<Mutex<T>>) -> Self {
        let path = path.to_owned();
        Self::by(peer, move || serialport::new(&path, baud).open_native().ok())
    }

    /// Communicates on the line that `open` returns, reopened as needed.
    pub(crate) fn by<T: Peer + 'static>(
        peer: &Arc<Mutex<T>>,
        mut open: impl FnMut() -> Option<TTYPort> + Send + 'static,
    ) -> Self {
        let (ends, breaks_off) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
        let (reported, cut, peer) = (Arc::clone(&ends), Arc::clone(&breaks_off), Arc::clone(peer));
        let run = move || {
            while !reported.load(Ordering::Relaxed) {
                let Some(mut line) = open() else {
                    std::thread::sleep(Duration::from_millis(10));
                    continue;
                };
                while !reported.load(Ordering::Relaxed) {
                    match turn(&peer, &mut line, cut.load(Ordering::Relaxed)) {
                        Ok(SendResult::All) => {}
                        Ok(SendResult::Half) => {
                            cut.store(false, Ordering::Relaxed);
                            while !reported.load(Ordering::Relaxed) {
                                std::thread::sleep(Duration::from_millis(2));
                            }
                        }
                        Err(_) => break,
                    }
                }
            }
        };
        let thread = std::thread::Builder::new().name("unit".into()).spawn(run).unwrap();
        Self { ends, breaks_off, thread: Some(thread) }
    }

    /// Sends half of the unit's next bytes, and nothing more. Returns when this is done.
    pub(crate) fn fall_silent_mid_record(&self) {
        self.breaks_off.store(true, Ordering::Relaxed);
        let end = Monotonic.now_ns() + 5_000 * MS;
        while self.breaks_off.load(Ordering::Relaxed) {
            assert!(Monotonic.now_ns() < end, "it has nothing to say");
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

impl Drop for Spoken {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
            && !std::thread::panicking()
        {
            panic!("the unit failed");
        }
    }
}

/// Result of sending the unit's bytes.
enum SendResult {
    /// All bytes were sent, if there were any.
    All,
    /// Only the first half was sent.
    Half,
}

/// Waits for the host's or the unit's next bytes, whichever come first, and passes them on.
fn turn<T: Peer>(peer: &Mutex<T>, line: &mut TTYPort, breaks_off: bool) -> std::io::Result<SendResult> {
    let now = Monotonic.now_ns();
    // `None` if the unit is unplugged or has nothing to send.
    let text = peer.lock().unwrap().next(0, now, now).ok().flatten();
    if let Some((_, mut bytes)) = text {
        if breaks_off {
            bytes.truncate(bytes.len() / 2);
        }
        line.set_timeout(WRITE)?;
        line.write_all(&bytes)?;
        if breaks_off {
            return Ok(SendResult::Half);
        }
    }
    let until = peer.lock().unwrap().due(now).unwrap_or(i64::MAX).min(now + TURN);
    let left = u64::try_from(until - Monotonic.now_ns()).unwrap_or(0);
    line.set_timeout(Duration::from_nanos(left))?;
    let mut buffer = [0; 1024];
    match line.read(&mut buffer) {
        Ok(0) => Err(ErrorKind::BrokenPipe.into()),
        Ok(bytes) => {
            peer.lock().unwrap().written(&buffer[..bytes], 0, Monotonic.now_ns());
            Ok(SendResult::All)
        }
        Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted | ErrorKind::WouldBlock) => {
            Ok(SendResult::All)
        }
        Err(error) => Err(error),
    }
}
