//! How bytes come and go: a serial line, USB, a network, and a line within the process.
//!
//! A transport knows nothing of records. It says when bytes were here, and that the other end is gone.

mod holder;
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

use crate::clock::SECOND;

/// What one read brought.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Received {
    /// Bytes, at the front of the buffer; 0 where the deadline passed before any came.
    pub bytes: usize,
    /// When the last of them was here, host ns.
    pub at_ns: i64,
}

/// Why bytes do not come or go.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LineError {
    /// There is no such device now.
    #[error("is not there: {0}; plug it in")]
    Absent(String),
    /// It is there and may not be opened.
    #[error("cannot be opened: {0}")]
    Refused(String),
    /// It was open and went away.
    #[error("was unplugged or switched off: {0}")]
    Gone(String),
    /// It is there and takes nothing of what is sent to it.
    #[error("does not take what is sent to it; switch it off and on")]
    Stuck,
    /// The system's reason for anything else.
    #[error("{0}")]
    Failed(String),
}

/// An open line to a device: bytes in both directions.
pub trait Transport: Send {
    /// Waits until the deadline (host ns) for bytes, and returns as soon as any are there.
    ///
    /// # Errors
    /// [`LineError::Gone`] when the other end is gone for good: open it anew. [`LineError::Failed`] otherwise; it may be read again.
    fn read(&mut self, into: &mut [u8], deadline_ns: i64) -> Result<Received, LineError>;

    /// What becomes readable when bytes are there or the other end goes, so that several lines can be waited for at once; `None` for a line that is no file.
    fn wakes_by(&self) -> Option<BorrowedFd<'_>> {
        None
    }

    /// Sends all of the bytes. Waits for a device that does not take them, half a second at most.
    ///
    /// # Errors
    /// As [`Self::read`], and [`LineError::Stuck`]; a part of them may have been sent.
    fn write(&mut self, bytes: &[u8]) -> Result<(), LineError>;

    /// Bytes from now on come and go at this rate, bits a second; what was received at the old one is dropped. Nothing where the line has no rate.
    ///
    /// # Errors
    /// [`LineError`] where the line refuses it.
    fn set_baud(&mut self, baud: u32) -> Result<(), LineError>;
}

/// Opens a line, again and again if it must.
pub trait Opener: Send {
    /// What is opened, for people: a path or a device's name.
    fn name(&self) -> &str;

    /// Opens it.
    ///
    /// # Errors
    /// [`LineError::Absent`] where there is none now, [`LineError::Refused`] where it is and cannot be opened, with what to do.
    fn open(&mut self) -> Result<Box<dyn Transport>, LineError>;
}

/// Waits for any of these lines, so many ns at most. Whether one is to be read: it has bytes or has ended, or there is none that can be waited for, or the system
/// cannot say.
pub(crate) fn wait<const LINES: usize>(lines: [Option<BorrowedFd<'_>>; LINES], at_most_ns: i64) -> bool {
    let Some(any) = lines.iter().flatten().next().copied() else { return true };
    // A line twice is waited for as well as once.
    let mut files = lines.map(|line| PollFd::from_borrowed_fd(line.unwrap_or(any), PollFlags::IN));
    let left = at_most_ns.max(0);
    let left = Timespec { tv_sec: left / SECOND, tv_nsec: left % SECOND };
    match rustix::event::poll(&mut files, Some(&left)) {
        Ok(0) | Err(rustix::io::Errno::INTR) => false,
        Ok(_) | Err(_) => true,
    }
}

/// What to do where a device's file may not be opened.
const DENIED: &str =
    "permission denied; install the udev rule that `sonoweave devices --udev` prints, and plug it in again";

/// Why a device's file may not be opened for reading and writing, if it may not.
fn denied(file: &std::path::Path) -> Option<String> {
    rustix::fs::access(file, Access::READ_OK | Access::WRITE_OK).is_err().then(|| DENIED.to_owned())
}
