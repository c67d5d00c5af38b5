//! Loops and pairs of jobs that run alone or shared among the threads of a pool.
//!
//! The caller enters the pool once per slice (`ThreadPool::install`); whatever it shares then goes to threads that are awake.

#![allow(unsafe_code, reason = "the volume's memory is handed to threads piece by piece")]

use rayon::prelude::*;

/// The base of a chunk of an arena, seen by threads that take different pieces of it. Whoever dereferences it argues that no two threads take the same.
#[derive(Clone, Copy)]
pub(crate) struct Handed<T>(pub(crate) *mut T);
// SAFETY: handing over an address touches no memory; each dereference is an unsafe block of its own that argues that its piece is one thread's only.
unsafe impl<T: Send> Send for Handed<T> {}
// SAFETY: as above.
unsafe impl<T: Send> Sync for Handed<T> {}

/// Whether work is shared with the other threads of the pool that the caller runs in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sharing {
    Alone,
    Pool,
}

impl Sharing {
    /// Runs a job in a pool, or alone where there is none.
    pub(crate) fn within<T: Send>(pool: Option<&rayon::ThreadPool>, job: impl FnOnce(Self) -> T + Send) -> T {
        match pool {
            None => job(Self::Alone),
            Some(pool) => pool.install(|| job(Self::Pool)),
        }
    }

    /// Runs `task(index, chunk)` on each chunk of `size` elements (the last may be shorter).
    pub(crate) fn chunks<T: Send>(self, data: &mut [T], size: usize, task: impl Fn(usize, &mut [T]) + Sync) {
        self.chunks_with(data, size, || (), |(), index, chunk| task(index, chunk));
    }

    /// As [`Self::chunks`], with memory that is made now and then and used for many chunks; it should live on the stack.
    pub(crate) fn chunks_with<T: Send, M>(
        self,
        data: &mut [T],
        size: usize,
        memory: impl Fn() -> M + Sync + Send,
        task: impl Fn(&mut M, usize, &mut [T]) + Sync,
    ) {
        match self {
            Self::Alone => {
                let mut memory = memory();
                data.chunks_mut(size).enumerate().for_each(|(index, chunk)| task(&mut memory, index, chunk));
            }
            Self::Pool => {
                data.par_chunks_mut(size)
                    .enumerate()
                    .for_each_init(memory, |memory, (index, chunk)| task(memory, index, chunk));
            }
        }
    }

    /// As [`Self::chunks`], each with an element of `memory` of its own; there must be one for each chunk.
    pub(crate) fn chunks_beside<T: Send, M: Send>(
        self,
        data: &mut [T],
        size: usize,
        memory: &mut [M],
        task: impl Fn(&mut M, usize, &mut [T]) + Sync,
    ) {
        debug_assert_eq!(data.len().div_ceil(size), memory.len());
        match self {
            Self::Alone => {
                data.chunks_mut(size)
                    .zip(memory)
                    .enumerate()
                    .for_each(|(index, (chunk, memory))| task(memory, index, chunk));
            }
            Self::Pool => {
                data.par_chunks_mut(size)
                    .zip(memory)
                    .enumerate()
                    .for_each(|(index, (chunk, memory))| task(memory, index, chunk));
            }
        }
    }

    /// Runs both.
    pub(crate) fn both<A: Send, B: Send>(self, a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
        match self {
            Self::Alone => (a(), b()),
            Self::Pool => rayon::join(a, b),
        }
    }
}
