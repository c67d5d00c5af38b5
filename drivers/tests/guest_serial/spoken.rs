//! A virtual unit that speaks on a serial line of the kernel's, in real time.

use std::io::{ErrorKind, Read, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use drivers::clock::{Clock, MS, Monotonic};
use drivers::transport::Peer;
use serialport::{SerialPort, TTYPort};

/// The longest that the unit's thread waits, ns.
const TURN: i64 = 10 * MS;
/// The longest time that bytes may wait for a host that does not read them.
const WRITE: Duration = Duration::from_secs(5);

/// Speaks until it is dropped; where its end of the line hangs up, when it is back.
pub(crate) struct Spoken {
    ends: Arc<AtomicBool>,
    breaks_off: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Spoken {
    /// On this file.
    pub(crate) fn on<T: Peer + 'static>(path: &str, baud: u32, peer: &Arc<Mutex<T>>) -> Self {
        let path = path.to_owned();
        Self::by(peer, move || serialport::new(&path, baud).open_native().ok())
    }

    /// On what can be opened, again and again.
    pub(crate) fn by<T: Peer + 'static>(
        peer: &Arc<Mutex<T>>,
        mut open: impl FnMut() -> Option<TTYPort> + Send + 'static,
    ) -> Self {
        let (ends, breaks_off) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
        let (told, cut, peer) = (Arc::clone(&ends), Arc::clone(&breaks_off), Arc::clone(peer));
        let run = move || {
            while !told.load(Ordering::Relaxed) {
                let Some(mut line) = open() else {
                    std::thread::sleep(Duration::from_millis(10));
                    continue;
                };
                while !told.load(Ordering::Relaxed) {
                    match turn(&peer, &mut line, cut.load(Ordering::Relaxed)) {
                        Ok(Said::All) => {}
                        Ok(Said::Half) => {
                            cut.store(false, Ordering::Relaxed);
                            while !told.load(Ordering::Relaxed) {
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

    /// Says half of what it says next, and no more. Returns when it has.
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

/// What was said of what the unit had to say.
enum Said {
    /// All, if there was anything.
    All,
    /// The first half.
    Half,
}

/// Waits for what the host sends or what the unit says next, whichever is first, and passes it on.
fn turn<T: Peer>(peer: &Mutex<T>, line: &mut TTYPort, breaks_off: bool) -> std::io::Result<Said> {
    let now = Monotonic.now_ns();
    // None where it is unplugged or has nothing to say.
    let said = peer.lock().unwrap().next(0, now, now).ok().flatten();
    if let Some((_, mut bytes)) = said {
        if breaks_off {
            bytes.truncate(bytes.len() / 2);
        }
        line.set_timeout(WRITE)?;
        line.write_all(&bytes)?;
        if breaks_off {
            return Ok(Said::Half);
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
            Ok(Said::All)
        }
        Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted | ErrorKind::WouldBlock) => {
            Ok(Said::All)
        }
        Err(error) => Err(error),
    }
}
