//! Byte transports: serial line, USB, network, and a line within the process.
//!
//! A transport knows nothing of records. It reports when bytes arrived, and when the other end
//! is gone.

mod holder;
pub mod input_line;
mod memory;
pub mod serial;
pub mod tcp;
pub mod usb;

pub(crate) use holder::holder;
pub use memory::{MemoryOpener, Peer};
pub use serial::{PortPath, SerialOpener};
pub use tcp::TcpOpener;
pub use usb::{UsbId, UsbOpener};

use std::os::fd::BorrowedFd;

use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::fs::Access;

use sonoweave_core::clock::SECOND;

/// Result of one read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Received {
    /// Number of bytes at the front of the buffer; 0 if the deadline passed before any arrived.
    pub bytes: usize,
    /// Arrival time of the last byte, host ns.
    pub at_ns: i64,
}

/// Reason why bytes cannot be received or sent.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LineError {
    /// The device is not present.
    #[error("is not there: {0}; plug it in")]
    Absent(String),
    /// The user may not open the device.
    #[error("cannot be opened: {DENIED}")]
    Denied,
    /// The device is present but cannot be opened.
    #[error("cannot be opened: {0}")]
    Refused(String),
    /// The device was open and disconnected.
    #[error("was unplugged or switched off: {0}")]
    Gone(String),
    /// The device is present but accepts no bytes.
    #[error("does not accept data; switch it off and on")]
    Stuck,
    /// Any other error, with the system's reason.
    #[error("{0}")]
    Failed(String),
}

/// An open line to a device: bytes in both directions.
pub trait Transport: Send {
    /// Waits until the deadline (host ns) for bytes, and returns as soon as any are there.
    ///
    /// # Errors
    /// [`LineError::Gone`] when the other end is gone for good: open the line again.
    /// [`LineError::Failed`] otherwise; the line may be read again.
    fn read(&mut self, into: &mut [u8], deadline_ns: i64) -> Result<Received, LineError>;

    /// Returns a descriptor that becomes readable when bytes arrive or the other end
    /// disconnects, for waiting on several lines. `None` for a line without a descriptor.
    fn wakes_by(&self) -> Option<BorrowedFd<'_>> {
        None
    }

    /// Sends all bytes. Waits at most half a second for a device that does not accept them.
    ///
    /// # Errors
    /// The errors of [`Self::read`], and [`LineError::Stuck`]; a part of the bytes may have
    /// been sent.
    fn write(&mut self, bytes: &[u8]) -> Result<(), LineError>;

    /// Sets the rate in both directions, bits per second. Drops bytes received at the old rate.
    /// Does nothing if the line has no rate.
    ///
    /// # Errors
    /// [`LineError`] if the line refuses the rate.
    fn set_baud(&mut self, baud: u32) -> Result<(), LineError>;
}

/// Opens a line, repeatedly if necessary.
pub trait Opener: Send {
    /// Returns the name shown to the user: a path or a device's name.
    fn name(&self) -> &str;

    /// Opens the line.
    ///
    /// # Errors
    /// [`LineError::Absent`] if the device is not present. [`LineError::Denied`] and
    /// [`LineError::Refused`] if it is present but cannot be opened.
    fn open(&mut self) -> Result<Box<dyn Transport>, LineError>;
}

/// Waits for any of these lines, at most `at_most_ns`. Returns true if a line must be read: it
/// has bytes or has ended. Also returns true if no line has a descriptor, or the system reports
/// an error.
pub(crate) fn wait<const LINES: usize>(lines: [Option<BorrowedFd<'_>>; LINES], at_most_ns: i64) -> bool {
    let Some(any) = lines.iter().flatten().next().copied() else { return true };
    // Missing lines are replaced by a duplicate, which does not change the wait.
    let mut files = lines.map(|line| PollFd::from_borrowed_fd(line.unwrap_or(any), PollFlags::IN));
    let left = at_most_ns.max(0);
    let left = Timespec { tv_sec: left / SECOND, tv_nsec: left % SECOND };
    match rustix::event::poll(&mut files, Some(&left)) {
        Ok(0) | Err(rustix::io::Errno::INTR) => false,
        Ok(_) | Err(_) => true,
    }
}

/// Reason and remedy if a device file may not be opened.
pub const DENIED: &str = "permission denied; install the udev rules of sonoweave, and plug it in again";

/// Returns whether a device file may not be opened for reading and writing.
fn denied(file: &std::path::Path) -> bool {
    rustix::fs::access(file, Access::READ_OK | Access::WRITE_OK).is_err()
}
