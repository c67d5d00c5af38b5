//! The incremental reconstructor: `insert(slice)` returns the touched bricks. The volume is
//! valid after every insert.

use std::sync::Arc;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use mask::Mask;
use simd::sharing::Sharing;
use simd::team::Team;
use sonoweave_core::frames::{Transform, Volume, World};
use sonoweave_core::slice::Slice;
use volume::brick::{BrickBox, BrickIndex};
use volume::memory::Epoch;
use volume::{BrickVolume, Prism, Voxels};

use super::admission::Admission;
use super::compounding::Entry;
use super::decay::DecayClock;
use super::filter::FilterWork;
use super::kernel::AxisKernel;
use super::normals::Normals;
use super::plan::{BrickChunk, Plan, insert_all};
pub use super::refusal::{Refused, RepeatError};
use super::settings::{Settings, SettingsError};
use super::slab::Plane;
use super::stream::{Decision, Stream};
use super::task::{FilteredSlice, Task};

/// Changes made by an insert.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Touched {
    /// Bricks in which at least one voxel gained weight, in the lattice's order.
    pub bricks: Vec<BrickIndex>,
    /// Voxels that gained weight.
    pub voxels: u64,
    /// Region of those voxels in lattice indices: the slice's rectangle with its kernel's
    /// support. `None` if other voxels of the bricks may have changed too.
    pub slab: Option<Prism>,
}

/// Work done so far, to prove which work was skipped.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Work {
    /// Slices inserted.
    pub slices: u64,
    /// In-plane filtering.
    pub filter: FilterWork,
    /// Bricks that interval tests could not exclude.
    pub bricks_considered: u64,
    /// Bricks in which a voxel gained weight, summed over slices.
    pub bricks_touched: u64,
    /// Columns of those bricks, on the planar path.
    pub columns_considered: u64,
    /// Columns that gained weight, summed over slices, on the planar path.
    pub columns_touched: u64,
    /// Voxels sampled, in whole vectors.
    pub voxels_sampled: u64,
    /// Voxels that gained weight, summed over slices.
    pub voxels_updated: u64,
    /// Voxels whose weight was clamped, summed over slices.
    pub weights_clamped: u64,
    /// Slices whose picture told nothing of [shadows](super::shadow_weights), so that all its
    /// pixels counted in full.
    pub without_shadows: u64,
    /// Slices whose time was earlier than the newest before them.
    pub times_backwards: u64,
    /// Slices whose time was more than a day after the newest before them, or more than ten
    /// seconds before it.
    pub times_absurd: u64,
}

impl std::ops::AddAssign for Work {
    fn add_assign(&mut self, other: Self) {
        let Self { filter, .. } = other;
        self.slices += other.slices;
        self.filter.pixels += filter.pixels;
        self.filter.nodes += filter.nodes;
        self.filter.taps += filter.taps;
        self.bricks_considered += other.bricks_considered;
        self.bricks_touched += other.bricks_touched;
        self.columns_considered += other.columns_considered;
        self.columns_touched += other.columns_touched;
        self.voxels_sampled += other.voxels_sampled;
        self.voxels_updated += other.voxels_updated;
        self.weights_clamped += other.weights_clamped;
        self.without_shadows += other.without_shadows;
        self.times_backwards += other.times_backwards;
        self.times_absurd += other.times_absurd;
    }
}

/// Least work for which threads that sleep are woken: some 0.3 ms. Waking them costs a tenth of
/// that. The unit is the work of a pixel of data, 1 ns on a slow processor.
const LEAST_WAKING: u64 = 300_000;
/// Work of a voxel that is sampled.
const VOXEL_WORK: u64 = 5;

/// Inserts slices into a sparse volume. One instance per volume, not shared between threads; it
/// starts its own.
pub struct Reconstructor {
    stream: Stream,
    team: Option<Arc<Team>>,
    volume: BrickVolume,
    plan: Plan,
    chunks: Vec<BrickChunk>,
    work: Work,
    /// Voxels that the last slice sampled. The next one mostly meets about as many.
    sampled: u64,
    last: Option<Entered>,
    normals: Normals,
}

/// A slice that was inserted, with all that is needed to insert it into another part of the
/// volume.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Entered {
    /// Decisions about it that depend on the slices before it.
    pub decision: Decision,
    /// Box around the bricks that it may change, in the region or not.
    pub bricks: BrickBox,
}

impl Reconstructor {
    /// Creates it for images of the mask's size, with data inside the mask.
    ///
    /// # Errors
    /// [`SettingsError`] when the settings cannot work for any slice.
    pub fn new(settings: Settings, mask: Mask) -> Result<Self, SettingsError> {
        settings.check(&mask)?;
        let team = settings.team()?;
        let mut volume = BrickVolume::remembering(settings.entry()?.memory());
        volume.reserve(1).map_err(|e| SettingsError::Memory(e.to_string()))?;
        let (stream, plan, chunks) = (Stream::new(settings, mask), Plan::default(), Vec::new());
        let (work, last, normals) = (Work::default(), None, Normals::NONE);
        Ok(Self { stream, team, volume, plan, chunks, work, sampled: 0, last, normals })
    }

    /// Returns a copy that continues by itself; neither changes with the other. They share threads.
    ///
    /// # Errors
    /// When the system has no memory to give.
    pub fn copy(&self) -> std::io::Result<Self> {
        let (team, volume) = (self.team.clone(), self.volume.copy()?);
        let (stream, plan, chunks) = (self.stream.clone(), Plan::default(), Vec::new());
        let Self { work, sampled, last, normals, .. } = *self;
        Ok(Self { stream, team, volume, plan, chunks, work, sampled, last, normals })
    }

    /// Like [`Self::new`], but continues a volume that another path began on the same lattice,
    /// with its last slice and the work done.
    pub(super) fn taking_over(
        settings: Settings,
        mask: Mask,
        volume: BrickVolume,
        admission: Admission,
        clock: DecayClock,
        (work, normals): (Work, Normals),
    ) -> Result<Self, SettingsError> {
        let new = Self::new(settings, mask)?;
        Ok(Self { stream: new.stream.after(admission, clock), volume, work, normals, ..new })
    }

    /// The volume so far.
    pub fn volume(&self) -> &BrickVolume {
        &self.volume
    }

    /// Maps voxel indices to world mm.
    pub fn world_from_lattice(&self) -> Transform<World, Volume> {
        Transform::from_affine(self.stream.settings.world_from_lattice())
    }

    /// The settings in use.
    pub fn settings(&self) -> &Settings {
        &self.stream.settings
    }

    /// Kernels along u, v and the normal, once the first slice has given the pixel size.
    pub fn kernels(&self) -> Option<&[AxisKernel; 3]> {
        self.stream.prepared.as_ref().map(|p| &p.kernels)
    }

    /// Pixel size along u and v in mm, once known.
    pub fn pixel_mm(&self) -> Option<[f64; 2]> {
        self.stream.prepared.as_ref().map(|p| p.pixel_mm)
    }

    /// Node spacing of the filtered image in pixels, and the bound on its samples' deviation
    /// from the exact in-plane sum as a fraction of the image's range. `None` before the first
    /// slice.
    pub fn decimation(&self) -> Option<([f64; 2], f64)> {
        self.stream.prepared.as_ref().map(|p| (p.filter.step_px(), p.filter.deviation()))
    }

    /// The directions of the slices inserted.
    pub(super) fn normals(&self) -> &Normals {
        &self.normals
    }

    /// Work done so far.
    pub fn work(&self) -> Work {
        self.work
    }

    /// Changes the mask of later slices; what is in the volume stays.
    ///
    /// # Errors
    /// [`SettingsError`] when the settings cannot work with this mask; nothing has changed then.
    pub fn set_mask(&mut self, mask: Mask) -> Result<(), SettingsError> {
        self.stream.set_mask(mask, Sharing::of(self.team.as_deref()))
    }

    /// Returns the slice that was inserted last.
    pub fn last(&self) -> Option<Entered> {
        self.last
    }

    /// Inserts a slice into the volume.
    ///
    /// # Errors
    /// [`Refused`] with the reason; nothing has changed then.
    pub fn insert(&mut self, slice: &Slice) -> Result<Touched, Refused> {
        self.insert_weighted(slice, 1.0)
    }

    /// The same with a weight of the whole slice, by the [gaps](super::gap_weights) beside it.
    ///
    /// # Errors
    /// [`Refused`] with the reason; nothing has changed then.
    pub fn insert_weighted(&mut self, slice: &Slice, weight: f32) -> Result<Touched, Refused> {
        let team = self.team.clone();
        self.insert_with(slice, weight, self.sharing(team.as_deref()))
    }

    /// Inserts a slice as the stream that has seen all slices decided about it.
    ///
    /// # Errors
    /// [`RepeatError`] with the reason; nothing has changed then.
    pub fn insert_decided(&mut self, slice: &Slice, decision: &Decision) -> Result<Touched, RepeatError> {
        let team = self.team.clone();
        let sharing = self.sharing(team.as_deref());
        let plane = self.stream.repeat(slice, decision, sharing)?;
        Ok(self.enter(slice, &plane, decision, sharing)?)
    }

    /// Returns how a slice is shared with a team.
    pub(super) fn sharing<'t>(&self, team: Option<&'t Team>) -> Sharing<'t> {
        let work = self.stream.mask.area() + VOXEL_WORK * self.sampled;
        if work < LEAST_WAKING { Sharing::with_awake(team) } else { Sharing::of(team) }
    }

    fn insert_with(&mut self, slice: &Slice, weight: f32, sharing: Sharing) -> Result<Touched, Refused> {
        let decided = self.stream.decide(slice, weight, sharing)?;
        let touched = self.enter(slice, &decided.plane, &decided.decision, sharing)?;
        self.stream.entered(slice, &decided);
        let clock = &self.stream.clock;
        (self.work.times_backwards, self.work.times_absurd) = (clock.backwards, clock.absurd);
        Ok(touched)
    }

    /// Enters a slice into the bricks of the region.
    fn enter(
        &mut self,
        slice: &Slice,
        plane: &Plane,
        decision: &Decision,
        sharing: Sharing,
    ) -> Result<Touched, Refused> {
        let settings = &self.stream.settings;
        let (simd, limit_bytes, region) = (settings.simd, settings.memory_bytes, settings.region);
        let Some(prepared) = &mut self.stream.prepared else { return Err(SettingsError::EmptyMask.into()) };
        let geometry = prepared.slab(plane, settings);
        let reached = geometry.brick_box().ok_or(Refused::OutOfRange)?;
        let entered = Entered { decision: *decision, bricks: reached };
        let bricks = region.map_or(reached, |region| reached.within(&region));
        if bricks.is_empty() {
            self.last = Some(entered);
            self.work.slices += 1;
            return Ok(Touched::default());
        }
        let (filter, certainty, mask) = (&mut prepared.filter, &prepared.certainty, &prepared.mask);
        let shadows = &mut prepared.shadows;
        let (rule, time, weight) = (prepared.rule, decision.time(), decision.weight);

        // Finding bricks and filtering the image are independent.
        let (plan, volume) = (&mut self.plan, &self.volume);
        let (planned, pixel_weights) = sharing.both(
            || {
                let filtered = FilteredSlice::new(certainty, 0.0, certainty, (time, weight), rule);
                plan.find(&geometry, &bricks, mask, volume, &filtered, simd, limit_bytes)
            },
            || {
                filter.filter(&slice.image, sharing);
                shadows.as_mut().map(|shadows| shadows.of(&slice.image, simd, sharing))
            },
        );
        planned?;
        let new = self.plan.absent.len();
        if self.volume.reserve(new).is_err() {
            return Err(Refused::Memory { needed: new as u64, limit_bytes: self.volume.bytes() });
        }

        for (task, index) in &self.plan.absent {
            self.plan.tasks[*task].slot = self.volume.find_or_insert(*index).0;
        }
        let filtered = FilteredSlice::new(&filter.value, filter.level, certainty, (time, weight), rule)
            .with_pixel_weights(pixel_weights.flatten());
        let tasks = &mut self.plan.tasks;
        if let Entry::Decay(_) = rule.entry {
            for (task, _) in &self.plan.absent {
                self.volume.set_epoch(tasks[*task].slot, Epoch::at(time.elapsed_ns));
            }
        }
        insert_all(&mut self.volume, &mut self.chunks, tasks, &filtered, simd, sharing);

        // If older values fade, reading a brick anew may change its other voxels too.
        let fades = matches!(rule.entry, Entry::Decay(_));
        let slab = if fades { None } else { geometry.prism() };
        let mut touched = Touched { slab, ..Touched::default() };
        if let Entry::Decay(_) = rule.entry {
            for task in tasks.iter() {
                let change = rule.entry.epoch_change(&self.volume, task.slot, time.elapsed_ns);
                if task.updated > 0 || change.moves() {
                    self.volume.set_epoch(task.slot, change.epoch);
                }
            }
        }
        for task in tasks.iter().filter(|t| t.updated > 0) {
            touched.bricks.push(self.volume.place(task.slot));
            touched.voxels += u64::from(task.updated);
        }
        let [x, y, z] = [0, 1, 2].map(|axis| plane.image_from_world.matrix3.col(axis).z);
        self.normals.add(self.stream.settings.lattice_direction.transpose() * DVec3::new(x, y, z));
        let sum = |f: fn(&Task) -> u32| tasks.iter().map(|t| u64::from(f(t))).sum::<u64>();
        self.last = Some(entered);
        self.work.slices += 1;
        self.work.filter.pixels += filter.work.pixels;
        self.work.filter.nodes += filter.work.nodes;
        self.work.filter.taps += filter.work.taps;
        self.work.bricks_considered += self.plan.considered;
        self.work.bricks_touched += touched.bricks.len() as u64;
        self.sampled = sum(|t| t.vectors) * simd::LANES as u64;
        self.work.voxels_sampled += self.sampled;
        self.work.voxels_updated += touched.voxels;
        self.work.weights_clamped += sum(|t| t.clamped);
        self.work.without_shadows += u64::from(matches!(pixel_weights, Some(None)));
        Ok(touched)
    }
}
