//! The planar reconstructor: `insert(slice)` returns the touched bricks, as the general one.

use std::sync::Arc;

use mask::Mask;
use simd::sharing::Sharing;
use simd::team::Team;
use sonoweave_core::frames::{Transform, Volume, World};
use sonoweave_core::region::ClipRect;
use sonoweave_core::slice::Slice;
use volume::ColumnVolume;

use super::bands::Bands;
use super::departure::Departure;
use super::plane::{OnDeparture, PlanarSettings, ScanPlane};
use super::strip::{Lines, Plan, Strip};
use super::table::{KernelTable, RowKernel};
use crate::admission::Admission;
use crate::decay::{DecayClock, LEAST_TOUCH};
use crate::kernel::AxisKernel;
use crate::normals::Normals;
use crate::spline::SplineError;
use crate::stream::SAME_PIXEL;
use crate::{Compounding, Decay, Refused, Settings, SettingsError, Touched, Work};

/// Data fixed by the first slice.
#[derive(Clone)]
struct Scan {
    plane: ScanPlane,
    bands: Bands,
    rows: Rows,
    normal: KernelTable,
}

/// Data that depends on the distance between the image's rows.
#[derive(Clone)]
struct Rows {
    row_mm: f64,
    kernels: [AxisKernel; 3],
    kernel: RowKernel,
}

impl Rows {
    /// Creates it for rows `row_mm` apart. The kernels along u and across the slice do not
    /// depend on it.
    fn new(settings: &Settings, column_mm: f64, row_mm: f64, data: ClipRect) -> Result<Self, SettingsError> {
        let pixel_mm = [column_mm, row_mm];
        let kernels = settings.kernels(pixel_mm)?;
        for (axis, name) in ['u', 'v'].into_iter().enumerate() {
            SplineError::check(&kernels[axis], pixel_mm[axis])
                .map_err(|source| SettingsError::Spline { axis: name, source })?;
        }
        let kernel = RowKernel::new(&kernels[1], row_mm, data.height as usize);
        Ok(Self { row_mm, kernels, kernel })
    }

    fn fit(&self, row_mm: f64) -> bool {
        (self.row_mm / row_mm - 1.0).abs() <= SAME_PIXEL
    }
}

/// Least pixels of data for which threads that sleep are woken. A pixel is a quarter of the work
/// that it is for slices in any direction.
const LEAST_WAKING: u64 = 1 << 18;

/// Inserts slices that stay perpendicular to a plane into a volume of columns. One instance per
/// volume, not shared between threads; it starts its own.
pub struct PlanarReconstructor {
    pub(super) settings: Settings,
    planar: PlanarSettings,
    pub(super) mask: Mask,
    data: ClipRect,
    team: Option<Arc<Team>>,
    scan: Option<Scan>,
    pub(super) volume: ColumnVolume,
    pub(super) admission: Admission,
    pub(super) clock: DecayClock,
    plan: Plan,
    pub(super) work: Work,
    pub(super) normals: Normals,
}

impl PlanarReconstructor {
    /// Creates it for images of the mask's size, with data inside the mask. The first slice
    /// determines the lattice's direction unless the planar settings give one.
    ///
    /// # Errors
    /// [`SettingsError`] when the settings cannot work for any slice; [`SettingsError::Planar`]
    /// for a mask that is not a rectangle.
    pub fn new(settings: Settings, planar: PlanarSettings, mask: Mask) -> Result<Self, SettingsError> {
        let mut settings = settings;
        settings.lattice_direction = planar.direction.unwrap_or(settings.lattice_direction);
        settings.check(&mask)?;
        if let Some(what) = settings.beyond_planar() {
            return Err(SettingsError::BeyondPlanar(what));
        }
        if !(planar.tolerance_voxels >= 0.0 && planar.tolerance_voxels.is_finite()) {
            return Err(SettingsError::Tolerance(planar.tolerance_voxels));
        }
        let data = Departure::rectangle(&mask)?;
        let team = settings.team()?;
        let volume = ColumnVolume::new(0, Vec::new(), false);
        let (clock, plan, work) = (DecayClock::default(), Plan::default(), Work::default());
        Ok(Self {
            settings,
            planar,
            mask,
            data,
            team,
            scan: None,
            volume,
            admission: Admission::default(),
            clock,
            plan,
            work,
            normals: Normals::NONE,
        })
    }

    /// Returns a copy that continues by itself; neither changes with the other. They share threads.
    ///
    /// # Errors
    /// When the system has no memory to give.
    pub fn copy(&self) -> std::io::Result<Self> {
        Ok(Self {
            settings: self.settings.clone(),
            planar: self.planar,
            mask: self.mask.clone(),
            data: self.data,
            team: self.team.clone(),
            scan: self.scan.clone(),
            volume: self.volume.copy()?,
            admission: self.admission.clone(),
            clock: self.clock,
            plan: Plan::default(),
            work: self.work,
            normals: self.normals,
        })
    }

    /// The volume so far. Its lattice is determined by the first slice.
    pub fn volume(&self) -> &ColumnVolume {
        &self.volume
    }

    /// Maps voxel indices to world mm.
    pub fn world_from_lattice(&self) -> Transform<World, Volume> {
        Transform::from_affine(self.settings.world_from_lattice())
    }

    /// The settings in use, with the lattice's direction as found by the first slice.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Handling of a slice that leaves the plane.
    pub fn on_departure(&self) -> OnDeparture {
        self.planar.on_departure
    }

    /// Kernels along u, v and the normal, once the first slice has given the pixel size.
    pub fn kernels(&self) -> Option<&[AxisKernel; 3]> {
        self.scan.as_ref().map(|s| &s.rows.kernels)
    }

    /// Pixel size along u and v in mm, once known.
    pub fn pixel_mm(&self) -> Option<[f64; 2]> {
        self.scan.as_ref().map(|s| [s.plane.column_mm(), s.rows.row_mm])
    }

    /// The directions of the slices inserted.
    pub(crate) fn normals(&self) -> &Normals {
        &self.normals
    }

    /// Work done so far.
    pub fn work(&self) -> Work {
        self.work
    }

    /// Inserts a slice into the volume.
    ///
    /// # Errors
    /// [`Refused`] with the reason; nothing has changed then. [`Refused::Departure`] when it
    /// leaves the plane.
    pub fn insert(&mut self, slice: &Slice) -> Result<Touched, Refused> {
        let team = self.team.clone();
        let sharing = match self.mask.area() < LEAST_WAKING {
            true => Sharing::with_awake(team.as_deref()),
            false => Sharing::of(team.as_deref()),
        };
        self.insert_with(slice, sharing)
    }

    fn insert_with(&mut self, slice: &Slice, sharing: Sharing) -> Result<Touched, Refused> {
        self.admission.check(slice, &self.mask)?;
        let Some(mut scan) = self.scan.take() else { return self.insert_first(slice, sharing) };
        let result = self.insert_next(&mut scan, slice, sharing);
        self.scan = Some(scan);
        result
    }

    /// Inserts the first slice, which determines the plane; if refused, it leaves no trace.
    fn insert_first(&mut self, slice: &Slice, sharing: Sharing) -> Result<Touched, Refused> {
        let plane = ScanPlane::new(&self.settings, self.planar.direction, self.data, slice.world_from_image);
        let slice_line = self.slice_line(&plane, slice)?;
        let rows = Rows::new(&self.settings, plane.column_mm(), slice_line.row_mm, self.data)?;
        let data = self.data;
        // A range that no tile within the memory limit could hold is refused before its voxels
        // are counted.
        let depth = plane.z_step * f64::from(data.width);
        let tile = depth * (volume::columns::COLUMNS * size_of::<f32>()) as f64;
        if tile > self.settings.memory_bytes as f64 {
            return Err(Refused::memory(tile as u64, self.settings.memory_bytes));
        }
        let end = plane.z_first.abs() + plane.z_step * f64::from(self.mask.width() + 2048) + 16.0;
        if end > f64::from(i32::MAX / 8) {
            return Err(Refused::OutOfRange);
        }
        let corner = [data.x, data.y].map(|x| x as usize);
        let bands = Bands::new(&plane, corner, [data.width, data.height].map(|x| x as usize), &rows.kernels[0]);
        let normal = KernelTable::new(&rows.kernels[2]);
        let volume = ColumnVolume::new(bands.first_z, bands.share.clone(), self.decay().is_some());
        let before = std::mem::replace(&mut self.volume, volume);
        let mut scan = Scan { plane, bands, rows, normal };
        let result = self.insert_next(&mut scan, slice, sharing);
        match result {
            Ok(_) => {
                self.settings.lattice_direction = plane.direction;
                self.scan = Some(scan);
            }
            Err(_) => self.volume = before,
        }
        result
    }

    /// The decay in use, if any.
    pub(super) fn decay(&self) -> Option<Decay> {
        match self.settings.compounding {
            Compounding::Decay(decay) => Some(decay),
            _ => None,
        }
    }

    /// Returns the line of a slice in the plane.
    fn slice_line(&self, plane: &ScanPlane, slice: &Slice) -> Result<super::plane::SliceLine, Refused> {
        let (slice_line, voxels) = plane.meet(slice.world_from_image);
        let tolerance_voxels = self.planar.tolerance_voxels;
        match voxels <= tolerance_voxels && slice_line.row_mm.is_normal() && plane.z_step > 0.0 {
            true => Ok(slice_line),
            false => Err(Departure::Pose { voxels, tolerance_voxels }.into()),
        }
    }

    fn insert_next(&mut self, scan: &mut Scan, slice: &Slice, sharing: Sharing) -> Result<Touched, Refused> {
        let slice_line = self.slice_line(&scan.plane, slice)?;
        if !scan.rows.fit(slice_line.row_mm) {
            scan.rows = Rows::new(&self.settings, scan.plane.column_mm(), slice_line.row_mm, self.data)?;
        }
        let (simd, limit_bytes) = (self.settings.simd, self.settings.memory_bytes);
        let clock = self.clock.after(slice.time_ns);
        let decay = self.decay().map(|decay| (decay, clock.elapsed_ns()));
        let least = if decay.is_some() { LEAST_TOUCH } else { 0.0 };
        let strip = Strip { slice_line, rows: &scan.rows.kernel, normal: &scan.normal, least };
        let (plan, volume, bands) = (&mut self.plan, &self.volume, &mut scan.bands);
        // Finding tiles and summing the image along u are independent.
        let (planned, ()) =
            sharing.both(|| plan.find(&strip, volume, simd, limit_bytes), || bands.sum(&slice.image, simd, sharing));
        planned?;
        self.plan.make(&mut self.volume)?;
        let most_weight = (self.settings.max_weight * scan.rows.kernels[2].peak()) as f32;
        let bands = &scan.bands;
        let (values, stride, level) = (bands.lines(), bands.stride(), bands.level);
        let lines = Lines { values, stride, level, most_weight, decay };
        self.plan.insert(&mut self.volume, &strip, &lines, simd, sharing);
        // If older values fade, reading a brick anew may change its other voxels too.
        let slab = decay.is_none().then(|| strip.prism(bands.first_z, bands.share.len())).flatten();
        let touched = Touched { slab, ..self.count(bands) };
        self.admission.entered(slice);
        self.normals.add(slice_line.normal(self.settings.spacing_mm));
        self.clock = clock;
        (self.work.times_backwards, self.work.times_absurd) = (clock.backwards, clock.absurd);
        Ok(touched)
    }

    /// Counts the plan's work.
    fn count(&mut self, bands: &Bands) -> Touched {
        let tasks = &self.plan.tasks;
        let (depth, stride) = (self.volume.depth() as u64, self.volume.stride() as u64);
        let layers = self.volume.blocks_along_z();
        let mut touched = Touched::default();
        let changed = tasks.iter().filter(|t| t.updated > 0);
        touched.bricks.reserve_exact(changed.clone().count() * layers.clone().count());
        for z in layers.clone() {
            touched.bricks.extend(changed.clone().map(|task| [task.tile[0], task.tile[1], z]));
        }
        let sum = |f: fn(&super::strip::Task) -> u64| tasks.iter().map(f).sum::<u64>();
        let columns = sum(|t| u64::from(t.updated));
        touched.voxels = columns * depth;
        let work = &mut self.work;
        work.slices += 1;
        work.filter.pixels += self.mask.area();
        work.filter.nodes += u64::from(self.data.height) * stride;
        work.filter.taps += bands.products + sum(|t| t.taps);
        work.bricks_considered += self.plan.considered * layers.count() as u64;
        work.bricks_touched += touched.bricks.len() as u64;
        work.columns_considered += self.plan.considered * volume::columns::COLUMNS as u64;
        work.columns_touched += columns;
        work.voxels_sampled += columns * stride;
        work.voxels_updated += touched.voxels;
        work.weights_clamped += sum(|t| u64::from(t.clamped)) * depth;
        touched
    }
}
