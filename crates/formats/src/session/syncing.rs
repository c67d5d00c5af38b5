//! Syncs a session's data to the disk while the session is written.
//!
//! A write only hands bytes to the system, which may keep them in memory for half a minute. After
//! a sync they survive a power cut. A sync may take seconds, so a thread of its own runs it
//! ([`Syncer::run`]), and no write waits for that thread. The writer requests a sync once per
//! period, for everything written so far. If several requests come during a sync, the newest
//! counts.
//!
//! A message recorded more than 1 s ago survives a power cut, as these times add up to 1 s:
//!
//! | from a message's hand-over until | at most |
//! |---|---|
//! | its chunk is written, and a sync is requested (`WriterOptions::chunk_ns`) | 400 ms |
//! | the recorder's next turn, if no message comes meanwhile | 100 ms |
//! | a sync that runs already has ended | 250 ms |
//! | the requested sync has ended | 250 ms |
//!
//! If the disk needs longer, more is lost. `Account::unsynced_since_ns` shows how much.

use std::collections::VecDeque;
use std::fs::File;
use std::io;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Bytes that are written again at a time.
const PART: usize = 1 << 20;

/// A second handle of a store: syncs the data that the first one wrote.
pub trait DataSync: Send {
    /// Returns when all data written before the call are on the disk.
    ///
    /// # Errors
    /// The system's error. Any of the data may be missing on the disk, and the next call need not
    /// notice: the system forgets data that it could not write.
    fn sync(&mut self) -> io::Result<()>;

    /// Writes this part again, after a failed sync.
    ///
    /// # Errors
    /// The system's error.
    fn rewrite(&mut self, part: Range<u64>) -> io::Result<()>;
}

impl DataSync for File {
    fn sync(&mut self) -> io::Result<()> {
        self.sync_data()
    }

    /// Reads the part from the system's memory. Where the system has dropped it, the checksum of
    /// its chunk shows that.
    fn rewrite(&mut self, part: Range<u64>) -> io::Result<()> {
        let mut bytes = vec![0; PART];
        for at in part.clone().step_by(PART) {
            let piece = &mut bytes[..PART.min((part.end - at) as usize)];
            self.read_exact_at(piece, at)?;
            self.write_all_at(piece, at)?;
        }
        Ok(())
    }
}

/// For stores whose data need no sync.
impl DataSync for () {
    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }

    fn rewrite(&mut self, _: Range<u64>) -> io::Result<()> {
        Ok(())
    }
}

/// The state that the writer and the syncing thread share.
#[derive(Default)]
struct Progress {
    /// End of the data to be synced; whether this waits for the thread; whether a sync runs.
    requested: u64,
    waits: bool,
    runs: bool,
    /// End of the data on the disk.
    synced: u64,
    /// End of the data that a failed sync may have left out.
    unsure: u64,
    is_failing: bool,
    /// Failures that began or ended, not yet reported.
    news: VecDeque<io::Result<()>>,
    has_ended: bool,
}

struct Shared {
    data: Mutex<Box<dyn DataSync>>,
    progress: Mutex<Progress>,
    changed: Condvar,
}

/// Syncs a session's data; its clones belong to the same session.
#[derive(Clone)]
pub struct Syncer(Arc<Shared>);

impl Syncer {
    fn new(data: Box<dyn DataSync>) -> Self {
        Self(Arc::new(Shared { data: Mutex::new(data), progress: Mutex::default(), changed: Condvar::new() }))
    }

    fn progress(&self) -> MutexGuard<'_, Progress> {
        self.0.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Syncs whatever the writer requests until the session ends. Without a thread that runs this,
    /// a session is synced only at its end.
    pub fn run(&self) {
        loop {
            let waits = |progress: &mut Progress| !progress.waits && !progress.has_ended;
            let progress = self.0.changed.wait_while(self.progress(), waits);
            let mut progress = progress.unwrap_or_else(PoisonError::into_inner);
            if progress.has_ended {
                return;
            }
            (progress.waits, progress.runs) = (false, true);
            let until = progress.requested;
            drop(progress);
            // The writer reports the error.
            let _ = self.sync(until);
        }
    }

    /// Returns whether a sync is requested or runs.
    pub fn is_busy(&self) -> bool {
        let progress = self.progress();
        progress.waits || progress.runs
    }

    fn sync(&self, until: u64) -> io::Result<()> {
        // Only one sync runs at a time, so that `unsure` does not change meanwhile.
        let mut data = self.0.data.lock().unwrap_or_else(PoisonError::into_inner);
        let Progress { synced, unsure, .. } = *self.progress();
        let mut done = data.sync();
        if done.is_ok() && unsure > synced {
            // The disk works again. The system has forgotten the data that it missed.
            done = data.rewrite(synced..unsure).and_then(|()| data.sync());
        }
        let progress = &mut *self.progress();
        progress.runs = false;
        match &done {
            Ok(()) => {
                (progress.synced, progress.unsure) = (synced.max(until), 0);
                if std::mem::take(&mut progress.is_failing) {
                    progress.news.push_back(Ok(()));
                }
            }
            Err(error) => {
                progress.unsure = unsure.max(until);
                if !std::mem::replace(&mut progress.is_failing, true) {
                    progress.news.push_back(Err(io::Error::new(error.kind(), error.to_string())));
                }
            }
        }
        done
    }
}

/// The writer's side: when syncs are requested, and which messages wait for one.
pub(super) struct SyncRequests {
    syncer: Syncer,
    period_ns: i64,
    /// The newest request: its end within the file, and its time.
    requested: u64,
    requested_ns: i64,
    /// First message since then, ns.
    since_ns: Option<i64>,
    /// Ends of earlier requests that are not synced, and their first messages, ns.
    waiting: VecDeque<(u64, i64)>,
    trouble: String,
}

impl SyncRequests {
    pub(super) fn new(data: Box<dyn DataSync>, period_ns: i64) -> Self {
        Self {
            syncer: Syncer::new(data),
            period_ns,
            requested: 0,
            requested_ns: i64::MIN / 2,
            since_ns: None,
            waiting: VecDeque::new(),
            trouble: String::new(),
        }
    }

    pub(super) fn syncer(&self) -> Syncer {
        self.syncer.clone()
    }

    /// Notes a message that is to be synced.
    pub(super) fn message(&mut self, at_ns: i64) {
        self.since_ns.get_or_insert(at_ns);
    }

    /// Returns whether written data wait for a request, or for another after a failed sync.
    pub(super) fn is_due(&self, stored: u64, now_ns: i64) -> bool {
        (stored > self.requested || !self.trouble.is_empty()) && now_ns - self.requested_ns >= self.period_ns
    }

    /// Requests a sync of the `stored` bytes. All messages so far end at `end`, stored or not.
    pub(super) fn request(&mut self, stored: u64, end: u64, now_ns: i64) {
        if let Some(since_ns) = self.since_ns.take() {
            self.waiting.push_back((end, since_ns));
        }
        (self.requested, self.requested_ns) = (stored, now_ns);
        let mut progress = self.syncer.progress();
        (progress.requested, progress.waits) = (stored, true);
        drop(progress);
        self.syncer.0.changed.notify_one();
    }

    /// Returns the number of synced bytes.
    pub(super) fn synced(&self) -> u64 {
        self.syncer.progress().synced
    }

    /// Returns the time of the first message that is not synced, ns.
    pub(super) fn unsynced_since_ns(&self) -> Option<i64> {
        let synced = self.synced();
        self.waiting.iter().find(|(end, _)| *end > synced).map(|(_, since_ns)| *since_ns).or(self.since_ns)
    }

    /// Takes the next report: that syncs begin to fail, or succeed again.
    pub(super) fn news(&mut self) -> Option<io::Result<()>> {
        let mut progress = self.syncer.progress();
        let (news, synced) = (progress.news.pop_front(), progress.synced);
        drop(progress);
        while self.waiting.front().is_some_and(|(end, _)| *end <= synced) {
            self.waiting.pop_front();
        }
        news
    }

    /// Why data are not synced now; empty if all is well.
    pub(super) fn trouble(&self) -> &str {
        &self.trouble
    }

    pub(super) fn set_trouble(&mut self, trouble: String) {
        self.trouble = trouble;
    }

    /// Syncs everything, after the sync that runs already.
    pub(super) fn finish(&mut self, stored: u64) -> io::Result<()> {
        self.syncer.sync(stored)?;
        (self.since_ns, self.trouble) = (None, String::new());
        self.waiting.clear();
        Ok(())
    }
}

impl Drop for SyncRequests {
    /// Ends the thread, after the sync that it runs.
    fn drop(&mut self) {
        self.syncer.progress().has_ended = true;
        self.syncer.0.changed.notify_one();
    }
}
