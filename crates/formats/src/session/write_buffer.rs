//! Bytes handed to the file writer that are not on the disk yet.
//!
//! MCAP's writer always writes to memory and never sees an error. Each finished piece (a chunk
//! with its index) goes to the disk at once and as a whole. If that fails, the file is
//! truncated to its last whole chunk; the chunk stays in memory, and writing is retried later.
//! Offsets within the file therefore stay correct, the file is always valid, and there is only
//! one file. (A second file would also work, but half a session could then be lost or mixed up
//! on copying.)

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::os::unix::fs::FileExt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::session::syncing::DataSync;

/// Storage of a session's bytes.
pub trait Store: Send {
    /// Writes all of `bytes` at this position, which is the end, or the position of a failed
    /// write.
    ///
    /// # Errors
    /// The system's error; any part may have been written.
    fn write_at(&mut self, bytes: &[u8], at: u64) -> io::Result<()>;

    /// Truncates to this length, bytes.
    ///
    /// # Errors
    /// The system's error.
    fn cut(&mut self, length: u64) -> io::Result<()>;

    /// Returns a second handle, which syncs the data while this one writes.
    ///
    /// # Errors
    /// The system's error.
    fn data_sync(&self) -> io::Result<Box<dyn DataSync>>;

    /// Returns the number of bytes that may still be written; `None` if unknown.
    fn free_bytes(&self) -> Option<u64>;
}

impl Store for File {
    fn write_at(&mut self, bytes: &[u8], at: u64) -> io::Result<()> {
        self.write_all_at(bytes, at)
    }

    fn cut(&mut self, length: u64) -> io::Result<()> {
        self.set_len(length)
    }

    fn data_sync(&self) -> io::Result<Box<dyn DataSync>> {
        Ok(Box::new(self.try_clone()?))
    }

    fn free_bytes(&self) -> Option<u64> {
        let disk = rustix::fs::fstatvfs(self).ok()?;
        disk.f_bavail.checked_mul(disk.f_frsize)
    }
}

/// A store, with the data that it has not accepted yet.
pub(super) struct WriteBuffer {
    store: Box<dyn Store>,
    /// Number of bytes in the store.
    stored: u64,
    /// Bytes that follow those in the store.
    bytes: Vec<u8>,
    /// Lengths of the complete pieces at the front of `bytes`.
    whole: VecDeque<usize>,
    whole_bytes: usize,
    /// Position of the next byte.
    position: usize,
}

impl WriteBuffer {
    pub(super) fn new(store: Box<dyn Store>, room: usize) -> Self {
        let (bytes, whole) = (Vec::with_capacity(room), VecDeque::new());
        Self { store, stored: 0, bytes, whole, whole_bytes: 0, position: 0 }
    }

    /// Returns the number of bytes not in the store.
    pub(super) fn len(&self) -> usize {
        self.bytes.len()
    }

    /// Returns the number of bytes of the incomplete piece.
    pub(super) fn unfinished(&self) -> usize {
        self.bytes.len() - self.whole_bytes
    }

    /// Returns the number of complete pieces not in the store.
    pub(super) fn whole(&self) -> usize {
        self.whole.len()
    }

    /// Returns the number of bytes in the store.
    pub(super) fn stored(&self) -> u64 {
        self.stored
    }

    pub(super) fn free_bytes(&self) -> Option<u64> {
        self.store.free_bytes()
    }

    /// Writes the complete pieces to the store. After an error the store ends with its last
    /// whole piece.
    pub(super) fn commit(&mut self) -> io::Result<()> {
        let (mut done, mut outcome) = (0, Ok(()));
        while let Some(length) = self.whole.front() {
            let piece = &self.bytes[done..done + length];
            if let Err(error) = self.store.write_at(piece, self.stored) {
                // If truncation fails too, a later write overwrites the excess; until then a
                // reader finds a truncated chunk.
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

/// Write handle to the end of the file.
#[derive(Clone)]
pub(super) struct Tail(Arc<Mutex<WriteBuffer>>);

impl Tail {
    pub(super) fn of(buffer: WriteBuffer) -> Self {
        Self(Arc::new(Mutex::new(buffer)))
    }

    pub(super) fn buffer(&self) -> MutexGuard<'_, WriteBuffer> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Write for Tail {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let buffer = &mut *self.buffer();
        let over = bytes.len().min(buffer.bytes.len() - buffer.position);
        buffer.bytes[buffer.position..buffer.position + over].copy_from_slice(&bytes[..over]);
        buffer.bytes.extend_from_slice(&bytes[over..]);
        buffer.position += bytes.len();
        Ok(bytes.len())
    }

    /// Marks everything written so far as a complete piece.
    fn flush(&mut self) -> io::Result<()> {
        let buffer = &mut *self.buffer();
        let length = buffer.unfinished();
        if length > 0 {
            buffer.whole.push_back(length);
            buffer.whole_bytes += length;
        }
        Ok(())
    }
}

impl Seek for Tail {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let buffer = &mut *self.buffer();
        let place = match to {
            SeekFrom::Start(place) => place.checked_sub(buffer.stored).and_then(|place| usize::try_from(place).ok()),
            SeekFrom::End(ahead) => buffer.bytes.len().checked_add_signed(ahead as isize),
            SeekFrom::Current(ahead) => buffer.position.checked_add_signed(ahead as isize),
        };
        // Complete pieces are not changed any more.
        buffer.position =
            place.filter(|place| (buffer.whole_bytes..=buffer.bytes.len()).contains(place)).ok_or_else(|| {
                io::Error::new(io::ErrorKind::InvalidInput, "a place in a session that was written already")
            })?;
        Ok(buffer.stored + buffer.position as u64)
    }
}
