//! Memory in equal pieces, in chunks that never move: growing copies nothing.

use std::io;
use std::thread::JoinHandle;

use memmap2::{Advice, MmapMut};

/// Approximate size of a chunk: about 1 ms of a thread that prepares it.
const CHUNK_BYTES: usize = 2 << 20;
/// Chunks prepared in advance: as many as are left when another thread begins, and as many as it
/// prepares.
const AHEAD: usize = 2;

/// Zero-initialised pieces, numbered in the order in which they are taken.
pub(crate) struct Arena {
    piece_bytes: usize,
    /// Pieces in a chunk.
    per_chunk: usize,
    chunks: Vec<MmapMut>,
    /// The next chunks, prepared on another thread.
    next: Option<JoinHandle<io::Result<Vec<MmapMut>>>>,
}

/// Allocates memory for a chunk; fresh pages are zero.
///
/// A sweep fills hundreds of new bricks per slice, and a page fault for each costs more than
/// the insertion (measured at 256³: 1.5 ms a slice). Therefore the pages are populated before they
/// are needed. A system that does not support the advice provides each when it is first written.
///
/// Huge pages are not asked for, which leaves them to the system's setting. Asking makes the system
/// free a huge page at once. On a virtual machine, insertion then takes 3 % less time; but the
/// slowest slices of a first pass at 256³ take 20 to 100 ms, where they take 13 to 20.
fn allocate(bytes: usize) -> io::Result<MmapMut> {
    let chunk = MmapMut::map_anon(bytes)?;
    if let Err(error) = chunk.advise(Advice::PopulateWrite) {
        tracing::debug!(%error, "memory for the volume is not prepared");
    }
    Ok(chunk)
}

impl Arena {
    /// Returns an arena of pieces of this many bytes; it is empty.
    pub(crate) fn new(piece_bytes: usize) -> Self {
        Self::in_chunks(piece_bytes, (CHUNK_BYTES / piece_bytes.max(1)).max(1))
    }

    /// The same with `per_chunk` pieces in a chunk.
    pub(crate) fn in_chunks(piece_bytes: usize, per_chunk: usize) -> Self {
        Self { piece_bytes, per_chunk, chunks: Vec::new(), next: None }
    }

    /// Pieces that there is room for.
    pub(crate) fn capacity(&self) -> usize {
        self.chunks.len() * self.per_chunk
    }

    /// Bytes of chunks beyond the first `pieces`, with those that are being prepared.
    pub(crate) fn growth_bytes(&self, pieces: usize) -> u64 {
        let next = if self.next.is_some() { AHEAD * self.per_chunk } else { 0 };
        ((self.capacity() - pieces.min(self.capacity()) + next) * self.piece_bytes) as u64
    }

    /// Ensures that there is room for `pieces`.
    ///
    /// # Errors
    /// When the system has no memory to give; nothing has changed then except prepared memory.
    pub(crate) fn reserve(&mut self, pieces: usize) -> io::Result<()> {
        let bytes = self.per_chunk * self.piece_bytes;
        while pieces > self.capacity() {
            match self.next.take().and_then(|thread| thread.join().ok()) {
                Some(prepared) => self.chunks.extend(prepared?),
                None => self.chunks.push(allocate(bytes)?),
            }
        }
        if self.next.is_none() && pieces + AHEAD * self.per_chunk > self.capacity() {
            // If no thread can be started, each chunk is allocated when it is needed.
            let prepare = move || (0..AHEAD).map(|_| allocate(bytes)).collect();
            self.next = std::thread::Builder::new().name("volume-memory".into()).spawn(prepare).ok();
        }
        Ok(())
    }

    /// Returns a piece.
    #[inline]
    pub(crate) fn piece(&self, index: usize) -> &[u8] {
        let (chunk, place) = self.locate(index);
        &self.chunks[chunk][place * self.piece_bytes..][..self.piece_bytes]
    }

    /// Returns a piece for writing.
    #[inline]
    pub(crate) fn piece_mut(&mut self, index: usize) -> &mut [u8] {
        let (chunk, place) = self.locate(index);
        &mut self.chunks[chunk][place * self.piece_bytes..][..self.piece_bytes]
    }

    /// Returns an arena with the first `pieces` copied, which must exist.
    ///
    /// # Errors
    /// When the system has no memory to give.
    pub(crate) fn copy(&self, pieces: usize) -> io::Result<Self> {
        let mut copy = Self::in_chunks(self.piece_bytes, self.per_chunk);
        while pieces > copy.capacity() {
            let left = (pieces - copy.capacity()).min(self.per_chunk) * self.piece_bytes;
            let mut chunk = allocate(self.per_chunk * self.piece_bytes)?;
            chunk[..left].copy_from_slice(&self.chunks[copy.chunks.len()][..left]);
            copy.chunks.push(chunk);
        }
        Ok(copy)
    }

    /// Returns each whole chunk, for inserters that hand every piece to exactly one thread.
    pub(crate) fn chunks_mut(&mut self) -> impl Iterator<Item = &mut [u8]> {
        self.chunks.iter_mut().map(|chunk| &mut chunk[..])
    }

    /// Returns the chunk of a piece and its position in the chunk.
    #[inline]
    pub(crate) fn locate(&self, index: usize) -> (usize, usize) {
        (index / self.per_chunk, index % self.per_chunk)
    }
}
