//! The volume as weaving and drawing share it: a lock, under which the one inserts and the other reads what changed.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use calibration::region::ClipRect;
use glam::DVec3;
use serde::Serialize;

use super::changes::Changes;
use super::picture::Drawn;
use super::reach::Reach;
use super::seal::{self, Seal};
use crate::pipeline::loom::Loom;
use crate::pipeline::{PixelKind, Woven};
use crate::slice::Slice;
use crate::sync::FramePose;
use crate::sync::extent::mean_axes;
use crate::volume::brick::EDGE;
use crate::volume::lattice::{Canonical, canonical, shift};

/// What changed since somebody last asked, and what there is to see now.
#[derive(Default)]
pub(super) struct News {
    /// Of the volume, for who draws it.
    pub(super) changes: Changes,
    /// The same for who looks at planes; `None` where nobody does, or not since the volume is this one.
    pub(super) aside: Option<Changes>,
    /// Slices that were woven, whether they are in the volume or it was cleared since.
    pub(super) woven: u64,
    /// Of these, those before it was cleared last.
    pub(super) cleared: u64,
    /// First and last brick of the volume.
    bounds: Option<[[i64; 3]; 2]>,
    /// Distances of its voxels, mm.
    spacing_mm: [f64; 3],
    /// The slice that came last, and the rectangle of its data.
    pub(super) last: Option<(Slice, ClipRect)>,
    /// When its frame was captured, host ns; `None` of a recording.
    pub(super) captured_ns: Option<i64>,
    /// Its number.
    pub(super) item: u64,
    /// What the first slice has settled.
    pub(super) begun: Option<Begun>,
    /// The box that pictures are of.
    pub(super) reach: Option<Reach>,
}

/// How large a volume is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Bulk {
    /// Slices in it.
    pub slices: u64,
    /// Voxels along its axes, in whole bricks,
    pub voxels: [u64; 3],
    /// and millimetres.
    pub mm: [f64; 3],
}

/// What the first slice settles for all pictures.
#[derive(Clone, Copy)]
pub(super) struct Begun {
    pub(super) lattice: Canonical,
    /// Its directions of u and v in the world.
    pub(super) slice_axes: Option<[DVec3; 2]>,
    pub(super) pixels: PixelKind,
}

impl News {
    /// Takes note of a slice that has just been woven; its frame was captured at a host time.
    pub(super) fn note(&mut self, woven: &Woven<'_>, captured_ns: Option<i64>) {
        let begun = *self.begun.get_or_insert_with(|| {
            let Slice { image, time_ns, world_from_image } = woven.slice;
            let size = [image.width(), image.height()];
            let first = FramePose { item: woven.item, time_ns: *time_ns, size, world_from_image: *world_from_image };
            Begun {
                lattice: canonical(woven.weaver.world_from_lattice()),
                slice_axes: mean_axes(&[first]),
                pixels: woven.pixels,
            }
        });
        let mut shifted = Vec::new();
        let touched = if begun.lattice.offset == [0; 3] {
            woven.touched
        } else {
            shift(woven.touched, begun.lattice.offset, &mut shifted);
            &shifted
        };
        for brick in touched {
            let [low, high] = self.bounds.get_or_insert([brick.map(i64::from); 2]);
            for (a, &at) in brick.iter().enumerate() {
                (low[a], high[a]) = (low[a].min(i64::from(at)), high[a].max(i64::from(at)));
            }
        }
        self.spacing_mm = woven.weaver.settings().spacing_mm.to_array();
        for changes in [Some(&mut self.changes), self.aside.as_mut()].into_iter().flatten() {
            changes.note(touched, woven.upgraded);
        }
        match &mut self.reach {
            Some(reach) => drop(reach.widen(touched)),
            None => self.reach = Reach::around(touched),
        }
        self.woven += 1;
        self.last = woven.mask.bounds().map(|data| (woven.slice.clone(), data));
        self.captured_ns = captured_ns;
        self.item = woven.item;
    }

    /// The volume is empty again. Slices are counted on, so that whoever has seen so many notices the next.
    pub(super) fn clear(&mut self) {
        *self = Self { woven: self.woven, cleared: self.woven, changes: Changes::unknown(), ..Self::default() };
    }

    /// Slices in the volume.
    pub(super) fn slices(&self) -> u64 {
        self.woven - self.cleared
    }

    /// The volume's extent, where there is one.
    pub(super) fn bulk(&self) -> Option<Bulk> {
        let [low, high] = self.bounds?;
        let voxels = std::array::from_fn(|a| (high[a] - low[a] + 1).unsigned_abs() * EDGE as u64);
        let mm = std::array::from_fn(|a| voxels[a] as f64 * self.spacing_mm[a]);
        Some(Bulk { slices: self.slices(), voxels, mm })
    }
}

/// A loom and its news.
pub(super) struct Fabric {
    pub(super) loom: Loom,
    pub(super) news: News,
    /// No slice follows.
    pub(super) ended: bool,
    /// Weaving waits for the picture of all slices that there are.
    pub(super) awaited: bool,
    /// Nobody draws any more.
    undrawn: bool,
}

/// [`Fabric`], shared.
pub(super) struct Shared {
    fabric: Mutex<Fabric>,
    changed: Condvar,
}

impl Shared {
    pub(super) fn new(loom: Loom) -> Self {
        Self {
            fabric: Mutex::new(Fabric { loom, news: News::default(), ended: false, awaited: false, undrawn: false }),
            changed: Condvar::new(),
        }
    }

    /// Alone with it. A thread that died with it leaves a volume that is whole up to its last slice.
    pub(super) fn lock(&self) -> MutexGuard<'_, Fabric> {
        self.fabric.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tells who waits that there is something new.
    pub(super) fn tell(&self) {
        self.changed.notify_all();
    }

    /// Waits until more slices than so many are woven, no slice follows, or the time is over; where pictures are of certain slices only, until one of them is wanted.
    pub(super) fn wait(&self, woven: u64, certain: bool, at_most: Duration) -> MutexGuard<'_, Fabric> {
        let more = |fabric: &mut Fabric| {
            let is_wanted = fabric.news.woven > woven && (fabric.awaited || !certain);
            !is_wanted && !fabric.ended
        };
        self.changed.wait_timeout_while(self.lock(), at_most, more).unwrap_or_else(PoisonError::into_inner).0
    }

    /// Waits until the picture of all slices that there are is drawn and shown, or nobody draws.
    pub(super) fn await_picture(&self) {
        let mut fabric = self.lock();
        fabric.awaited = true;
        self.changed.notify_all();
        let is_awaited = |fabric: &mut Fabric| fabric.awaited && !fabric.undrawn;
        let mut fabric = self.changed.wait_while(fabric, is_awaited).unwrap_or_else(PoisonError::into_inner);
        fabric.awaited = false;
    }

    /// The picture of so many slices is shown.
    pub(super) fn shown(&self, slices: u64) {
        let mut fabric = self.lock();
        if fabric.news.woven == slices {
            fabric.awaited = false;
            self.changed.notify_all();
        }
    }

    /// Nobody draws any more, until it is gone on.
    pub(super) fn undrawn(&self) {
        self.lock().undrawn = true;
        self.changed.notify_all();
    }

    /// Waits for so long, or until no slice follows.
    pub(super) fn rest(&self, at_most: Duration) {
        let goes_on = |fabric: &mut Fabric| !fabric.ended;
        drop(self.changed.wait_timeout_while(self.lock(), at_most, goes_on));
    }

    /// What there is, in a line.
    pub(super) fn seal(&self, drawn: Option<&Drawn>) -> Seal {
        let fabric = self.lock();
        Seal {
            slices: fabric.news.slices(),
            volume_sha256: fabric.loom.weaver().map(|weaver| seal::of_volume(weaver.volume())),
            picture_sha256: drawn.map(|drawn| seal::of_picture(&drawn.renderer)),
        }
    }

    /// What had ended goes on: how many slices there are.
    pub(super) fn goes_on(&self) -> u64 {
        let mut fabric = self.lock();
        (fabric.ended, fabric.undrawn) = (false, false);
        fabric.news.woven
    }

    /// Who looks at what goes on no longer is to end.
    pub(super) fn is_over(&self) {
        self.lock().ended = true;
        self.changed.notify_all();
    }

    /// The loom, when all who shared it are gone.
    pub(super) fn into_inner(self) -> Fabric {
        self.fabric.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}
