//! The incremental reconstructor: `insert(slice)` returns the touched bricks. The volume is
//! valid after every insert.

use std::sync::Arc;

use mask::Mask;
use simd::sharing::Sharing;
use sonoweave_core::frames::{Transform, Volume, World};
use sonoweave_core::slice::Slice;
use volume::brick::BrickIndex;
use volume::brick_volume::Epoch;
use volume::{BrickVolume, Prism, Voxels};

use super::admission::Admission;
use super::compounding::{Compounding, Entry, StampClock};
use super::decay::DecayClock;
use super::falloff::Falloff;
use super::filter::{FilterWork, SliceFilter};
use super::kernel::AxisKernel;
use super::nodes::Nodes;
use super::plan::{BrickChunk, Plan, insert_all};
pub use super::refusal::Refused;
use super::sampling::Sampling;
use super::settings::{Settings, SettingsError};
use super::slab::{MaskSummary, SlabGeometry};
use super::spline::Taps;
use super::task::{FilteredSlice, Rule, SliceTime, Task};

/// Pixel sizes that differ by less than this, relatively, use the same filter.
pub(super) const SAME_PIXEL: f64 = 1e-3;

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
    /// Slices whose time was earlier than the newest before them.
    pub times_backwards: u64,
    /// Slices whose time was more than a day after the newest before them, or more than ten
    /// seconds before it.
    pub times_absurd: u64,
}

/// Data that depends on the pixel size.
struct Prepared {
    pixel_mm: [f64; 2],
    kernels: [AxisKernel; 3],
    filter: SliceFilter,
    certainty: Nodes,
    mask: MaskSummary,
    rule: Rule,
}

/// Inserts slices into a sparse volume. One instance per volume, not shared between threads; it
/// starts its own.
pub struct Reconstructor {
    settings: Settings,
    mask: Mask,
    pool: Option<Arc<rayon::ThreadPool>>,
    prepared: Option<Prepared>,
    volume: BrickVolume,
    admission: Admission,
    stamps: StampClock,
    clock: DecayClock,
    plan: Plan,
    chunks: Vec<BrickChunk>,
    work: Work,
}

impl Reconstructor {
    /// Creates it for images of the mask's size, with data inside the mask.
    ///
    /// # Errors
    /// [`SettingsError`] when the settings cannot work for any slice.
    pub fn new(settings: Settings, mask: Mask) -> Result<Self, SettingsError> {
        settings.check(&mask)?;
        let pool = settings.pool()?;
        let mut volume = BrickVolume::remembering(Entry::of(settings.compounding)?.memory());
        volume.reserve(1).map_err(|e| SettingsError::Memory(e.to_string()))?;
        Ok(Self {
            settings,
            mask,
            pool,
            prepared: None,
            volume,
            admission: Admission::default(),
            stamps: StampClock::default(),
            clock: DecayClock::default(),
            plan: Plan::default(),
            chunks: Vec::new(),
            work: Work::default(),
        })
    }

    /// Like [`Self::new`], but continues a volume that another path began on the same lattice,
    /// with its last slice and the work done.
    pub(super) fn taking_over(
        settings: Settings,
        mask: Mask,
        volume: BrickVolume,
        admission: Admission,
        clock: DecayClock,
        work: Work,
    ) -> Result<Self, SettingsError> {
        Ok(Self { volume, admission, clock, work, ..Self::new(settings, mask)? })
    }

    /// The volume so far.
    pub fn volume(&self) -> &BrickVolume {
        &self.volume
    }

    /// Maps voxel indices to world mm.
    pub fn world_from_lattice(&self) -> Transform<World, Volume> {
        Transform::from_affine(self.settings.world_from_lattice())
    }

    /// The settings in use.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Kernels along u, v and the normal, once the first slice has given the pixel size.
    pub fn kernels(&self) -> Option<&[AxisKernel; 3]> {
        self.prepared.as_ref().map(|p| &p.kernels)
    }

    /// Pixel size along u and v in mm, once known.
    pub fn pixel_mm(&self) -> Option<[f64; 2]> {
        self.prepared.as_ref().map(|p| p.pixel_mm)
    }

    /// Node spacing of the filtered image in pixels, and the bound on its samples' deviation
    /// from the exact in-plane sum as a fraction of the image's range. `None` before the first
    /// slice.
    pub fn decimation(&self) -> Option<([f64; 2], f64)> {
        self.prepared.as_ref().map(|p| (p.filter.step_px(), p.filter.deviation()))
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
        self.settings.check(&mask)?;
        let before = (std::mem::replace(&mut self.mask, mask), self.prepared.take());
        let Some(pixel_mm) = before.1.as_ref().map(|prepared| prepared.pixel_mm) else { return Ok(()) };
        let made = Sharing::within(self.pool.clone().as_deref(), |sharing| self.prepare(pixel_mm, sharing));
        if made.is_err() {
            (self.mask, self.prepared) = before;
        }
        made
    }

    /// Inserts a slice into the volume.
    ///
    /// # Errors
    /// [`Refused`] with the reason; nothing has changed then.
    pub fn insert(&mut self, slice: &Slice) -> Result<Touched, Refused> {
        Sharing::within(self.pool.clone().as_deref(), |sharing| self.insert_with(slice, sharing))
    }

    fn insert_with(&mut self, slice: &Slice, sharing: Sharing) -> Result<Touched, Refused> {
        let plane = self.admission.check(slice, &self.mask)?;
        let stamp = match self.settings.compounding {
            Compounding::Latest => self.stamps.stamp(slice.time_ns).ok_or(Refused::OutOfTime)?,
            _ => 0,
        };
        let clock = self.clock.after(slice.time_ns);
        let time = SliceTime { stamp, elapsed_ns: clock.elapsed_ns() };
        self.prepare(plane.pixel_mm, sharing)?;
        let Some(prepared) = &mut self.prepared else { return Err(SettingsError::EmptyMask.into()) };

        let normal = prepared.kernels[2];
        let image_from_lattice = plane.image_from_world * self.settings.world_from_lattice();
        let (filter, certainty, mask) = (&mut prepared.filter, &prepared.certainty, &prepared.mask);
        let step = filter.step_px();
        let geometry = SlabGeometry::new(image_from_lattice, certainty, step, normal.sigma_mm, normal.support_mm);
        let simd = self.settings.simd;
        let rule = prepared.rule;

        // Finding bricks and filtering the image are independent.
        let (plan, volume) = (&mut self.plan, &self.volume);
        let limit_bytes = self.settings.memory_bytes;
        let (planned, ()) = sharing.both(
            || {
                let filtered = FilteredSlice::new(certainty, 0.0, certainty, time, rule);
                plan.find(&geometry, mask, volume, &filtered, simd, limit_bytes)
            },
            || filter.filter(&slice.image, sharing),
        );
        planned?;
        let new = self.plan.absent.len();
        if self.volume.reserve(new).is_err() {
            return Err(Refused::Memory { needed: new as u64, limit_bytes: self.volume.bytes() });
        }

        for (task, index) in &self.plan.absent {
            self.plan.tasks[*task].slot = self.volume.find_or_insert(*index).0;
        }
        let filtered = FilteredSlice::new(&filter.value, filter.level, certainty, time, rule);
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
        let sum = |f: fn(&Task) -> u32| tasks.iter().map(|t| u64::from(f(t))).sum::<u64>();
        self.work.slices += 1;
        self.work.filter.pixels += filter.work.pixels;
        self.work.filter.nodes += filter.work.nodes;
        self.work.filter.taps += filter.work.taps;
        self.work.bricks_considered += self.plan.considered;
        self.work.bricks_touched += touched.bricks.len() as u64;
        self.work.voxels_sampled += sum(|t| t.vectors) * simd::LANES as u64;
        self.work.voxels_updated += touched.voxels;
        self.work.weights_clamped += sum(|t| t.clamped);
        self.admission.entered(slice);
        self.stamps.start(slice.time_ns);
        self.clock = clock;
        (self.work.times_backwards, self.work.times_absurd) = (clock.backwards, clock.absurd);
        Ok(touched)
    }

    /// Creates kernels and filter for a pixel size, unless the present ones fit.
    fn prepare(&mut self, pixel_mm: [f64; 2], sharing: Sharing) -> Result<(), SettingsError> {
        let same = |p: &Prepared| (0..2).all(|a| (p.pixel_mm[a] / pixel_mm[a] - 1.0).abs() <= SAME_PIXEL);
        if self.prepared.as_ref().is_some_and(same) {
            return Ok(());
        }
        let (settings, kernels) = (&self.settings, self.settings.kernels(pixel_mm)?);
        let method = settings.method;
        let design = |axis: usize, name: char| {
            if method.interpolates() {
                return Ok(Taps::identity());
            }
            Taps::design(&kernels[axis], pixel_mm[axis]).map_err(|source| SettingsError::Spline { axis: name, source })
        };
        let taps = [design(0, 'u')?, design(1, 'v')?];
        let rule = Rule {
            sampling: Sampling::of(method),
            falloff: Falloff::new(&kernels[2]),
            entry: Entry::of(settings.compounding)?,
            most_weight: (settings.max_weight * kernels[2].peak()) as f32,
        };
        // Half a pixel to the border of the data, plus one σ: from 0.84 σ on, too little of the
        // kernel lies on data.
        let margin = [0, 1].map(|a| (kernels[a].sigma_mm / pixel_mm[a]).min(kernels[a].support_mm / pixel_mm[a]) + 0.5);
        let mut filter = SliceFilter::new(settings.simd, taps, self.mask.clone(), margin)?;
        let certainty = filter.certainty(sharing);
        let mask = MaskSummary::new(&certainty);
        self.prepared = Some(Prepared { pixel_mm, kernels, filter, certainty, mask, rule });
        Ok(())
    }
}
