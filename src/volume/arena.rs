//! Storage that grows by chunks and never moves: one element for each brick.

use std::io;
use std::marker::PhantomData;
use std::thread::JoinHandle;

use bytemuck::Pod;
use memmap2::{Advice, MmapMut};

/// Elements whose addresses are reserved together; of bricks, 16 MiB. Memory is taken only as they are filled.
pub(crate) const CHUNK: usize = 4096;

/// Memory for a chunk of elements, all zero.
///
/// A sweep fills hundreds of new bricks a slice, and a page fault for each costs more than weaving them (measured at 256³: 1.5 ms a slice);
/// so the pages are huge where the system has such, and there before they are needed. A system that knows neither advice gives single
/// pages when they are first written.
fn allocate(bytes: usize) -> io::Result<MmapMut> {
    let chunk = MmapMut::map_anon(bytes)?;
    for advice in [Advice::HugePage, Advice::PopulateWrite] {
        if let Err(error) = chunk.advise(advice) {
            tracing::debug!(%error, ?advice, "memory for the volume is not prepared");
        }
    }
    Ok(chunk)
}

/// Elements of a plain type, zero until written.
pub(crate) struct Arena<T> {
    chunks: Vec<MmapMut>,
    /// The next chunk, being prepared beside the work.
    next: Option<JoinHandle<io::Result<MmapMut>>>,
    element: PhantomData<T>,
}

impl<T> Default for Arena<T> {
    fn default() -> Self {
        Self { chunks: Vec::new(), next: None, element: PhantomData }
    }
}

impl<T: Pod> Arena<T> {
    /// Elements that there is room for.
    pub(crate) fn room(&self) -> usize {
        self.chunks.len() * CHUNK
    }

    /// Makes room for `count` elements in all.
    ///
    /// # Errors
    /// When the system has no memory to give.
    pub(crate) fn reserve(&mut self, count: usize) -> io::Result<()> {
        let bytes = CHUNK * size_of::<T>();
        while count > self.room() {
            let prepared = self.next.take().and_then(|thread| thread.join().ok());
            self.chunks.push(prepared.unwrap_or_else(|| allocate(bytes))?);
        }
        if self.next.is_none() && count + CHUNK / 2 > self.room() {
            // Without a thread the chunk is made when it is needed.
            let thread = std::thread::Builder::new().name("volume-memory".into());
            self.next = thread.spawn(move || allocate(bytes)).ok();
        }
        Ok(())
    }

    /// An element there is room for.
    pub(crate) fn get(&self, index: usize) -> &T {
        let chunk: &[T] = bytemuck::cast_slice(&self.chunks[index / CHUNK]);
        &chunk[index % CHUNK]
    }

    /// An element there is room for.
    #[cfg(test)]
    pub(crate) fn get_mut(&mut self, index: usize) -> &mut T {
        let chunk: &mut [T] = bytemuck::cast_slice_mut(&mut self.chunks[index / CHUNK]);
        &mut chunk[index % CHUNK]
    }

    /// Base address of each chunk of [`CHUNK`] elements.
    pub(crate) fn pointers(&mut self) -> impl Iterator<Item = *mut T> {
        self.chunks.iter_mut().map(|chunk| bytemuck::cast_slice_mut(chunk).as_mut_ptr())
    }
}
