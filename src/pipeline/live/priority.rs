//! Real-time priority and memory that stays, as far as this process may have them.
//!
//! | thread | SCHED_FIFO | blocks at every turn in |
//! |---|---|---|
//! | capture | 6 | `poll` or a wait with a deadline, for its device, 50 ms at most |
//! | pairing | 5 | its queue, 20 ms at most |
//! | weaving, its pool and what prepares its memory | 4 | its queue, 100 ms at most; the pool sleeps when there is nothing to weave |
//! | recorder, status, picture, the caller's | none | |
//! | drawing and its pool | none, and nice: whatever else wants the core gets nine tenths of it, in any session | |
//!
//! The numbers are small: the kernel's own threads for interrupts have 50. What reads a device comes first, since what is not read in time is lost; what is late further on only
//! waits. Nothing that a user looks at, and nothing that writes to a disk, may take a core from that.
//!
//! A thread of such a priority that does not block would stop everything else on its core. So each may run for half a second without blocking (`RLIMIT_RTTIME`); then the kernel
//! says so, and all threads go back to the usual policy, for good, which the account says. Weaving that has no time left to block, on a machine that is too slow, ends there too,
//! as it should: what records would get no time. Until the caller's thread comes to it, the kernel leaves 50 ms of every second to other threads (`sched_rt_runtime_us`).
//!
//! Memory that is there stays there (`mlockall`), and what comes is locked as it is first written: locking it as it is reserved would fill what the volume and its threads'
//! stacks only have addresses for. This is done only if the process may lock as much as it likes, and the machine holds all that the volume may become: with a limit, asking for
//! memory would fail at some point of the session instead of being slow, and without the room other programs would be killed.

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

/// For how long a thread may run without blocking, µs.
const UNBLOCKED_US: u64 = 500_000;
/// Memory besides the volume: frames on their way, the renderer's caches, the program.
const BESIDES_BYTES: u64 = 1 << 30;

/// How nice a thread is that gives way: of a core that weaving wants, too, it gets a tenth.
const NICE: i32 = 10;

/// What a thread does, by which it gets its priority.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    Capture,
    Pairing,
    Weaving,
    /// Whatever may wait.
    Usual,
}

impl Role {
    /// Its priority among real-time threads; `None` for what is none.
    fn priority(self) -> Option<i32> {
        match self {
            Self::Capture => Some(6),
            Self::Pairing => Some(5),
            Self::Weaving => Some(4),
            Self::Usual => None,
        }
    }

    /// Whether threads that it begins are of the usual policy: drivers have helpers that need not be as quick; the weaver's pool is what weaves.
    fn alone(self) -> bool {
        self != Self::Weaving
    }
}

/// A thread for what gives way to everything else, as do those that it begins.
///
/// It may hold nothing that others wait for: on a busy machine they would have to wait until everything else has had its nine tenths.
pub(super) struct Background(rayon::ThreadPool);

impl Background {
    /// # Errors
    /// The system's, where there can be no other thread.
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

    /// Does it there; the calling thread waits.
    pub(super) fn run<T: Send>(&self, job: impl FnOnce() -> T + Send) -> T {
        self.0.install(job)
    }
}

/// What was granted, and why not more: sentences.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Granted {
    /// Threads run in real time.
    pub realtime: bool,
    /// Memory is not paged out.
    pub memory_locked: bool,
    /// What was not granted or taken back, why, and what to do.
    pub why: Vec<String>,
}

/// The process' standing with the scheduler. The usual one is that of any program.
#[derive(Debug, Clone, Default)]
pub struct Standing {
    granted: Granted,
    /// Set by the kernel when a thread has run for too long without blocking.
    exceeded: Option<Arc<AtomicBool>>,
}

impl Standing {
    /// Asks for real time and for memory that stays, where the volume may take so many bytes.
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

    /// What was granted.
    pub fn granted(&self) -> &Granted {
        &self.granted
    }

    /// Gives the calling thread what its role has a right to.
    pub(super) fn enter(&self, role: Role) {
        let Some(priority) = role.priority().filter(|_| self.granted.realtime) else { return };
        let policy = libc::SCHED_FIFO | if role.alone() { libc::SCHED_RESET_ON_FORK } else { 0 };
        if let Err(error) = schedule(0, policy, priority) {
            tracing::warn!(?role, "a thread has no real-time priority, though others have: {error}");
        }
    }

    /// Takes real time back if a thread has used it up. To be called several times a second; returns whether it did so now.
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

/// The kernel is to say when a thread runs for too long without blocking. A limit that is lower already stays.
fn limit_unblocked() -> io::Result<Arc<AtomicBool>> {
    let exceeded = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(libc::SIGXCPU, Arc::clone(&exceeded))?;
    let Rlimit { current, maximum } = getrlimit(Resource::Rttime);
    let wanted = current.unwrap_or(u64::MAX).min(maximum.unwrap_or(u64::MAX)).min(UNBLOCKED_US);
    setrlimit(Resource::Rttime, Rlimit { current: Some(wanted), maximum })?;
    Ok(exceeded)
}

/// Whether the highest priority is to be had, tried by a thread of its own.
fn try_out() -> io::Result<()> {
    let highest = Role::Capture.priority().unwrap_or_default();
    let tried = std::thread::Builder::new()
        .name("priority".into())
        .spawn(move || schedule(0, libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK, highest))?;
    tried.join().unwrap_or_else(|_| Err(io::ErrorKind::Other.into()))
}

/// All threads of the process are of the usual policy again.
fn all_usual() -> io::Result<()> {
    let mut result = Ok(());
    for task in std::fs::read_dir("/proc/self/task")? {
        let Some(thread) = task?.file_name().to_str().and_then(|name| name.parse().ok()) else { continue };
        match schedule(thread, libc::SCHED_OTHER | libc::SCHED_RESET_ON_FORK, 0) {
            // It has ended meanwhile.
            Err(error) if error.raw_os_error() == Some(libc::ESRCH) => {}
            other => result = result.and(other),
        }
    }
    result
}

/// Sets a thread's policy and priority; 0 is the calling thread.
fn schedule(thread: libc::pid_t, policy: libc::c_int, priority: libc::c_int) -> io::Result<()> {
    let parameters = libc::sched_param { sched_priority: priority };
    // SAFETY: the call reads one `sched_param` from the address, which is that of a value of this type on this stack that outlives the call, and nothing else of this process's
    // memory; the kernel checks thread, policy and priority. By number, since musl has no such function for threads.
    let result = unsafe { libc::syscall(libc::SYS_sched_setscheduler, thread, policy, &raw const parameters) };
    if result == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

/// Keeps memory from being paged out, if all that will ever be asked for may be kept.
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
    let wanted = volume_bytes.saturating_add(BESIDES_BYTES);
    if wanted > machine {
        return Err(format!(
            "the volume may take {:.1} GiB, and with the rest that is more than this machine's {:.1} GiB; lower volume.max_memory_gib",
            volume_bytes as f64 / f64::from(1 << 30),
            machine as f64 / f64::from(1 << 30)
        ));
    }
    // What is there first: asking for both at once would have what is there locked as it is touched only, too.
    mlockall(MlockAllFlags::CURRENT)
        .and_then(|()| mlockall(MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT))
        .map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use super::*;

    /// Policy, with its flag, and priority of the calling thread.
    fn own() -> (libc::c_int, libc::c_int) {
        let mut parameters = libc::sched_param { sched_priority: -1 };
        // SAFETY: the first call reads nothing of this process's memory; the second writes one `sched_param` to a value of this type on this stack.
        unsafe {
            let policy = libc::syscall(libc::SYS_sched_getscheduler, 0);
            assert_eq!(libc::syscall(libc::SYS_sched_getparam, 0, &raw mut parameters), 0);
            (libc::c_int::try_from(policy).unwrap(), parameters.sched_priority)
        }
    }

    #[test]
    fn the_usual_standing_changes_nothing() {
        let before = own();
        let mut standing = Standing::default();
        standing.enter(Role::Capture);
        assert_eq!((own(), standing.watch()), (before, false));
        assert_eq!(*standing.granted(), Granted::default());
    }

    #[test]
    fn what_is_done_in_the_background_and_what_that_begins_gives_way() {
        let nice = || rustix::process::getpriority_process(None).unwrap();
        let before = nice();
        let background = Background::new("aside").unwrap();
        let there = background.run(|| (nice(), std::thread::spawn(nice).join().unwrap()));
        assert_eq!(there, (before.max(NICE), before.max(NICE)));
        assert_eq!(nice(), before, "who waits for it does not");
    }

    #[test]
    fn where_it_may_be_had_each_role_has_its_own_until_the_kernel_takes_it_back() {
        // In threads of their own: the tests' threads stay what they are. Without permission there is nothing to see but why.
        if let Err(error) = try_out() {
            let refused = Standing { granted: Granted { realtime: false, ..Granted::default() }, exceeded: None };
            refused.enter(Role::Capture);
            assert_eq!(error.kind(), io::ErrorKind::PermissionDenied);
            return;
        }
        let exceeded = Arc::new(AtomicBool::new(false));
        let mut standing = Standing {
            granted: Granted { realtime: true, ..Granted::default() },
            exceeded: Some(Arc::clone(&exceeded)),
        };
        let (tell, told) = mpsc::channel();
        let (go, wait) = mpsc::channel::<()>();
        let weaver = {
            let standing = standing.clone();
            std::thread::spawn(move || {
                standing.enter(Role::Weaving);
                tell.send((own(), std::thread::spawn(own).join().unwrap())).unwrap();
                wait.recv().unwrap();
                own()
            })
        };
        let fifo = libc::SCHED_FIFO;
        assert_eq!(told.recv().unwrap(), ((fifo, 4), (fifo, 4)), "its pool weaves for it");
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
        assert_eq!(weaver.join().unwrap().0 & !libc::SCHED_RESET_ON_FORK, libc::SCHED_OTHER);
        assert!(!standing.granted().realtime && standing.granted().why[0].contains("without a pause"));
        let late = standing.clone();
        let seen = std::thread::spawn(move || {
            late.enter(Role::Capture);
            own()
        });
        assert_eq!(seen.join().unwrap().0 & fifo, 0, "who begins later has none either");
    }
}
