//! The incremental reconstructor: `insert(slice)` → the bricks it touched. The volume is valid after every insert.

use std::sync::Arc;

use calibration::frames::{Transform, Volume, World};

use super::admission::Admission;
use super::compounding::{Compounding, StampClock};
use super::decay::DecayClock;
use super::entry::Entry;
use super::falloff::Falloff;
use super::filter::{FilterWork, SliceFilter};
use super::kernel::AxisKernel;
use super::nodes::Nodes;
use super::plan::{BrickChunk, Plan, weave_all};
use super::planar::Departure;
use super::sampling::Sampling;
use super::settings::{Settings, SettingsError};
use super::slab::{MaskSummary, SlabGeometry};
use super::spline::Taps;
use super::weave::{Moment, Rule, Task, View};
use crate::mask::Mask;
use crate::sharing::Sharing;
use crate::slice::Slice;
use crate::volume::brick::{Brick, BrickIndex};
use crate::volume::sparse::Epoch;
use crate::volume::{BrickVolume, Prism};

/// Pixel sizes this close, relatively, use the same filter.
pub(super) const SAME_PIXEL: f64 = 1e-3;

/// Why a slice was not inserted. The volume is as before.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refused {
    /// The same picture at the same pose as the slice before: it says nothing new.
    #[error("the picture and its pose are those of the slice before")]
    Repeated,
    /// Another picture size than the mask was made for.
    #[error("the picture has {found:?} pixels; this reconstruction began with {expected:?}")]
    Size {
        /// Pixels along u and v.
        found: [u32; 2],
        /// Pixels along u and v that the reconstruction began with.
        expected: [u32; 2],
    },
    /// A pose that is no plane: not finite, or with image axes of no length or the same direction.
    #[error("the pose places no plane in the world")]
    Degenerate,
    /// A pose so far away that voxel indices would not fit.
    #[error("the slice lies beyond the lattice's 32-bit brick indices: check the poses' unit, or the voxel spacing")]
    OutOfRange,
    /// A time so far from the first slice's that the order of slices cannot be kept.
    #[error("the slice's time lies more than 59 hours from the first slice's: check the recording's time stamps")]
    OutOfTime,
    /// The volume would take more memory than allowed.
    #[error(
        "the volume would need {needed} more bricks of 8×8×8 voxels than the limit of {limit_bytes} bytes allows: choose a coarser --spacing, crop the picture, or raise --max-memory"
    )]
    Memory {
        /// Bricks beyond the limit; at least this many.
        needed: u64,
        /// The limit.
        limit_bytes: u64,
    },
    /// The slice is none that the planar path can hold.
    #[error(transparent)]
    Departure(#[from] Departure),
    /// The settings do not fit the slice's pixel size.
    #[error(transparent)]
    Settings(#[from] SettingsError),
}

impl Refused {
    /// [`Refused::Memory`] for so many bytes beyond the limit, or more.
    pub(super) fn memory(bytes: u64, limit_bytes: u64) -> Self {
        Self::Memory { needed: bytes.div_ceil(size_of::<Brick>() as u64), limit_bytes }
    }
}

/// What an insert changed.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Touched {
    /// Bricks in which at least one voxel gained weight, in the lattice's order.
    pub bricks: Vec<BrickIndex>,
    /// Voxels that gained weight.
    pub voxels: u64,
    /// Lattice indices among which those voxels are, as a slice's rectangle with its kernel's reach; `None` where other voxels of the bricks may have
    /// changed too.
    pub slab: Option<Prism>,
}

/// Work done so far, for proving what was skipped.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Work {
    /// Slices inserted.
    pub slices: u64,
    /// In-plane filtering.
    pub filter: FilterWork,
    /// Bricks that intervals could not exclude.
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
    /// Slices whose time was a day and more after the newest before them, or ten seconds and more before it.
    pub times_absurd: u64,
}

/// What depends on the pixel size.
struct Prepared {
    pixel_mm: [f64; 2],
    kernels: [AxisKernel; 3],
    filter: SliceFilter,
    certainty: Nodes,
    mask: MaskSummary,
    rule: Rule,
}

/// Weaves slices into a sparse volume. One per volume; not shared between threads, it makes its own.
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
    /// For pictures of the mask's size, with data where the mask says.
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

    /// As [`Self::new`], going on with what another path has woven on the same lattice: the volume, the slice that it ended with, and the work done.
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

    /// The lattice: voxel indices to world mm.
    pub fn world_from_lattice(&self) -> Transform<World, Volume> {
        Transform::from_affine(self.settings.world_from_lattice())
    }

    /// What it works with.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Kernels along u, v and the normal, once the first slice has told the pixel size.
    pub fn kernels(&self) -> Option<&[AxisKernel; 3]> {
        self.prepared.as_ref().map(|p| &p.kernels)
    }

    /// Pixel size along u and v in mm, once known.
    pub fn pixel_mm(&self) -> Option<[f64; 2]> {
        self.prepared.as_ref().map(|p| p.pixel_mm)
    }

    /// Node spacing of the filtered picture in pixels, and how far its samples may be from the exact in-plane sum as a fraction of the
    /// picture's range; once the first slice was seen.
    pub fn decimation(&self) -> Option<([f64; 2], f64)> {
        self.prepared.as_ref().map(|p| (p.filter.step_px(), p.filter.deviation()))
    }

    /// Work done so far.
    pub fn work(&self) -> Work {
        self.work
    }

    /// Weaves a slice into the volume.
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
        let moment = Moment { stamp, elapsed_ns: clock.elapsed_ns() };
        self.prepare(plane.pixel_mm, sharing)?;
        let Some(prepared) = &mut self.prepared else { return Err(SettingsError::EmptyMask.into()) };

        let normal = prepared.kernels[2];
        let image_from_lattice = plane.image_from_world * self.settings.world_from_lattice();
        let (filter, certainty, mask) = (&mut prepared.filter, &prepared.certainty, &prepared.mask);
        let step = filter.step_px();
        let geometry = SlabGeometry::new(image_from_lattice, certainty, step, normal.sigma_mm, normal.support_mm);
        let simd = self.settings.simd;
        let rule = prepared.rule;

        // Which bricks, and what the picture is at its nodes: neither needs the other.
        let (plan, volume) = (&mut self.plan, &self.volume);
        let limit_bytes = self.settings.memory_bytes;
        let (planned, ()) = sharing.both(
            || {
                let view = View::new(certainty, 0.0, certainty, moment, rule);
                plan.find(&geometry, mask, volume, &view, simd, limit_bytes)
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
        let view = View::new(&filter.value, filter.level, certainty, moment, rule);
        let tasks = &mut self.plan.tasks;
        if let Entry::Decay(_) = rule.entry {
            for (task, _) in &self.plan.absent {
                self.volume.set_epoch(tasks[*task].slot, Epoch::at(moment.elapsed_ns));
            }
        }
        weave_all(&mut self.volume, &mut self.chunks, tasks, &view, simd, sharing);

        // Where the past fades, reading a brick anew may change its other voxels too.
        let fades = matches!(rule.entry, Entry::Decay(_));
        let slab = if fades { None } else { geometry.prism() };
        let mut touched = Touched { slab, ..Touched::default() };
        if let Entry::Decay(_) = rule.entry {
            for task in tasks.iter() {
                let turn = rule.entry.turn(&self.volume, task.slot, moment.elapsed_ns);
                if task.updated > 0 || turn.moves() {
                    self.volume.set_epoch(task.slot, turn.epoch);
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
        self.work.voxels_sampled += sum(|t| t.vectors) * crate::simd::LANES as u64;
        self.work.voxels_updated += touched.voxels;
        self.work.weights_clamped += sum(|t| t.clamped);
        self.admission.entered(slice);
        self.stamps.start(slice.time_ns);
        self.clock = clock;
        (self.work.times_backwards, self.work.times_absurd) = (clock.backwards, clock.absurd);
        Ok(touched)
    }

    /// Makes kernels and filter for a pixel size, unless those at hand fit.
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
        // Half a pixel to the border of the data, and one σ on: from 0.84 σ on too little of the kernel lies on data.
        let margin = [0, 1].map(|a| (kernels[a].sigma_mm / pixel_mm[a]).min(kernels[a].support_mm / pixel_mm[a]) + 0.5);
        let mut filter = SliceFilter::new(settings.simd, taps, self.mask.clone(), margin)?;
        let certainty = filter.certainty(sharing);
        let mask = MaskSummary::new(&certainty);
        self.prepared = Some(Prepared { pixel_mm, kernels, filter, certainty, mask, rule });
        Ok(())
    }
}
