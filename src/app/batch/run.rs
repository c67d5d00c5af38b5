//! Runs the sweeps of a batch that are not done yet.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;

use super::attempt::{self, Attempt, AttemptState};
use super::done::is_done;
use super::folder::RunFolder;
use super::plan::{self, Planned};
use super::select::Selection;
use super::status::{Status, status_of};
use super::sweep::{self, Machine};
use crate::failure::{Failure, FailureKind};

/// Settings of a run.
#[derive(Debug, Clone)]
pub(crate) struct RunOptions {
    pub(crate) selection: Selection,
    /// Processes at a time.
    pub(crate) jobs: usize,
    /// Tries of a sweep.
    pub(crate) attempts: u32,
    pub(crate) machine: Machine,
    /// Whether no sweep begins after one has failed.
    pub(crate) fails_fast: bool,
    /// Whether tries of earlier runs count: otherwise failed sweeps get all tries again.
    pub(crate) counts_earlier: bool,
}

/// Progress of a run.
pub(crate) struct Progress<'a> {
    pub(crate) attempt: &'a Attempt,
    /// Whether the sweep is tried again.
    pub(crate) is_repeated: bool,
    /// Sweeps that have ended, of those that this run began with.
    pub(crate) ended: usize,
    pub(crate) of: usize,
}

/// A sweep that waits, with its failed tries.
struct Waiting<'a> {
    sweep: &'a Planned,
    failed: u32,
}

#[derive(Default)]
struct Queue<'a> {
    waiting: VecDeque<Waiting<'a>>,
    /// Sweeps that are being tried, which may be put back.
    working: usize,
    ended: usize,
    has_failed: bool,
    /// Reason why the run cannot go on.
    broken: Option<Failure>,
}

struct Driver<'a> {
    folder: &'a RunFolder,
    options: &'a RunOptions,
    queue: Mutex<Queue<'a>>,
    changed: Condvar,
    stop: &'a AtomicBool,
    of: usize,
    progress: &'a (dyn Fn(&Progress<'_>) + Sync),
}

/// Runs the selected sweeps that are not done and have tries left, those that cost most first, and
/// returns the status of the selected ones.
///
/// # Errors
/// [`Failure`] when the plan cannot be used, the batch's own files cannot be written, or a signal
/// ended the run. Results are complete or absent in each case.
pub(crate) fn run(
    folder: &RunFolder,
    options: &RunOptions,
    progress: &(dyn Fn(&Progress<'_>) + Sync),
) -> Result<Status, Failure> {
    let selected = plan::read(folder, &options.selection)?;
    plan::check_program(folder, &selected)?;
    super::owner::clean(folder.path(), false)
        .map_err(|e| Failure::io(folder.path(), "removing files of a killed run", &e))?;
    let mut waiting = Vec::new();
    for sweep in &selected {
        if is_done(folder, sweep) {
            folder.clean(&sweep.id, true)?;
            continue;
        }
        folder.clean(&sweep.id, false)?;
        let failed: Vec<Attempt> =
            attempt::of(folder, &sweep.id, &sweep.key)?.into_iter().filter(Attempt::has_failed).collect();
        let count = if options.counts_earlier { failed.len() as u32 } else { 0 };
        let is_left =
            count < options.attempts && (!options.counts_earlier || failed.iter().all(Attempt::may_be_repeated));
        if is_left {
            waiting.push(Waiting { sweep, failed: count });
        }
    }
    waiting.sort_by(|one, other| (other.sweep.cost, &one.sweep.id).cmp(&(one.sweep.cost, &other.sweep.id)));

    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        // The second one ends the run at once; its processes end with it.
        signal_hook::flag::register_conditional_shutdown(signal, 1, Arc::clone(&stop))?;
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    let of = waiting.len();
    let queue = Mutex::new(Queue { waiting: waiting.into(), ..Queue::default() });
    let driver = Driver { folder, options, queue, changed: Condvar::new(), stop: &stop, of, progress };
    thread::scope(|scope| {
        for _ in 0..options.jobs.min(of) {
            // A process ends with the thread that began it, which waits for it.
            scope.spawn(|| driver.work());
        }
    });
    let Queue { broken, .. } = driver.queue.into_inner().unwrap_or_else(PoisonError::into_inner);
    if let Some(failure) = broken {
        return Err(failure);
    }
    if stop.load(Ordering::Relaxed) {
        return Err(Failure::new("the run was ended by a signal; run it again to go on"));
    }
    status_of(folder, &selected)
}

impl<'a> Driver<'a> {
    fn lock(&self) -> MutexGuard<'_, Queue<'a>> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tries sweeps until none waits and none can come back.
    fn work(&self) {
        while let Some(waiting) = self.next() {
            let tried = self.try_once(waiting.sweep);
            self.enter(waiting, tried);
            self.changed.notify_all();
        }
    }

    fn next(&self) -> Option<Waiting<'a>> {
        let mut queue = self.lock();
        loop {
            let fails_fast = self.options.fails_fast && queue.has_failed;
            if self.stop.load(Ordering::Relaxed) || queue.broken.is_some() || fails_fast {
                return None;
            }
            if let Some(waiting) = queue.waiting.pop_front() {
                queue.working += 1;
                return Some(waiting);
            }
            if queue.working == 0 {
                return None;
            }
            queue = self.changed.wait(queue).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Tries a sweep; `None` if another run has done it.
    fn try_once(&self, sweep: &Planned) -> Result<Option<Attempt>, Failure> {
        if is_done(self.folder, sweep) {
            return Ok(None);
        }
        sweep::attempt(self.folder, sweep, &self.options.machine, self.stop).map(Some)
    }

    /// Enters the result of a try: the sweep has ended, or waits behind the others.
    fn enter(&self, mut waiting: Waiting<'a>, tried: Result<Option<Attempt>, Failure>) {
        let mut queue = self.lock();
        queue.working -= 1;
        let attempt = match tried {
            Ok(attempt) => attempt,
            Err(failure) => {
                queue.broken.get_or_insert(failure);
                // Others are stopped: their accounts could not be written either.
                self.stop.store(true, Ordering::Relaxed);
                return;
            }
        };
        let has_failed = attempt.as_ref().is_some_and(Attempt::has_failed);
        waiting.failed += u32::from(has_failed);
        let may_be_repeated = attempt.as_ref().is_some_and(Attempt::may_be_repeated);
        let is_repeated = has_failed && may_be_repeated && waiting.failed < self.options.attempts;
        if is_repeated {
            queue.waiting.push_back(waiting);
        } else {
            queue.ended += 1;
            queue.has_failed |= has_failed;
        }
        let ended = queue.ended;
        drop(queue);
        if let Some(attempt) = attempt.filter(|attempt| attempt.state != AttemptState::Interrupted) {
            (self.progress)(&Progress { attempt: &attempt, is_repeated, ended, of: self.of });
        }
    }
}

/// Returns the failure of a batch with sweeps that are not done; none if all are.
pub(crate) fn verdict(status: &Status) -> Result<(), Failure> {
    let (done, all) = (status.done, status.sweeps);
    if done == all {
        return Ok(());
    }
    let sentence = format!(
        "{} of {all} sweeps are not done; see the list for the reasons, and `sonoweave batch retry` tries failed ones \
         again",
        all - done
    );
    Err(Failure::new(sentence).of(FailureKind::SomeFailed))
}
