//! Processors of a team's members: all but the caller's.
//!
//! Linux may put a thread that is woken on the processor of the one that wakes it, though another
//! is idle, or will be in some microseconds. Members would then begin when the caller's work is
//! done. So each caller leaves its processor out of those that the members may use, before it
//! wakes them. That costs system calls only when a caller has come to another processor.

use std::cell::Cell;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use rustix::thread::{CpuSet, Pid, gettid, sched_getaffinity, sched_getcpu, sched_setaffinity};

thread_local! {
    /// Whether this thread is a member of a team.
    static IS_MEMBER: Cell<bool> = const { Cell::new(false) };
}

/// No processor.
const NONE: usize = usize::MAX;

/// The processors of a team's members.
#[derive(Debug)]
pub(super) struct Affinity {
    /// Those of the thread that made the team.
    allowed: CpuSet,
    members: Mutex<Vec<Pid>>,
    /// The caller's processor, which the members do not use.
    left_out: AtomicUsize,
}

impl Default for Affinity {
    fn default() -> Self {
        // A system that does not tell them lets nobody choose, either.
        let allowed = sched_getaffinity(None).unwrap_or_default();
        Self { allowed, members: Mutex::default(), left_out: AtomicUsize::new(NONE) }
    }
}

impl Affinity {
    /// Makes the calling thread a member.
    pub(super) fn join(&self) {
        IS_MEMBER.set(true);
        let mut members = self.members();
        members.push(gettid());
        self.apply(&members[members.len() - 1..]);
    }

    /// Keeps the members off the calling thread's processor, unless it is a member itself or there
    /// is no other.
    pub(super) fn leave_out_callers(&self) {
        if IS_MEMBER.get() || self.allowed.count() < 2 {
            return;
        }
        let here = sched_getcpu();
        if self.left_out.swap(here, Ordering::Relaxed) != here {
            self.apply(&self.members());
        }
    }

    fn apply(&self, members: &[Pid]) {
        let left_out = self.left_out.load(Ordering::Relaxed);
        if left_out >= CpuSet::MAX_CPU {
            return;
        }
        let mut others = self.allowed;
        others.unset(left_out);
        for member in members {
            // If the system refuses, the members run where it puts them.
            let _ = sched_setaffinity(Some(*member), &others);
        }
    }

    fn members(&self) -> MutexGuard<'_, Vec<Pid>> {
        self.members.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Team;
    use super::*;

    fn only(processor: usize) -> CpuSet {
        let mut set = CpuSet::new();
        set.set(processor);
        set
    }

    #[test]
    fn members_use_all_processors_but_the_callers() {
        let allowed = sched_getaffinity(None).unwrap();
        let team = Team::new("test", 3).unwrap().unwrap();
        let everywhere: Vec<usize> = (0..CpuSet::MAX_CPU).filter(|at| allowed.is_set(*at)).collect();
        for &here in everywhere.iter().take(4) {
            sched_setaffinity(None, &only(here)).unwrap();
            team.share(true, &|| {});
            let members = loop {
                // A member joins when it has started.
                let members = team.shared.affinity.members().clone();
                if members.len() == 2 {
                    break members;
                }
                std::thread::yield_now();
            };
            let mut others = allowed;
            others.unset(here);
            // The only processor is used by all.
            let expected = if everywhere.len() > 1 { others } else { allowed };
            for member in members {
                assert_eq!(sched_getaffinity(Some(member)).unwrap(), expected, "caller on {here}");
            }
        }
        // A member that opens a section within another leaves all as it is.
        let last = team.shared.affinity.left_out.load(Ordering::Relaxed);
        let both = std::sync::Barrier::new(team.threads());
        team.share(true, &|| {
            both.wait();
            team.share(true, &|| {});
        });
        assert_eq!(team.shared.affinity.left_out.load(Ordering::Relaxed), last);
        sched_setaffinity(None, &allowed).unwrap();
    }
}
