//! Hands pending changes from a session to the server: the newest of each kind, behind a lock
//! held only while a pointer is stored.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::Notify;

use drivers::openigtlink::Status;
use pipeline::Observer;
use pipeline::session::{NoVolume, Reader, Snapshot, VolumeRequest};
use sonoweave_core::slice::Slice;
use sync::history::PoseSample;

use super::VOLUME_EVERY;

/// Largest data rate of volumes, bytes per second: larger volumes are sent less often.
const VOLUME_RATE: f64 = 20e6;
/// Shortest interval of requested volumes.
pub(super) const REQUESTED_EVERY: Duration = Duration::from_millis(200);
/// Largest volume, bytes.
const MOST_BYTES: u64 = 1 << 28;
/// Largest number of voxels along an axis, by the protocol.
const MOST_VOXELS: u64 = u16::MAX as u64;
/// Largest number of sensors.
const SENSORS: usize = 64;

/// Changes that the server has not published yet.
#[derive(Default)]
pub(super) struct Pending {
    pub(super) world: String,
    pub(super) slice: Option<(u64, Slice)>,
    /// By name; and whether the pose is new.
    pub(super) poses: BTreeMap<String, (PoseSample, bool)>,
    pub(super) volume: Option<Result<Snapshot, String>>,
    pub(super) status: Option<(u16, String)>,
}

/// Connects a session and the server.
pub struct Hub {
    pending: Mutex<Pending>,
    pub(super) changed: Notify,
    /// Volumes received from the session, requested or not.
    pub(super) volumes: AtomicU64,
    /// Clients that receive volumes as they change.
    pub(super) watchers: AtomicUsize,
    is_requested: AtomicBool,
    /// Earliest time of the next volume without request, and with one.
    next_volume: Mutex<[Instant; 2]>,
    replaced: AtomicU64,
}

impl Default for Hub {
    fn default() -> Self {
        Self {
            pending: Mutex::default(),
            changed: Notify::new(),
            volumes: AtomicU64::new(0),
            watchers: AtomicUsize::new(0),
            is_requested: AtomicBool::new(false),
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

    fn pending(&self) -> MutexGuard<'_, Pending> {
        self.pending.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets the status: whether the session goes well, and a sentence.
    pub fn set_status(&self, is_ready: bool, sentence: &str) {
        let code = if is_ready { Status::OK } else { Status::NOT_READY };
        self.pending().status = Some((code, sentence.to_owned()));
    }

    /// Returns the number of slices replaced by the next before they were sent.
    pub fn replaced(&self) -> u64 {
        self.replaced.load(Ordering::Relaxed)
    }

    /// Requests a volume, changed or not.
    pub(super) fn request_volume(&self) {
        self.is_requested.store(true, Ordering::Relaxed);
    }

    /// Takes the pending changes. Poses and the status stay available for requests.
    pub(super) fn take_pending(&self) -> Pending {
        let mut pending = self.pending();
        let poses = pending.poses.clone();
        pending.poses.values_mut().for_each(|(_, is_new)| *is_new = false);
        let (world, status) = (pending.world.clone(), pending.status.clone());
        Pending { world, slice: pending.slice.take(), poses, volume: pending.volume.take(), status }
    }
}

impl Observer for Hub {
    fn slice(&self, world: &str, item: u64, slice: &Slice) {
        let mut pending = self.pending();
        if pending.world != world {
            world.clone_into(&mut pending.world);
        }
        let replaced = pending.slice.replace((item, slice.clone())).is_some();
        drop(pending);
        self.replaced.fetch_add(u64::from(replaced), Ordering::Relaxed);
        self.changed.notify_one();
    }

    fn pose(&self, [from, to]: [&str; 2], sample: &PoseSample) {
        let name = sonoweave_core::reading::transform_name(from, to);
        let mut pending = self.pending();
        if pending.poses.len() < SENSORS || pending.poses.contains_key(&name) {
            pending.poses.insert(name, (sample.clone(), true));
        }
        drop(pending);
        self.changed.notify_one();
    }
}

impl Reader for Hub {
    fn request(&self) -> VolumeRequest {
        let [unrequested, requested] = *self.next_volume.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        // Repeated requests are all answered, but no more often than this.
        if now >= requested && self.is_requested.swap(false, Ordering::Relaxed) {
            return VolumeRequest::Now;
        }
        let is_due = self.watchers.load(Ordering::Relaxed) > 0 && now >= unrequested;
        if is_due { VolumeRequest::IfChanged } else { VolumeRequest::None }
    }

    fn volume(&self, volume: Result<Snapshot, NoVolume>) {
        let volume = volume.map_err(|error| error.to_string()).and_then(|snapshot| {
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
            [VOLUME_EVERY, REQUESTED_EVERY].map(|least| Instant::now() + sending.max(least));
        self.pending().volume = Some(volume);
        self.volumes.fetch_add(1, Ordering::Relaxed);
        self.changed.notify_one();
    }

    fn max_bytes(&self) -> u64 {
        MOST_BYTES
    }
}
