//! Real-time priority and locked memory, as far as the system permits this process.
//!
//! | thread | SCHED_FIFO | blocks at every turn in |
//! |---|---|---|
//! | capture | 6 | `poll` or a wait with a deadline, for its device, 50 ms at most |
//! | pairing | 5 | its queue, 20 ms at most |
//! | insertion, its pool and the preparation of its memory | 4 | its queue, 100 ms at most; the pool sleeps when there is nothing to insert |
//! | recorder and its syncs, status, picture, the caller's | none | |
//! | rendering and its pool | none, and nice: other threads that want the core get nine tenths of it, in any session | |
//!
//! The numbers are small: the kernel's own interrupt threads have 50. Reading devices comes
//! first, since unread data are lost, while late data further on only wait. No thread that
//! renders or writes to a disk may take a core from these.
//!
//! A real-time thread that does not block would stop everything else on its core. So each thread
//! may run for half a second without blocking (`RLIMIT_RTTIME`). Then the kernel signals it, and
//! all threads return to the usual policy for good; the session status reports this. On a
//! machine that is too slow, insertion that never blocks ends there too, as intended: the
//! recorder would get no time. Until the caller's thread reacts, the kernel leaves 50 ms of
//! every second to other threads (`sched_rt_runtime_us`).
//!
//! Present memory stays resident (`mlockall`); new memory is locked when it is first written.
//! Locking it on reservation would fill the address space reserved for the volume and the
//! threads' stacks. This is done only if the process may lock without limit, and the machine has
//! room for the largest volume. Under a limit, an allocation would fail at some point of the
//! session instead of being slow. Without the room, the kernel would kill other programs.

#![allow(
    unsafe_code,
    reason = "the policy of a thread is set by a system call that no safe crate has with SCHED_RESET_ON_FORK"
)]

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, Rlimit, getrlimit, setpriority_process, setrlimit};
use rustix::thread::{CapabilitySet, capabilities};
use serde::Serialize;

/// Time for which a thread may run without blocking, µs.
const UNBLOCKED_US: u64 = 500_000;
/// Memory besides the volume: frames on their way, the renderer's caches, the program.
const BESIDES_BYTES: u64 = 1 << 30;

/// Nice value of a background thread: of a core that insertion wants too, it gets a tenth.
const NICE: i32 = 10;

/// A thread's role, which determines its priority.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    Capture,
    Pairing,
    Insertion,
    /// Any thread that may wait.
    Usual,
}

impl Role {
    /// Returns its priority among real-time threads; `None` if it is not real-time.
    fn priority(self) -> Option<i32> {
        match self {
            Self::Capture => Some(6),
            Self::Pairing => Some(5),
            Self::Insertion => Some(4),
            Self::Usual => None,
        }
    }

    /// Returns whether threads that it starts have the usual policy. Drivers have helpers that
    /// need not be fast; the inserter's pool needs its priority.
    fn alone(self) -> bool {
        self != Self::Insertion
    }
}

/// A low-priority thread; threads that it starts inherit the priority.
///
/// It must hold nothing that others wait for: on a busy machine they would wait until everything
/// else has had its nine tenths.
pub(super) struct Background(rayon::ThreadPool);

impl Background {
    /// Starts the thread.
    ///
    /// # Errors
    /// The system's, if no thread can be started.
    pub(super) fn new(name: &'static str) -> Result<Self, rayon::ThreadPoolBuildError> {
        let give_way = move |_| {
            if let Err(error) = setpriority_process(None, NICE) {
                tracing::warn!("thread {name} does not give way to the others: {error}");
            }
        };
        rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            .thread_name(|_| name.into())
            .start_handler(give_way)
            .build()
            .map(Self)
    }

    /// Runs the job on that thread; the calling thread waits.
    pub(super) fn run<T: Send>(&self, job: impl FnOnce() -> T + Send) -> T {
        self.0.install(job)
    }
}

/// Scheduling grant, with the reasons for what was not granted, as sentences.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct SchedulingGrant {
    /// Whether threads run in real time.
    pub realtime: bool,
    /// Whether memory is locked.
    pub memory_locked: bool,
    /// Sentences on parts that were refused or taken back: why, and the remedy.
    pub why: Vec<String>,
}

/// Scheduling policy of the process. The default is that of any program.
#[derive(Debug, Clone, Default)]
pub struct SchedulingPolicy {
    granted: SchedulingGrant,
    /// Set on the kernel's signal that a thread has run for too long without blocking.
    exceeded: Option<Arc<AtomicBool>>,
}

impl SchedulingPolicy {
    /// Requests real-time priority and locked memory, for a volume of at most `volume_bytes`
    /// bytes.
    pub fn ask(volume_bytes: u64) -> Self {
        let mut standing = Self::default();
        match limit_unblocked().and_then(|exceeded| try_out().map(|()| exceeded)) {
            Ok(exceeded) => {
                standing.granted.realtime = true;
                standing.exceeded = Some(exceeded);
            }
            Err(error) => standing.granted.why.push(format!(
                "threads have no real-time priority ({error}): a busy machine may lose data; give the process RLIMIT_RTPRIO {} or CAP_SYS_NICE, as LimitRTPRIO= in a systemd unit does",
                Role::Capture.priority().unwrap_or_default()
            )),
        }
        match lock_memory(volume_bytes) {
            Ok(()) => standing.granted.memory_locked = true,
            Err(why) => standing.granted.why.push(format!("memory may be paged out: {why}")),
        }
        standing
    }

    /// Returns the scheduling grant.
    pub fn granted(&self) -> &SchedulingGrant {
        &self.granted
    }

    /// Gives the calling thread the priority of its role.
    pub(super) fn enter(&self, role: Role) {
        let Some(priority) = role.priority().filter(|_| self.granted.realtime) else { return };
        let policy = libc::SCHED_FIFO | if role.alone() { libc::SCHED_RESET_ON_FORK } else { 0 };
        if let Err(error) = schedule(0, policy, priority) {
            tracing::warn!(?role, "a thread has no real-time priority, though others have: {error}");
        }
    }

    /// Returns to the usual policy if a thread has exceeded its time. Call it several times a
    /// second; returns whether it did so now.
    pub(super) fn watch(&mut self) -> bool {
        if !self.exceeded.as_ref().is_some_and(|exceeded| exceeded.swap(false, Ordering::Relaxed))
            || !self.granted.realtime
        {
            return false;
        }
        let kept = all_usual().err();
        self.granted.realtime = false;
        let mut why = format!(
            "a thread ran for {} ms without a pause: threads have no real-time priority any more, and a busy machine may lose data; is the machine too slow for these settings?",
            UNBLOCKED_US / 1000
        );
        if let Some(error) = kept {
            why += &format!(" Some could not be set back: {error}");
        }
        tracing::error!("{why}");
        self.granted.why.push(why);
        true
    }
}

/// Requests the kernel's signal for threads that run too long without blocking. A lower existing
/// limit is kept.
fn limit_unblocked() -> io::Result<Arc<AtomicBool>> {
    let exceeded = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(libc::SIGXCPU, Arc::clone(&exceeded))?;
    let Rlimit { current, maximum } = getrlimit(Resource::Rttime);
    let needed = current.unwrap_or(u64::MAX).min(maximum.unwrap_or(u64::MAX)).min(UNBLOCKED_US);
    setrlimit(Resource::Rttime, Rlimit { current: Some(needed), maximum })?;
    Ok(exceeded)
}

/// Tests on a separate thread whether the highest priority is permitted.
fn try_out() -> io::Result<()> {
    let highest = Role::Capture.priority().unwrap_or_default();
    let tried = std::thread::Builder::new()
        .name("priority".into())
        .spawn(move || schedule(0, libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK, highest))?;
    tried.join().unwrap_or_else(|_| Err(io::ErrorKind::Other.into()))
}

/// Returns all threads of the process to the usual policy.
fn all_usual() -> io::Result<()> {
    let mut result = Ok(());
    for task in std::fs::read_dir("/proc/self/task")? {
        let Some(thread) = task?.file_name().to_str().and_then(|name| name.parse().ok()) else { continue };
        match schedule(thread, libc::SCHED_OTHER | libc::SCHED_RESET_ON_FORK, 0) {
            // The thread has ended meanwhile.
            Err(error) if error.raw_os_error() == Some(libc::ESRCH) => {}
            other => result = result.and(other),
        }
    }
    result
}

/// Sets a thread's policy and priority; 0 is the calling thread.
fn schedule(thread: libc::pid_t, policy: libc::c_int, priority: libc::c_int) -> io::Result<()> {
    // SAFETY: the call reads the kernel's `sched_param` from the address, which is one int, and no
    // other memory of this process. The address is that of an int on this stack, which outlives
    // the call. The kernel checks thread, policy and priority. The call is by number, since musl
    // has no such function for threads, and its `sched_param` has further fields.
    let result = unsafe { libc::syscall(libc::SYS_sched_setscheduler, thread, policy, &raw const priority) };
    if result == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

/// Locks memory, if all memory that the session may need can be locked.
fn lock_memory(volume_bytes: u64) -> Result<(), String> {
    let may = capabilities(None).is_ok_and(|sets| sets.effective.contains(CapabilitySet::IPC_LOCK));
    if let Some(limit) = getrlimit(Resource::Memlock).current.filter(|_| !may) {
        return Err(format!(
            "the process may lock {:.0} MB only; give it RLIMIT_MEMLOCK infinity or CAP_IPC_LOCK, as LimitMEMLOCK=infinity in a systemd unit does",
            limit as f64 / 1e6
        ));
    }
    let system = rustix::system::sysinfo();
    let machine = (system.totalram as u64).saturating_mul(u64::from(system.mem_unit));
    let needed = volume_bytes.saturating_add(BESIDES_BYTES);
    if needed > machine {
        return Err(format!(
            "the volume may take {:.1} GiB, and with the rest that is more than this machine's {:.1} GiB; lower volume.max_memory_gib",
            volume_bytes as f64 / f64::from(1 << 30),
            machine as f64 / f64::from(1 << 30)
        ));
    }
    // Present memory first: with both flags in one call, present memory too would be locked only
    // when touched.
    mlockall(MlockAllFlags::CURRENT)
        .and_then(|()| mlockall(MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT))
        .map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use super::*;

    /// Returns policy, with its flag, and priority of the calling thread.
    fn own() -> (libc::c_int, libc::c_int) {
        let mut priority: libc::c_int = -1;
        // SAFETY: the first call reads nothing of this process's memory; the second writes the
        // kernel's `sched_param`, which is one int, to an int on this stack.
        unsafe {
            let policy = libc::syscall(libc::SYS_sched_getscheduler, 0);
            assert_eq!(libc::syscall(libc::SYS_sched_getparam, 0, &raw mut priority), 0);
            (libc::c_int::try_from(policy).unwrap(), priority)
        }
    }

    #[test]
    fn default_policy_changes_nothing() {
        let before = own();
        let mut standing = SchedulingPolicy::default();
        standing.enter(Role::Capture);
        assert_eq!((own(), standing.watch()), (before, false));
        assert_eq!(*standing.granted(), SchedulingGrant::default());
    }

    #[test]
    fn background_thread_and_children_are_nice() {
        let nice = || rustix::process::getpriority_process(None).unwrap();
        let before = nice();
        let background = Background::new("aside").unwrap();
        let there = background.run(|| (nice(), std::thread::spawn(nice).join().unwrap()));
        assert_eq!(there, (before.max(NICE), before.max(NICE)));
        assert_eq!(nice(), before, "who waits for it does not");
    }

    #[test]
    fn roles_get_priorities_until_the_kernel_revokes_them() {
        // The test runs in its own threads, so that the tests' threads stay unchanged. Without
        // permission, only the reason can be checked.
        if let Err(error) = try_out() {
            let refused = SchedulingPolicy {
                granted: SchedulingGrant { realtime: false, ..SchedulingGrant::default() },
                exceeded: None,
            };
            refused.enter(Role::Capture);
            assert_eq!(error.kind(), io::ErrorKind::PermissionDenied);
            return;
        }
        let exceeded = Arc::new(AtomicBool::new(false));
        let mut standing = SchedulingPolicy {
            granted: SchedulingGrant { realtime: true, ..SchedulingGrant::default() },
            exceeded: Some(Arc::clone(&exceeded)),
        };
        let (sender, received) = mpsc::channel();
        let (go, wait) = mpsc::channel::<()>();
        let reconstructor = {
            let standing = standing.clone();
            std::thread::spawn(move || {
                standing.enter(Role::Insertion);
                sender.send((own(), std::thread::spawn(own).join().unwrap())).unwrap();
                wait.recv().unwrap();
                own()
            })
        };
        let fifo = libc::SCHED_FIFO;
        assert_eq!(received.recv().unwrap(), ((fifo, 4), (fifo, 4)), "its pool inserts for it");
        for (role, priority) in [(Role::Capture, 6), (Role::Pairing, 5)] {
            let standing = standing.clone();
            let seen = std::thread::spawn(move || {
                standing.enter(role);
                (own(), std::thread::spawn(own).join().unwrap())
            });
            let (own, helper) = seen.join().unwrap();
            assert_eq!(own, (fifo | libc::SCHED_RESET_ON_FORK, priority));
            assert_eq!(helper, (libc::SCHED_OTHER, 0), "its helpers are as usual");
        }
        assert!(!standing.watch(), "nothing has happened");
        exceeded.store(true, Ordering::Relaxed);
        assert!(standing.watch() && !standing.watch(), "once");
        go.send(()).unwrap();
        assert_eq!(reconstructor.join().unwrap().0 & !libc::SCHED_RESET_ON_FORK, libc::SCHED_OTHER);
        assert!(!standing.granted().realtime && standing.granted().why[0].contains("without a pause"));
        let late = standing.clone();
        let seen = std::thread::spawn(move || {
            late.enter(Role::Capture);
            own()
        });
        assert_eq!(seen.join().unwrap().0 & fifo, 0, "who begins later has none either");
    }
}
