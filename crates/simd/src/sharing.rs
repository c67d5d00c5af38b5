//! Loops and pairs of jobs that run on one thread or on those of a team.

#![allow(unsafe_code, reason = "the volume's memory is handed to threads piece by piece")]

use std::sync::{Mutex, MutexGuard, PoisonError};

use super::team::Team;

/// The base address of a chunk of an arena, shared by threads that use different pieces of it.
/// Each dereference must argue that no two threads use the same piece.
#[derive(Clone, Copy)]
pub struct Handed<T>(pub *mut T);
// SAFETY: copying an address to another thread touches no memory. Each dereference is an unsafe
// block of its own, which argues that only one thread uses its piece.
unsafe impl<T: Send> Send for Handed<T> {}
// SAFETY: as above.
unsafe impl<T: Send> Sync for Handed<T> {}

/// Whether work is shared with other threads.
#[derive(Debug, Clone, Copy)]
pub enum Sharing<'t> {
    /// The calling thread does all of it.
    Alone,
    /// The threads of a team share it.
    Team {
        /// The team.
        team: &'t Team,
        /// Whether members that sleep are woken. It costs some 25 µs.
        wakes: bool,
    },
}

impl<'t> Sharing<'t> {
    /// Returns the sharing with a team, whose members wake now. Without a team the calling thread
    /// is alone.
    pub fn of(team: Option<&'t Team>) -> Self {
        team.map_or(Self::Alone, |team| {
            team.wake();
            Self::Team { team, wakes: true }
        })
    }

    /// Like [`Self::of`], for work so short that only members which are awake shall help.
    pub fn with_awake(team: Option<&'t Team>) -> Self {
        team.map_or(Self::Alone, |team| Self::Team { team, wakes: false })
    }

    /// Runs `task(index, chunk)` on each chunk of `size` elements (the last may be shorter).
    pub fn chunks<T: Send>(self, data: &mut [T], size: usize, task: impl Fn(usize, &mut [T]) + Sync) {
        self.chunks_with(data, size, || (), |(), index, chunk| task(index, chunk));
    }

    /// Like [`Self::chunks`], with scratch memory that a thread uses for all its chunks; it should
    /// live on the stack.
    pub fn chunks_with<T: Send, M>(
        self,
        data: &mut [T],
        size: usize,
        memory: impl Fn() -> M + Sync,
        task: impl Fn(&mut M, usize, &mut [T]) + Sync,
    ) {
        let mut none = vec![(); data.len().div_ceil(size)];
        self.pieces(data, size, &mut none, memory, |memory, (), index, chunk| task(memory, index, chunk));
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
        self.pieces(data, size, memory, || (), |(), beside, index, chunk| task(beside, index, chunk));
    }

    fn pieces<T: Send, B: Send, M>(
        self,
        data: &mut [T],
        size: usize,
        beside: &mut [B],
        memory: impl Fn() -> M + Sync,
        task: impl Fn(&mut M, &mut B, usize, &mut [T]) + Sync,
    ) {
        debug_assert_eq!(data.len().div_ceil(size), beside.len());
        let run = |memory: &mut M, Piece { first, data, beside }: Piece<'_, T, B>| {
            let pieces = data.chunks_mut(size).zip(beside);
            pieces.enumerate().for_each(|(at, (chunk, beside))| task(memory, beside, first + at, chunk));
        };
        let all = Piece { first: 0, data, beside };
        match self {
            Self::Team { team, wakes } if all.beside.len() > 1 => {
                let (rest, threads) = (Mutex::new(all), team.threads());
                team.share(wakes, &|| {
                    let mut memory = memory();
                    while let Some(piece) = take(lock(&rest), size, threads) {
                        run(&mut memory, piece);
                    }
                });
            }
            _ => run(&mut memory(), all),
        }
    }

    /// Runs both jobs and returns both results.
    pub fn both<A: Send, B: Send>(self, a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
        let Self::Team { team, wakes } = self else { return (a(), b()) };
        let (a, b) = (Mutex::new((Some(a), None)), Mutex::new((Some(b), None)));
        team.share(wakes, &|| {
            once(&a);
            once(&b);
        });
        match (unlocked(a).1, unlocked(b).1) {
            (Some(a), Some(b)) => (a, b),
            _ => unreachable!("`share` returns when both jobs have"),
        }
    }
}

/// Chunks in sequence.
struct Piece<'d, T, B> {
    /// Index of the first one.
    first: usize,
    data: &'d mut [T],
    /// One element a chunk.
    beside: &'d mut [B],
}

/// Takes a share of the chunks that are left: half of what each thread would get. The later, the
/// fewer, so that all threads end together; few shares, so that their neighbours stay together.
fn take<'d, T, B>(mut rest: MutexGuard<'_, Piece<'d, T, B>>, size: usize, threads: usize) -> Option<Piece<'d, T, B>> {
    let chunks = (rest.beside.len() / (2 * threads)).max(1).min(rest.beside.len());
    let first = rest.first;
    rest.first += chunks;
    let at = (chunks * size).min(rest.data.len());
    let (data, beside);
    (data, rest.data) = std::mem::take(&mut rest.data).split_at_mut(at);
    (beside, rest.beside) = std::mem::take(&mut rest.beside).split_at_mut(chunks);
    (chunks > 0).then_some(Piece { first, data, beside })
}

/// Runs a job unless it was begun.
fn once<T, F: FnOnce() -> T>(job: &Mutex<(Option<F>, Option<T>)>) {
    let begun = lock(job).0.take();
    if let Some(begun) = begun {
        let result = begun();
        lock(job).1 = Some(result);
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn unlocked<T>(mutex: Mutex<T>) -> T {
    mutex.into_inner().unwrap_or_else(PoisonError::into_inner)
}
