//! What was said to be written and is not on the disk yet.
//!
//! MCAP's writer is told that everything went well, always: it writes to memory. What it has finished (a chunk with its index) goes to the disk at once and as a whole. When
//! that fails, the file is cut back to its last whole chunk, the chunk stays in memory, and the same is tried again later: so offsets within the file stay true, the file
//! is valid at any time, and there is one file. (A second file would also have done; but then half a session can be lost or mixed up by whoever copies it.)

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::os::unix::fs::FileExt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Where a session's bytes go.
pub trait Store: Send {
    /// Writes all of it at that place, which is the end, or beyond what was written and failed.
    ///
    /// # Errors
    /// The system's; any part may have been written.
    fn write_at(&mut self, bytes: &[u8], at: u64) -> io::Result<()>;

    /// Leaves so many bytes.
    ///
    /// # Errors
    /// The system's.
    fn cut(&mut self, length: u64) -> io::Result<()>;

    /// Returns when all is on the disk.
    ///
    /// # Errors
    /// The system's.
    fn settle(&mut self) -> io::Result<()>;

    /// Bytes that may still be written; `None` where that is not known.
    fn free_bytes(&self) -> Option<u64>;
}

impl Store for File {
    fn write_at(&mut self, bytes: &[u8], at: u64) -> io::Result<()> {
        self.write_all_at(bytes, at)
    }

    fn cut(&mut self, length: u64) -> io::Result<()> {
        self.set_len(length)
    }

    fn settle(&mut self) -> io::Result<()> {
        self.sync_all()
    }

    fn free_bytes(&self) -> Option<u64> {
        let disk = rustix::fs::fstatvfs(self).ok()?;
        disk.f_bavail.checked_mul(disk.f_frsize)
    }
}

/// A store, and what it has not taken yet.
pub(super) struct Held {
    store: Box<dyn Store>,
    /// Bytes in the store.
    stored: u64,
    /// What follows.
    bytes: Vec<u8>,
    /// Lengths of the pieces at its front that are whole.
    whole: VecDeque<usize>,
    whole_bytes: usize,
    /// Where the next byte goes.
    position: usize,
}

impl Held {
    pub(super) fn new(store: Box<dyn Store>, room: usize) -> Self {
        let (bytes, whole) = (Vec::with_capacity(room), VecDeque::new());
        Self { store, stored: 0, bytes, whole, whole_bytes: 0, position: 0 }
    }

    /// Bytes that are not in the store.
    pub(super) fn len(&self) -> usize {
        self.bytes.len()
    }

    /// Bytes of what was begun and is not whole.
    pub(super) fn begun(&self) -> usize {
        self.bytes.len() - self.whole_bytes
    }

    /// Pieces that are whole and not in the store.
    pub(super) fn whole(&self) -> usize {
        self.whole.len()
    }

    /// Bytes in the store.
    pub(super) fn stored(&self) -> u64 {
        self.stored
    }

    pub(super) fn free_bytes(&self) -> Option<u64> {
        self.store.free_bytes()
    }

    pub(super) fn settle(&mut self) -> io::Result<()> {
        self.store.settle()
    }

    /// Gives the store what is whole. After an error the store ends where the last whole piece does.
    pub(super) fn commit(&mut self) -> io::Result<()> {
        let (mut done, mut outcome) = (0, Ok(()));
        while let Some(length) = self.whole.front() {
            let piece = &self.bytes[done..done + length];
            if let Err(error) = self.store.write_at(piece, self.stored) {
                // Where that fails too, what is beyond is written over later; until then a reader finds a chunk that is cut.
                if let Err(uncut) = self.store.cut(self.stored) {
                    tracing::debug!("a session's file is not cut back to its last whole chunk: {uncut}");
                }
                outcome = Err(error);
                break;
            }
            self.stored += *length as u64;
            done += length;
            self.whole.pop_front();
        }
        self.whole_bytes -= done;
        self.position -= done;
        self.bytes.drain(..done);
        outcome
    }
}

/// The end that is written to.
#[derive(Clone)]
pub(super) struct Tail(Arc<Mutex<Held>>);

impl Tail {
    pub(super) fn of(held: Held) -> Self {
        Self(Arc::new(Mutex::new(held)))
    }

    pub(super) fn held(&self) -> MutexGuard<'_, Held> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Write for Tail {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let held = &mut *self.held();
        let over = bytes.len().min(held.bytes.len() - held.position);
        held.bytes[held.position..held.position + over].copy_from_slice(&bytes[..over]);
        held.bytes.extend_from_slice(&bytes[over..]);
        held.position += bytes.len();
        Ok(bytes.len())
    }

    /// What was written until now is whole.
    fn flush(&mut self) -> io::Result<()> {
        let held = &mut *self.held();
        let length = held.begun();
        if length > 0 {
            held.whole.push_back(length);
            held.whole_bytes += length;
        }
        Ok(())
    }
}

impl Seek for Tail {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let held = &mut *self.held();
        let place = match to {
            SeekFrom::Start(place) => place.checked_sub(held.stored).and_then(|place| usize::try_from(place).ok()),
            SeekFrom::End(ahead) => held.bytes.len().checked_add_signed(ahead as isize),
            SeekFrom::Current(ahead) => held.position.checked_add_signed(ahead as isize),
        };
        // What is whole is not changed any more.
        held.position =
            place.filter(|place| (held.whole_bytes..=held.bytes.len()).contains(place)).ok_or_else(|| {
                io::Error::new(io::ErrorKind::InvalidInput, "a place in a session that was written already")
            })?;
        Ok(held.stored + held.position as u64)
    }
}
