//! A connection to a server over TCP.

use std::io::{ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::os::fd::{AsFd, BorrowedFd};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec};

use sonoweave_core::clock::{Clock, MS, SECOND};

use super::{LineError, Opener, Received, Transport};

/// Time limit of one connection attempt.
const CONNECT: Duration = Duration::from_secs(5);
/// Pause after the first failed attempt, ns; it doubles with each further one.
const PAUSE: i64 = 200 * MS;
/// Limit of the doubled pause, ns.
const LONGEST_PAUSE: i64 = 5 * SECOND;
/// The longest time that written bytes may wait for the other end, ns.
const WRITE: i64 = 500 * MS;

/// Connects to a server, repeatedly if necessary. Name resolution and the connection attempt
/// run on a separate thread, so that `open` never blocks.
#[derive(Debug)]
pub struct TcpOpener {
    address: String,
    clock: Arc<dyn Clock>,
    attempt: Option<Receiver<Result<TcpStream, LineError>>>,
    failed: u32,
    not_before_ns: i64,
    /// Reason of the last failure.
    why: LineError,
}

impl TcpOpener {
    /// Creates an opener for the server `HOST:PORT`; times come from `clock`.
    pub fn new(address: &str, clock: Arc<dyn Clock>) -> Self {
        let why = LineError::Refused("the connection is being established".into());
        Self { address: address.into(), clock, attempt: None, failed: 0, not_before_ns: i64::MIN, why }
    }

    fn begin(&self) -> Receiver<Result<TcpStream, LineError>> {
        let (sender, outcome) = channel();
        let address = self.address.clone();
        let connecting = std::thread::Builder::new().name("connect".into()).spawn(move || {
            // The opener may have been dropped.
            let _ = sender.send(connect(&address));
        });
        if let Err(error) = connecting {
            let (sender, outcome) = channel();
            let _ = sender.send(Err(LineError::Failed(format!("cannot start a thread to connect: {error}"))));
            return outcome;
        }
        outcome
    }
}

fn connect(address: &str) -> Result<TcpStream, LineError> {
    let refused = |error: std::io::Error, advice| LineError::Refused(format!("{error}; {advice}"));
    let addresses = address.to_socket_addrs().map_err(|error| refused(error, "check the name"))?;
    let mut why = LineError::Refused("the name has no address; check it".into());
    for address in addresses {
        match TcpStream::connect_timeout(&address, CONNECT) {
            Ok(stream) => {
                stream.set_nonblocking(true).map_err(|error| LineError::Failed(error.to_string()))?;
                // Requests are short and must not be delayed; if this is refused, they are
                // delayed.
                let _ = stream.set_nodelay(true);
                return Ok(stream);
            }
            Err(error) => why = refused(error, "check that the server runs there"),
        }
    }
    Err(why)
}

impl Opener for TcpOpener {
    fn name(&self) -> &str {
        &self.address
    }

    fn open(&mut self) -> Result<Box<dyn Transport>, LineError> {
        let now_ns = self.clock.now_ns();
        if self.attempt.is_none() {
            if now_ns < self.not_before_ns {
                return Err(self.why.clone());
            }
            self.attempt = Some(self.begin());
        }
        let outcome = match self.attempt.as_ref().map(Receiver::try_recv) {
            Some(Err(TryRecvError::Empty)) | None => return Err(self.why.clone()),
            Some(Err(TryRecvError::Disconnected)) => {
                Err(LineError::Failed("the thread that connects has ended".into()))
            }
            Some(Ok(outcome)) => outcome,
        };
        self.attempt = None;
        match outcome {
            Ok(stream) => {
                self.failed = 0;
                // Limits the rate of attempts to a server that accepts connections and closes
                // them at once.
                self.not_before_ns = now_ns + PAUSE;
                Ok(Box::new(Connected { stream, clock: Arc::clone(&self.clock) }))
            }
            Err(why) => {
                let pause = PAUSE.saturating_mul(1 << self.failed.min(10)).min(LONGEST_PAUSE);
                self.failed += 1;
                self.not_before_ns = now_ns + pause;
                self.why.clone_from(&why);
                Err(why)
            }
        }
    }
}

struct Connected {
    stream: TcpStream,
    clock: Arc<dyn Clock>,
}

fn gone(error: &std::io::Error) -> LineError {
    LineError::Gone(format!("the connection broke: {error}"))
}

impl Transport for Connected {
    fn read(&mut self, into: &mut [u8], deadline_ns: i64) -> Result<Received, LineError> {
        super::wait([Some(self.stream.as_fd())], deadline_ns.saturating_sub(self.clock.now_ns()));
        let bytes = match self.stream.read(into) {
            Ok(0) => return Err(LineError::Gone("the other end closed the connection".into())),
            Ok(bytes) => bytes,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => 0,
            Err(error) => return Err(gone(&error)),
        };
        Ok(Received { bytes, at_ns: self.clock.now_ns() })
    }

    fn wakes_by(&self) -> Option<BorrowedFd<'_>> {
        Some(self.stream.as_fd())
    }

    fn write(&mut self, mut bytes: &[u8]) -> Result<(), LineError> {
        let until_ns = self.clock.now_ns() + WRITE;
        while !bytes.is_empty() {
            match self.stream.write(bytes) {
                Ok(written) => bytes = &bytes[written..],
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    let left = until_ns - self.clock.now_ns();
                    if left <= 0 {
                        return Err(LineError::Stuck);
                    }
                    let left = Timespec { tv_sec: left / SECOND, tv_nsec: left % SECOND };
                    let mut file = [PollFd::new(&self.stream, PollFlags::OUT)];
                    // Retries after an interruption, too.
                    let _ = rustix::event::poll(&mut file, Some(&left));
                }
                Err(error) => return Err(gone(&error)),
            }
        }
        Ok(())
    }

    fn set_baud(&mut self, _baud: u32) -> Result<(), LineError> {
        Ok(())
    }
}
