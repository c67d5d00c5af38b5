//! Hands pending changes from a session to the server: the newest of each kind, behind a lock
//! held only while a pointer is stored.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::Notify;

use drivers::openigtlink::Status;
use pipeline::Observer;
use pipeline::live::{Reader, Snapshot, Wants};
use sonoweave_core::slice::Slice;
use sync::history::PoseSample;

use super::VOLUME_EVERY;

/// Largest data rate of volumes, bytes per second: larger volumes are sent less often.
const VOLUME_RATE: f64 = 20e6;
/// Shortest interval of requested volumes.
const ASKED_EVERY: Duration = Duration::from_millis(200);
/// Largest volume, bytes.
const MOST_BYTES: u64 = 1 << 28;
/// Largest number of voxels along an axis, by the protocol.
const MOST_VOXELS: u64 = u16::MAX as u64;
/// Largest number of sensors.
const SENSORS: usize = 64;

/// Pending changes.
#[derive(Default)]
struct HubChanges {
    world: String,
    slice: Option<(u64, Slice)>,
    /// By name; and whether the pose is new.
    poses: BTreeMap<String, (PoseSample, bool)>,
    volume: Option<Result<Snapshot, String>>,
    status: Option<(u16, String)>,
}

/// Changes handed to the server.
#[derive(Default)]
pub(super) struct Taken {
    pub(super) world: String,
    pub(super) slice: Option<(u64, Slice)>,
    pub(super) poses: BTreeMap<String, (PoseSample, bool)>,
    pub(super) volume: Option<Result<Snapshot, String>>,
    pub(super) status: Option<(u16, String)>,
}

/// Connects a session and the server.
pub struct Hub {
    news: Mutex<HubChanges>,
    pub(super) told: Notify,
    /// Volumes received from the session, requested or not.
    pub(super) volumes: AtomicU64,
    /// Clients that receive volumes as they change.
    pub(super) watchers: AtomicUsize,
    asked: AtomicBool,
    /// Earliest time of the next volume without request, and with one.
    next_volume: Mutex<[Instant; 2]>,
    replaced: AtomicU64,
}

impl Default for Hub {
    fn default() -> Self {
        Self {
            news: Mutex::default(),
            told: Notify::new(),
            volumes: AtomicU64::new(0),
            watchers: AtomicUsize::new(0),
            asked: AtomicBool::new(false),
            next_volume: Mutex::new([Instant::now(); 2]),
            replaced: AtomicU64::new(0),
        }
    }
}

impl std::fmt::Debug for Hub {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Hub").field("volumes", &self.volumes).field("replaced", &self.replaced).finish_non_exhaustive()
    }
}

impl Hub {
    /// Creates an empty hub.
    pub fn new() -> Self {
        Self::default()
    }

    fn news(&self) -> MutexGuard<'_, HubChanges> {
        self.news.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets the status: whether the session goes well, and a sentence.
    pub fn tell(&self, is_ready: bool, sentence: &str) {
        let code = if is_ready { Status::OK } else { Status::NOT_READY };
        self.news().status = Some((code, sentence.to_owned()));
    }

    /// Returns the number of slices replaced by the next before they were sent.
    pub fn replaced(&self) -> u64 {
        self.replaced.load(Ordering::Relaxed)
    }

    /// Requests a volume, changed or not.
    pub(super) fn ask(&self) {
        self.asked.store(true, Ordering::Relaxed);
    }

    /// Takes the pending changes. Poses and the status stay available for requests.
    pub(super) fn take(&self) -> Taken {
        let mut news = self.news();
        let poses = news.poses.clone();
        news.poses.values_mut().for_each(|(_, is_new)| *is_new = false);
        let (world, status) = (news.world.clone(), news.status.clone());
        Taken { world, slice: news.slice.take(), poses, volume: news.volume.take(), status }
    }
}

impl Observer for Hub {
    fn slice(&self, world: &str, item: u64, slice: &Slice) {
        let mut news = self.news();
        if news.world != world {
            world.clone_into(&mut news.world);
        }
        let replaced = news.slice.replace((item, slice.clone())).is_some();
        drop(news);
        self.replaced.fetch_add(u64::from(replaced), Ordering::Relaxed);
        self.told.notify_one();
    }

    fn pose(&self, [from, to]: [&str; 2], sample: &PoseSample) {
        let name = sonoweave_core::reading::transform_name(from, to);
        let mut news = self.news();
        if news.poses.len() < SENSORS || news.poses.contains_key(&name) {
            news.poses.insert(name, (sample.clone(), true));
        }
        drop(news);
        self.told.notify_one();
    }
}

impl Reader for Hub {
    fn wants(&self) -> Wants {
        let [unasked, asked] = *self.next_volume.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        // Repeated requests are all answered, but no more often than this.
        if now >= asked && self.asked.swap(false, Ordering::Relaxed) {
            return Wants::Any;
        }
        let is_due = self.watchers.load(Ordering::Relaxed) > 0 && now >= unasked;
        if is_due { Wants::Changed } else { Wants::Nothing }
    }

    fn volume(&self, volume: Result<Snapshot, String>) {
        let volume = volume.and_then(|snapshot| {
            let size = snapshot.space.grid.size;
            let fits = size.iter().all(|n| *n <= MOST_VOXELS);
            let why = || {
                format!("the volume has {size:?} voxels, but OpenIGTLink allows {MOST_VOXELS} along an axis at most")
            };
            fits.then_some(snapshot).ok_or_else(why)
        });
        let bytes = volume.as_ref().map_or(0, |snapshot| snapshot.bytes.len());
        let sending = Duration::from_secs_f64(bytes as f64 / VOLUME_RATE);
        *self.next_volume.lock().unwrap_or_else(PoisonError::into_inner) =
            [VOLUME_EVERY, ASKED_EVERY].map(|least| Instant::now() + sending.max(least));
        self.news().volume = Some(volume);
        self.volumes.fetch_add(1, Ordering::Relaxed);
        self.told.notify_one();
    }

    fn most_bytes(&self) -> u64 {
        MOST_BYTES
    }
}
