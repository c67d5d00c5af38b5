//! The volume, shared by insertion and rendering. Under one lock, the inserter inserts slices,
//! and the render thread reads the changes.

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use glam::DVec3;
use serde::Serialize;

use render::Renderer;
use sonoweave_core::region::ClipRect;
use sonoweave_core::slice::Slice;
use sync::FramePose;
use sync::extent::mean_axes;
use volume::brick::EDGE;
use volume::lattice::{Canonical, canonical, shift};

use super::changes::Changes;
use super::digest::{self, ResultDigest};
use super::reach::Reach;
use crate::inserter::VolumeInserter;
use crate::{InsertedSlice, PixelKind};

/// Pending changes since the last query, and the present state of the volume.
#[derive(Default)]
pub(super) struct PendingChanges {
    /// Changes of the volume, for the renderer.
    pub(super) changes: Changes,
    /// The same for the plane viewer; `None` without a viewer, or if it has not queried since
    /// the volume was replaced.
    pub(super) aside: Option<Changes>,
    /// The same for the brick viewer.
    pub(super) for_bricks: Option<Changes>,
    /// Slices inserted so far, including those removed by clearing the volume.
    pub(super) inserted: u64,
    /// Those of them that were inserted before the last clearing.
    pub(super) cleared: u64,
    /// First and last brick of the volume.
    bounds: Option<[[i64; 3]; 2]>,
    /// Voxel spacing, mm.
    spacing_mm: [f64; 3],
    /// The last slice, and the rectangle of its data.
    pub(super) last: Option<(Slice, ClipRect)>,
    /// Capture time of its frame, host ns; `None` in a replay.
    pub(super) captured_ns: Option<i64>,
    /// Number of its frame.
    pub(super) item: u64,
    /// Its time, ns, on the stream's clock.
    pub(super) time_ns: i64,
    /// Values determined by the first slice.
    pub(super) first: Option<FirstSlice>,
    /// The box that is rendered.
    pub(super) reach: Option<Reach>,
}

/// Extent of a volume.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct VolumeExtent {
    /// Slices in it.
    pub slices: u64,
    /// Extent along its axes in voxels, a multiple of whole bricks.
    pub voxels: [u64; 3],
    /// Extent along its axes, mm.
    pub mm: [f64; 3],
}

/// Values that the first slice determines for all pictures.
#[derive(Clone, Copy)]
pub(super) struct FirstSlice {
    pub(super) lattice: Canonical,
    /// Its directions of u and v in the world.
    pub(super) slice_axes: Option<[DVec3; 2]>,
    pub(super) pixels: PixelKind,
}

impl PendingChanges {
    /// Adds a slice that was just inserted; `captured_ns` is the capture time of its frame, host
    /// ns.
    pub(super) fn note(&mut self, inserted: &InsertedSlice<'_>, captured_ns: Option<i64>) {
        let first = *self.first.get_or_insert_with(|| {
            let Slice { image, time_ns, world_from_image } = inserted.slice;
            let size = [image.width(), image.height()];
            let first = FramePose { item: inserted.item, time_ns: *time_ns, size, world_from_image: *world_from_image };
            FirstSlice {
                lattice: canonical(inserted.reconstructor.world_from_lattice()),
                slice_axes: mean_axes(&[first]),
                pixels: inserted.pixels,
            }
        });
        let mut shifted = Vec::new();
        let touched = if first.lattice.offset == [0; 3] {
            inserted.touched
        } else {
            shift(inserted.touched, first.lattice.offset, &mut shifted);
            &shifted
        };
        let slab = inserted.slab.map(|slab| slab.shifted(first.lattice.offset));
        for brick in touched {
            let [low, high] = self.bounds.get_or_insert([brick.map(i64::from); 2]);
            for (a, &at) in brick.iter().enumerate() {
                (low[a], high[a]) = (low[a].min(i64::from(at)), high[a].max(i64::from(at)));
            }
        }
        self.spacing_mm = inserted.reconstructor.settings().spacing_mm.to_array();
        for changes in [Some(&mut self.changes), self.aside.as_mut(), self.for_bricks.as_mut()].into_iter().flatten() {
            changes.note(touched, slab, inserted.upgraded);
        }
        match &mut self.reach {
            Some(reach) => drop(reach.widen(touched)),
            None => self.reach = Reach::around(touched),
        }
        self.inserted += 1;
        self.last = inserted.mask.bounds().map(|data| (inserted.slice.clone(), data));
        self.captured_ns = captured_ns;
        self.item = inserted.item;
        self.time_ns = inserted.slice.time_ns;
    }

    /// Notes that the volume is empty again. The count of slices continues, so that every client
    /// notices the next slice.
    pub(super) fn clear(&mut self) {
        *self =
            Self { inserted: self.inserted, cleared: self.inserted, changes: Changes::unknown(), ..Self::default() };
    }

    /// Returns the number of slices in the volume.
    pub(super) fn slices(&self) -> u64 {
        self.inserted - self.cleared
    }

    /// Returns the volume's extent, if it has one.
    pub(super) fn extent(&self) -> Option<VolumeExtent> {
        let [low, high] = self.bounds?;
        let voxels = std::array::from_fn(|a| (high[a] - low[a] + 1).unsigned_abs() * EDGE as u64);
        let mm = std::array::from_fn(|a| voxels[a] as f64 * self.spacing_mm[a]);
        Some(VolumeExtent { slices: self.slices(), voxels, mm })
    }
}

/// A reconstructor and its pending changes.
pub(super) struct SharedVolume {
    pub(super) inserter: VolumeInserter,
    pub(super) pending: PendingChanges,
    /// Whether no slice follows.
    pub(super) ended: bool,
    /// Whether insertion waits for the picture of all present slices.
    pub(super) awaited: bool,
    /// Whether the render thread has ended.
    picture_ended: bool,
}

/// Shared [`SharedVolume`].
pub(super) struct Shared {
    shared: Mutex<SharedVolume>,
    /// Threads that wait for the lock.
    waiting: AtomicU32,
    changed: Condvar,
}

impl Shared {
    pub(super) fn new(inserter: VolumeInserter) -> Self {
        Self {
            shared: Mutex::new(SharedVolume {
                inserter,
                pending: PendingChanges::default(),
                ended: false,
                awaited: false,
                picture_ended: false,
            }),
            waiting: AtomicU32::new(0),
            changed: Condvar::new(),
        }
    }

    /// Locks it. If a thread panicked while holding the lock, the volume is complete up to its
    /// last slice.
    pub(super) fn lock(&self) -> MutexGuard<'_, SharedVolume> {
        self.waiting.fetch_add(1, Ordering::Relaxed);
        let volume = self.shared.lock().unwrap_or_else(PoisonError::into_inner);
        self.waiting.fetch_sub(1, Ordering::Relaxed);
        volume
    }

    /// Returns whether another thread waits for the lock.
    pub(super) fn is_wanted(&self) -> bool {
        self.waiting.load(Ordering::Relaxed) > 0
    }

    /// Wakes the threads that wait for changes.
    pub(super) fn notify(&self) {
        self.changed.notify_all();
    }

    /// Waits until more than `inserted` slices are inserted, no slice follows, or the time is over.
    /// If only `certain` slices are rendered, waits until a picture of one is requested.
    pub(super) fn wait(&self, inserted: u64, certain: bool, at_most: Duration) -> MutexGuard<'_, SharedVolume> {
        let more = |shared: &mut SharedVolume| {
            let is_due = shared.pending.inserted > inserted && (shared.awaited || !certain);
            !is_due && !shared.ended
        };
        self.changed.wait_timeout_while(self.lock(), at_most, more).unwrap_or_else(PoisonError::into_inner).0
    }

    /// Waits until the picture of all present slices is rendered and shown, or the render thread
    /// has ended.
    pub(super) fn await_picture(&self) {
        let mut shared = self.lock();
        shared.awaited = true;
        self.changed.notify_all();
        let is_awaited = |shared: &mut SharedVolume| shared.awaited && !shared.picture_ended;
        let mut shared = self.changed.wait_while(shared, is_awaited).unwrap_or_else(PoisonError::into_inner);
        shared.awaited = false;
    }

    /// Reports that the picture of so many slices is shown.
    pub(super) fn shown(&self, slices: u64) {
        let mut shared = self.lock();
        if shared.pending.inserted == slices {
            shared.awaited = false;
            self.changed.notify_all();
        }
    }

    /// Reports that rendering has ended, until it is resumed.
    pub(super) fn picture_ended(&self) {
        self.lock().picture_ended = true;
        self.changed.notify_all();
    }

    /// Waits for `at_most`, or until no slice follows.
    pub(super) fn rest(&self, at_most: Duration) {
        let goes_on = |shared: &mut SharedVolume| !shared.ended;
        drop(self.changed.wait_timeout_while(self.lock(), at_most, goes_on));
    }

    /// Returns the digest of the volume and of the picture.
    pub(super) fn digest(&self, picture: Option<&Renderer>) -> ResultDigest {
        let shared = self.lock();
        ResultDigest {
            slices: shared.pending.slices(),
            volume_sha256: shared
                .inserter
                .reconstructor()
                .map(|reconstructor| digest::of_volume(reconstructor.volume())),
            picture_sha256: picture.map(digest::of_picture),
        }
    }

    /// Resumes after the end; returns the number of slices inserted.
    pub(super) fn resume(&self) -> u64 {
        let mut shared = self.lock();
        (shared.ended, shared.picture_ended) = (false, false);
        shared.pending.inserted
    }

    /// Reports that no slice follows.
    pub(super) fn end(&self) {
        self.lock().ended = true;
        self.changed.notify_all();
    }

    /// Returns the reconstructor, once no other thread shares it.
    pub(super) fn into_inner(self) -> SharedVolume {
        self.shared.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}
