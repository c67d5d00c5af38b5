//! Options for writing a session.

use sonoweave_core::clock::{MS, SECOND};

/// Options for writing a session.
#[derive(Debug, Clone, PartialEq)]
pub struct WriterOptions {
    /// Program that writes the session, with its version.
    pub program: String,
    /// Maximum age of a chunk's first message, ns. The chunk is then closed and written, and a
    /// sync requested. It bounds the data that a power cut takes.
    pub chunk_ns: i64,
    /// Maximum size of a chunk, bytes; the chunk is then closed.
    pub chunk_bytes: usize,
    /// Memory used while the disk accepts nothing, bytes. Beyond it frames are dropped; beyond
    /// a quarter more, everything.
    pub held_bytes: usize,
    /// Pause before a failed write is tried again, ns.
    pub retry_ns: i64,
}

impl WriterOptions {
    /// Returns the defaults: chunks of 0.4 s or 4 MB; 64 MB of memory, which is some
    /// seconds of video.
    pub fn new(program: &str) -> Self {
        Self {
            program: program.to_owned(),
            chunk_ns: 400 * MS,
            chunk_bytes: 4 << 20,
            held_bytes: 64 << 20,
            retry_ns: SECOND,
        }
    }
}
