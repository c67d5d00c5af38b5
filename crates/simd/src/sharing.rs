//! Loops and pairs of jobs that run on one thread or on the threads of a pool.
//!
//! The caller enters the pool once per slice (`ThreadPool::install`); shared work then goes to
//! threads that are awake.

#![allow(unsafe_code, reason = "the volume's memory is handed to threads piece by piece")]

use rayon::prelude::*;

/// The base address of a chunk of an arena, shared by threads that use different pieces of it.
/// Each dereference must argue that no two threads use the same piece.
#[derive(Clone, Copy)]
pub struct Handed<T>(pub *mut T);
// SAFETY: copying an address to another thread touches no memory. Each dereference is an unsafe
// block of its own, which argues that only one thread uses its piece.
unsafe impl<T: Send> Send for Handed<T> {}
// SAFETY: as above.
unsafe impl<T: Send> Sync for Handed<T> {}

/// Whether work is shared with the other threads of the caller's pool.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sharing {
    /// The calling thread does all of it.
    Alone,
    /// The threads of the caller's pool share it.
    Pool,
}

impl Sharing {
    /// Runs a job in a pool, or on the calling thread if there is none.
    pub fn within<T: Send>(pool: Option<&rayon::ThreadPool>, job: impl FnOnce(Self) -> T + Send) -> T {
        match pool {
            None => job(Self::Alone),
            Some(pool) => pool.install(|| job(Self::Pool)),
        }
    }

    /// Runs `task(index, chunk)` on each chunk of `size` elements (the last may be shorter).
    pub fn chunks<T: Send>(self, data: &mut [T], size: usize, task: impl Fn(usize, &mut [T]) + Sync) {
        self.chunks_with(data, size, || (), |(), index, chunk| task(index, chunk));
    }

    /// Like [`Self::chunks`], with scratch memory that is reused for many chunks; it should
    /// live on the stack.
    pub fn chunks_with<T: Send, M>(
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

    /// Like [`Self::chunks`], with one element of `memory` for each chunk; their numbers must
    /// be equal.
    pub fn chunks_beside<T: Send, M: Send>(
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

    /// Runs both jobs and returns both results.
    pub fn both<A: Send, B: Send>(self, a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
        match self {
            Self::Alone => (a(), b()),
            Self::Pool => rayon::join(a, b),
        }
    }
}
