//! A team of threads that share short sections of work, with the caller as one of them.
//!
//! A slice is inserted or rendered in sections of some 20 µs to 1 ms. To wake a thread costs about
//! as much, above all on a virtual machine. So the members of a team stay awake for 200 µs after
//! their last work, and whoever opens a section does not wait for them: it takes pieces itself
//! until none is left. The members that have come by then are waited for, and whoever waits takes
//! pieces of other open sections meanwhile.
//!
//! Rayon's pools, in which the caller sleeps and other threads are woken for it, remain where work
//! takes longer.

#![allow(unsafe_code, reason = "threads that outlive a section run a job that borrows from it")]

mod affinity;

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use affinity::Affinity;

/// Time for which a thread that waits stays awake.
const AWAKE: Duration = Duration::from_micros(200);
/// Looks for work before a thread offers its processor to others at each look.
const LOOKS: u32 = 64;

/// A team of threads. Dropping it ends them.
#[derive(Debug)]
pub struct Team {
    shared: Arc<Shared>,
    members: Vec<JoinHandle<()>>,
}

impl Team {
    /// Starts the members of a team of `threads` threads, which are one fewer: the caller is the
    /// first. They are called `name-1`, `name-2` and so on. Returns `None` for one thread or none.
    ///
    /// # Errors
    /// The system's, if a thread cannot be started.
    pub fn new(name: &str, threads: usize) -> std::io::Result<Option<Self>> {
        if threads < 2 {
            return Ok(None);
        }
        let mut team = Self { shared: Arc::default(), members: Vec::with_capacity(threads - 1) };
        for number in 1..threads {
            let shared = Arc::clone(&team.shared);
            let thread = std::thread::Builder::new().name(format!("{name}-{number}"));
            team.members.push(thread.spawn(move || shared.serve())?);
        }
        Ok(Some(team))
    }

    /// Returns the number of threads, with the caller.
    pub fn threads(&self) -> usize {
        self.members.len() + 1
    }

    /// Wakes members that sleep: a section will be opened soon.
    pub fn wake(&self) {
        self.shared.affinity.leave_out_callers();
        self.shared.tell(&mut self.shared.lock(), &[MEMBERS]);
    }

    /// Runs the job on the calling thread, and on members that are free; those that sleep are
    /// woken if `wakes`. The job must return only when no work is left that it could begin. All
    /// runs have returned when this does.
    ///
    /// # Panics
    /// As the job does, on whichever thread.
    pub fn share(&self, wakes: bool, job: &(dyn Fn() + Sync)) {
        // SAFETY: only the lifetime is changed. The reference is in `open` from `open_section` to
        // `close_section`, which returns only when no member runs the job, and removes it. Both are
        // called here, where `job` is borrowed; between them nothing unwinds, as panics of the job
        // are caught.
        let endless = unsafe { std::mem::transmute::<&(dyn Fn() + Sync), &'static (dyn Fn() + Sync)>(job) };
        let number = self.shared.open_section(wakes, endless);
        let own = catch_unwind(AssertUnwindSafe(job));
        let others = self.shared.close_section(number);
        if let Some(panic) = own.err().or(others) {
            resume_unwind(panic);
        }
    }
}

impl Drop for Team {
    fn drop(&mut self) {
        let mut state = self.shared.lock();
        state.has_ended = true;
        self.shared.tell(&mut state, &[MEMBERS]);
        drop(state);
        for member in self.members.drain(..) {
            // Panics of jobs are caught, and nothing else of a member's panics.
            let _ = member.join();
        }
    }
}

/// Members without work.
const MEMBERS: usize = 0;
/// Threads that have opened a section, and wait until the members leave it.
const OPENERS: usize = 1;

#[derive(Debug, Default)]
struct Shared {
    state: Mutex<State>,
    /// Number of changes of the state that others may wait for. It changes while the state is
    /// locked, so that a thread that has locked the state misses none.
    changes: AtomicU64,
    /// Tell threads that sleep of a change.
    change: [Condvar; 2],
    affinity: Affinity,
}

#[derive(Debug, Default)]
struct State {
    /// Open sections, the newest last.
    open: Vec<Section>,
    /// Number of the next section.
    next: u64,
    /// Threads that sleep, and were not told to wake.
    asleep: [usize; 2],
    has_ended: bool,
}

/// Work that is shared.
struct Section {
    number: u64,
    job: &'static (dyn Fn() + Sync),
    /// Threads that run the job, without the one that opened the section.
    inside: usize,
    /// Whether all work has been begun: none may enter.
    is_full: bool,
    /// The first panic of these threads.
    panic: Option<Box<dyn Any + Send>>,
}

impl std::fmt::Debug for Section {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Section").field("number", &self.number).field("inside", &self.inside).finish_non_exhaustive()
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tells of a change: all that are awake, and the given ones that sleep.
    fn tell(&self, state: &mut State, sleepers: &[usize]) {
        self.changes.fetch_add(1, Ordering::Release);
        for who in sleepers {
            // Once: the call takes some 25 µs, and they as long to come.
            if std::mem::take(&mut state.asleep[*who]) > 0 {
                self.change[*who].notify_all();
            }
        }
    }

    fn open_section(&self, wakes: bool, job: &'static (dyn Fn() + Sync)) -> u64 {
        self.affinity.leave_out_callers();
        let mut state = self.lock();
        let number = state.next;
        state.next += 1;
        state.open.push(Section { number, job, inside: 0, is_full: false, panic: None });
        self.tell(&mut state, if wakes { &[OPENERS, MEMBERS] } else { &[OPENERS] });
        number
    }

    /// Waits until all others have left the section, and removes it. Returns the first panic.
    fn close_section(&self, number: u64) -> Option<Box<dyn Any + Send>> {
        let mut state = self.lock();
        loop {
            let at = state.open.iter().position(|section| section.number == number)?;
            state.open[at].is_full = true;
            if state.open[at].inside == 0 {
                return state.open.remove(at).panic;
            }
            state = self.help_or_wait(state, OPENERS);
        }
    }

    /// The life of a member.
    fn serve(&self) {
        self.affinity.join();
        let mut state = self.lock();
        while !state.has_ended {
            state = self.help_or_wait(state, MEMBERS);
        }
    }

    /// Runs the job of the newest section that may be entered. If there is none, waits for a
    /// change.
    fn help_or_wait<'a>(&'a self, mut state: MutexGuard<'a, State>, who: usize) -> MutexGuard<'a, State> {
        let Some(section) = state.open.iter_mut().rev().find(|section| !section.is_full) else {
            return self.wait(state, who);
        };
        section.inside += 1;
        let (number, job) = (section.number, section.job);
        drop(state);
        let result = catch_unwind(AssertUnwindSafe(job));
        let mut state = self.lock();
        // Sections with someone inside are not removed.
        if let Some(section) = state.open.iter_mut().find(|section| section.number == number) {
            section.inside -= 1;
            section.is_full = true;
            section.panic = section.panic.take().or(result.err());
        }
        self.tell(&mut state, &[OPENERS]);
        state
    }

    /// Waits for a change: awake for a while, then asleep.
    fn wait<'a>(&'a self, state: MutexGuard<'a, State>, who: usize) -> MutexGuard<'a, State> {
        let seen = self.changes.load(Ordering::Acquire);
        drop(state);
        let (mut looks, mut since) = (0, None);
        while self.changes.load(Ordering::Acquire) == seen {
            if looks < LOOKS {
                looks += 1;
                std::hint::spin_loop();
            } else if since.get_or_insert_with(Instant::now).elapsed() < AWAKE {
                std::thread::yield_now();
            } else {
                let mut state = self.lock();
                while self.changes.load(Ordering::Acquire) == seen {
                    state.asleep[who] += 1;
                    state = self.change[who].wait(state).unwrap_or_else(PoisonError::into_inner);
                }
                return state;
            }
        }
        self.lock()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;
    use std::sync::Barrier;
    use std::thread::ThreadId;

    use super::*;
    use crate::sharing::Sharing;

    fn team(threads: usize) -> Team {
        Team::new("test", threads).unwrap().unwrap()
    }

    /// Waits until all members sleep.
    fn fall_asleep(team: &Team) {
        while team.shared.lock().asleep[MEMBERS] < team.members.len() {
            std::thread::sleep(AWAKE);
        }
    }

    /// Runs a section in which all threads of the team must be at once, and returns them.
    fn all_at_once(team: &Team) -> HashSet<ThreadId> {
        let (all, threads) = (Barrier::new(team.threads()), Mutex::default());
        team.share(true, &|| {
            HashSet::insert(&mut threads.lock().unwrap(), std::thread::current().id());
            all.wait();
        });
        threads.into_inner().unwrap()
    }

    #[test]
    fn one_thread_is_no_team() {
        assert!(Team::new("test", 0).unwrap().is_none());
        assert!(Team::new("test", 1).unwrap().is_none());
        assert_eq!(team(2).threads(), 2);
    }

    #[test]
    fn members_come_awake_and_asleep_and_the_caller_is_one_of_them() {
        for threads in [2, 5] {
            let team = team(threads);
            let here = std::thread::current().id();
            let first = all_at_once(&team);
            assert!(first.len() == threads && first.contains(&here), "{first:?}");
            fall_asleep(&team);
            assert_eq!(all_at_once(&team), first, "the same threads");
            fall_asleep(&team);
            team.wake();
            assert_eq!(all_at_once(&team), first);
        }
    }

    #[test]
    fn short_work_wakes_nobody() {
        let team = team(3);
        let here = std::thread::current().id();
        fall_asleep(&team);
        for _ in 0..20 {
            let mut threads = [None; 100];
            let (alone, ()) = Sharing::with_awake(Some(&team)).both(|| std::thread::current().id(), || ());
            Sharing::with_awake(Some(&team)).chunks(&mut threads, 1, |_, x| x[0] = Some(std::thread::current().id()));
            assert!(alone == here && threads.iter().all(|thread| *thread == Some(here)));
        }
        assert_eq!(team.shared.lock().asleep[MEMBERS], 2);
        assert_eq!(all_at_once(&team).len(), 3);
    }

    #[test]
    fn every_chunk_is_done_once_whatever_its_size() {
        let team = team(3);
        for length in [0, 1, 2, 63, 64, 65, 1000] {
            for size in [1, 7, 64, 2000] {
                for sharing in [Sharing::Alone, Sharing::of(Some(&team))] {
                    let mut data = vec![0_u32; length];
                    let mut beside = vec![0_usize; length.div_ceil(size)];
                    sharing.chunks_beside(&mut data, size, &mut beside, |beside, index, chunk| {
                        *beside += index + 1;
                        for (at, x) in chunk.iter_mut().enumerate() {
                            *x += (index * size + at) as u32 + 1;
                        }
                    });
                    assert!(data.iter().copied().eq(1..=length as u32), "{length} by {size}: {data:?}");
                    assert!(beside.iter().copied().eq(1..=beside.len()), "{length} by {size}: {beside:?}");
                }
            }
        }
    }

    #[test]
    fn jobs_of_a_pair_share_their_own_work() {
        let team = team(4);
        for round in 0..200_u64 {
            let sum = |sharing: Sharing, from: u64| {
                let mut terms = Vec::from_iter(from..from + 100);
                sharing.chunks(&mut terms, 3, |_, terms| terms.iter_mut().for_each(|x| *x *= 2));
                terms.into_iter().sum::<u64>()
            };
            let sharing = Sharing::of(Some(&team));
            let sums = sharing.both(|| sum(sharing, round), || sum(sharing, 2 * round));
            assert_eq!(sums, (sum(Sharing::Alone, round), sum(Sharing::Alone, 2 * round)));
        }
    }

    #[test]
    fn callers_of_several_threads_get_their_own_results() {
        let team = team(3);
        std::thread::scope(|scope| {
            for caller in 0..4_usize {
                let team = &team;
                scope.spawn(move || {
                    for _ in 0..200 {
                        let mut data = [0; 50];
                        Sharing::of(Some(team)).chunks(&mut data, 1, |index, x| x[0] = index * caller);
                        assert!(data.iter().enumerate().all(|(index, x)| *x == index * caller));
                    }
                });
            }
        });
        assert!(team.shared.lock().open.is_empty());
    }

    #[test]
    fn panic_of_any_thread_reaches_the_caller_and_the_team_goes_on() {
        let team = team(2);
        let here = std::thread::current().id();
        for of_caller in [true, false] {
            let both = Barrier::new(2);
            let run = catch_unwind(AssertUnwindSafe(|| {
                team.share(true, &|| {
                    both.wait();
                    assert_ne!(std::thread::current().id() == here, of_caller, "meant");
                });
            }));
            let text = run.unwrap_err().downcast::<String>().unwrap();
            assert!(text.contains("meant"), "{text}");
            assert!(team.shared.lock().open.is_empty());
        }
        assert_eq!(all_at_once(&team).len(), 2);
    }

    #[test]
    fn members_end_with_their_team() {
        let team = team(3);
        let shared = Arc::downgrade(&team.shared);
        fall_asleep(&team);
        drop(team);
        assert!(shared.upgrade().is_none(), "a thread still holds it");
    }
}
