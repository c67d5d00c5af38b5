//! A volume in memory.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Instant;

use export::volume::{DenseBox, Encoding, Scalar, write_values_of, write_weights_of};
use formats::image::VolumeSlices;
use pipeline::Outcome;
use sonoweave_core::ledger::Ledger;
use volume::{DenseVolume, Grid, Values, Voxels};

use super::{Keyword, Keywords, LibraryError, MemorySlices};
use crate::app::convert::{write, zarr};
use crate::app::input;
use crate::app::provenance::Made;
use crate::app::reconstruct::beside::Beside;
use crate::app::reconstruct::origin::Origin;
use crate::app::reconstruct::outputs::Request;
use crate::app::reconstruct::sweep::Sweep;
use crate::app::reconstruct::zarr::is_ome_zarr;
use crate::app::render::{RenderVolume, image};
use crate::app::volume_input::{self, holds_weights};
use crate::cli::render::keywords::{Picture, parse};
use crate::failure::Failure;

/// Ranges of voxels along x, y, z, by index from the volume's first voxel.
pub type VoxelBox = [Range<usize>; 3];

/// A volume in memory. It does not change.
pub struct LibraryVolume {
    grid: Grid,
    content: Content,
}

#[allow(clippy::large_enum_variant, reason = "few, and never moved")]
enum Content {
    /// The state of a reconstruction.
    Reconstruction {
        outcome: Mutex<Outcome>,
        space: DenseBox,
        sweep: Sweep,
        keywords: Keywords,
        origin: Origin,
        /// The same, as a file of single precision would hold it; made for the first picture.
        dense: OnceLock<Arc<DenseVolume>>,
    },
    /// Values of a file, or of a program.
    Dense(Arc<DenseVolume>),
}

impl LibraryVolume {
    pub(super) fn of_outcome(
        outcome: Outcome,
        sweep: &Sweep,
        keywords: Keywords,
        origin: Origin,
    ) -> Result<Self, LibraryError> {
        let space = keywords.flags()?.outputs(None, Beside::default()).dense_box(&outcome)?;
        let sweep = sweep.without_observers();
        let outcome = Mutex::new(outcome);
        let content = Content::Reconstruction { outcome, space, sweep, keywords, origin, dense: OnceLock::new() };
        Ok(Self { grid: space.grid, content })
    }

    /// Opens a file, or an OME-Zarr folder, which may have weights itself. The memory it may take
    /// is that of the keyword `max_memory`.
    ///
    /// # Errors
    /// [`LibraryError`] when it cannot be read.
    pub fn open(path: &Path, weights: Option<&Path>, keywords: &Keywords) -> Result<Self, LibraryError> {
        let limit_bytes = keywords.flags()?.sweep(path)?.session.settings.memory_bytes;
        let dense = volume_input::dense(path, weights, limit_bytes);
        Ok(Self::of_dense(dense.map_err(|failure| LibraryError::of_failure(path, failure))?))
    }

    /// Takes values from memory, and weights on the same grid.
    ///
    /// # Errors
    /// [`LibraryError`] when the axes span no space.
    pub fn of_slices(values: MemorySlices<'_>, weights: Option<MemorySlices<'_>>) -> Result<Self, LibraryError> {
        let path = Path::new("volume in memory");
        let dense = DenseVolume::read((path, values), weights.map(|weights| (path, weights)), u64::MAX);
        Ok(Self::of_dense(dense.map_err(|error| LibraryError::at(path, error))?))
    }

    fn of_dense(dense: DenseVolume) -> Self {
        Self { grid: dense.grid(), content: Content::Dense(Arc::new(dense)) }
    }

    /// Returns its place in the world.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Reads values, weights, or both of a box, x fastest; both 0 for unseen voxels. Threads share
    /// the work.
    ///
    /// # Panics
    /// When the box exceeds the volume: the caller has checked it.
    pub fn read(&self, voxels: &VoxelBox, values: Option<&mut [f32]>, weights: Option<&mut [f32]>) {
        match &self.content {
            Content::Reconstruction { outcome, space, .. } => {
                let outcome = lock(outcome);
                let volume = outcome.reconstructor.volume();
                read(voxels, values, weights, |part, values, weights| blocks(volume, space, part, values, weights));
            }
            Content::Dense(dense) => {
                read(voxels, values, weights, |part, values, weights| rows(dense, part, values, weights));
            }
        }
    }

    /// Returns the account of the frames in it; `None` for a file.
    pub fn ledger(&self) -> Option<Ledger> {
        match &self.content {
            Content::Reconstruction { outcome, .. } => Some(lock(outcome).ledger.clone()),
            Content::Dense(_) => None,
        }
    }

    /// Returns notes for the user, as sentences.
    pub fn notes(&self) -> Vec<String> {
        match &self.content {
            Content::Reconstruction { outcome, .. } => lock(outcome).notes.clone(),
            Content::Dense(dense) => dense.notes().to_vec(),
        }
    }

    /// Returns the values that mean black and white in the scanner's frames.
    pub fn range(&self) -> [f32; 2] {
        match &self.content {
            Content::Reconstruction { outcome, .. } => lock(outcome).pixels.grey_levels(),
            Content::Dense(dense) => dense.range(),
        }
    }

    /// Returns the fields of a file's header; for a reconstruction those of a file of single
    /// precision, without its origin.
    pub fn fields(&self) -> Vec<(String, String)> {
        match &self.content {
            Content::Reconstruction { outcome, space, .. } => {
                let (input, calibration) = (String::new(), String::new());
                let encoding = Encoding { scalar: Scalar::F32, window: None, unseen: 0.0 };
                let outcome = &*lock(outcome);
                Made { outcome, space, encoding: &encoding, input, calibration, cropped: false }.fields()
            }
            Content::Dense(dense) => dense.header().fields.clone(),
        }
    }

    /// Returns a picture of it by the flags of `render`: width, height, and red, green, blue of
    /// each pixel.
    ///
    /// # Errors
    /// [`LibraryError`] when a setting does not fit.
    pub fn picture(&self, keywords: &[Keyword]) -> Result<([u32; 2], Vec<u8>), LibraryError> {
        let Picture { look, window, threads, level, .. } = parse(keywords)?;
        if level.is_some() {
            return Err(Failure::usage("level: applies to OME-Zarr folders; leave it out, or give the path").into());
        }
        let volume = RenderVolume::Dense(Arc::clone(self.dense()?));
        let image = image(&volume, &look, window, threads, u64::MAX)?;
        Ok(([image.width(), image.height()], image.into_raw()))
    }

    fn dense(&self) -> Result<&Arc<DenseVolume>, LibraryError> {
        match &self.content {
            Content::Dense(dense) => Ok(dense),
            Content::Reconstruction { dense, .. } => {
                if let Some(dense) = dense.get() {
                    return Ok(dense);
                }
                let all: VoxelBox = self.grid.size.map(|n| 0..n as usize);
                let voxels = all.iter().map(Range::len).product();
                let (mut values, mut weights) = (vec![0.0; voxels], vec![0.0; voxels]);
                self.read(&all, Some(&mut values), Some(&mut weights));
                let Grid { size, spacing, origin, direction } = self.grid;
                let axes = [direction.x_axis, direction.y_axis, direction.z_axis].map(|axis| axis.to_array());
                let size = size.map(|n| u32::try_from(n).unwrap_or(u32::MAX));
                let place = (spacing.to_array(), origin.to_array(), axes);
                let slices = MemorySlices::new(size, place, &values, self.fields());
                let of_weights = MemorySlices::new(size, place, &weights, Vec::new());
                let path = Path::new("the reconstruction");
                let made = DenseVolume::read((path, slices), Some((path, of_weights)), u64::MAX);
                let made = made.map_err(|error| LibraryError::at(path, error))?;
                Ok(dense.get_or_init(|| Arc::new(made)))
            }
        }
    }

    /// Writes the volume in the format of the name; a reconstruction as the command line writes
    /// it, by keywords such as `type`, `window`, `unseen`, `fill`, `error` and `weights`. Returns
    /// the report of a reconstruction, as JSON.
    ///
    /// # Errors
    /// [`LibraryError`]: the file that failed does not exist, or is as before.
    pub fn write(&self, path: &Path, given: &Keywords, weights: Option<&Path>) -> Result<Option<String>, LibraryError> {
        let began = Instant::now();
        let failed = |failure| LibraryError::of_failure(path, failure);
        match &self.content {
            Content::Reconstruction { outcome, sweep, keywords, origin, .. } => {
                let flags = given.or(keywords).flags().map_err(failed)?;
                // The report is returned.
                let beside = Beside { weights: weights.map(Path::to_owned), json: None, ..flags.beside() };
                let options = flags.outputs(Some(path), beside);
                let request = Request::new(origin.clone(), sweep, options, began).map_err(failed)?;
                let written = request.write(&mut lock(outcome), None::<&()>).map_err(failed)?;
                Ok(Some(written.document))
            }
            Content::Dense(_) if *given != Keywords::default() => {
                Err(failed(Failure("a volume of a file is written as it is; leave out the settings".into())))
            }
            Content::Dense(dense) => {
                if input::is_dicom(path) {
                    return Err(failed(Failure::usage(format!(
                        "{}: only a reconstruction is written so; give .mha, .mhd, .nrrd, .nhdr, .nii, .nii.gz or \
                         .ome.zarr",
                        path.display()
                    ))));
                }
                let [nx, ny, nz] = dense.header().size;
                let all: VoxelBox = [nx, ny, nz].map(|n| 0..n as usize);
                let voxels = all.iter().map(Range::len).product();
                let (mut values, mut of_voxels) = (vec![0.0; voxels], vec![0.0; voxels]);
                self.read(&all, Some(&mut values), Some(&mut of_voxels));
                let header = dense.header();
                let slices = |values| {
                    let place = (header.spacing, header.origin, header.axes);
                    MemorySlices::new(header.size, place, values, header.fields.clone())
                };
                if is_ome_zarr(path) {
                    if let Some(weights) = weights {
                        return Err(failed(holds_weights(path, weights)));
                    }
                    let both = || [slices(&values), slices(&of_voxels)];
                    return zarr::write(path, both).map(|()| None).map_err(failed);
                }
                let outputs = [Some(path), weights].into_iter().flatten();
                outputs
                    .clone()
                    .try_for_each(|path| input::check_volume(path).and(input::check_output(path)))
                    .map_err(failed)?;
                for (path, values) in outputs.zip([&values, &of_voxels]) {
                    let mut slices = slices(values);
                    let header = slices.header().clone();
                    write::volume(&mut slices, &header, path).map_err(|error| LibraryError::at(path, error))?;
                }
                Ok(None)
            }
        }
    }

    /// Returns the recordings that it was made of; `None` for a file or frames in memory.
    pub fn recording(&self) -> Option<PathBuf> {
        match &self.content {
            Content::Reconstruction { origin: Origin::File(path) | Origin::Session(path), .. } => Some(path.clone()),
            _ => None,
        }
    }
}

fn lock(outcome: &Mutex<Outcome>) -> MutexGuard<'_, Outcome> {
    outcome.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Reads a box by `read_part(box, values, weights)`; each thread some of its planes.
fn read(
    [xs, ys, zs]: &VoxelBox,
    values: Option<&mut [f32]>,
    weights: Option<&mut [f32]>,
    read_part: impl Fn(VoxelBox, Option<&mut [f32]>, Option<&mut [f32]>) + Sync,
) {
    let plane = xs.len() * ys.len();
    if plane == 0 || zs.is_empty() {
        return;
    }
    let threads = input::threads(None).min(zs.len());
    let each = zs.len().div_ceil(threads);
    let part = |number: usize| {
        let planes = zs.start + number * each..(zs.start + (number + 1) * each).min(zs.end);
        [xs.clone(), ys.clone(), planes]
    };
    std::thread::scope(|scope| {
        let parts = |voxels| parts(voxels, each * plane, threads);
        let mut parts = parts(values).into_iter().zip(parts(weights)).enumerate();
        let first = parts.next();
        for (number, (values, weights)) in parts {
            let read_part = &read_part;
            scope.spawn(move || read_part(part(number), values, weights));
        }
        if let Some((number, (values, weights))) = first {
            read_part(part(number), values, weights);
        }
    });
}

/// Reads a box of a reconstruction block by block: a block is looked up once, not for each row.
fn blocks(
    volume: &dyn Voxels,
    space: &DenseBox,
    voxels: VoxelBox,
    values: Option<&mut [f32]>,
    weights: Option<&mut [f32]>,
) {
    let first = std::array::from_fn(|a| space.first[a] + voxels[a].start as i64);
    let space = DenseBox { first, grid: Grid { size: voxels.map(|range| range.len() as u64), ..space.grid } };
    if let Some(values) = values {
        let encoding = Encoding { scalar: Scalar::F32, window: None, unseen: 0.0 };
        let values = bytemuck::cast_slice_mut(values);
        space.parts(u64::MAX).for_each(|part| write_values_of(volume, &space, &encoding, &part, values));
    }
    if let Some(weights) = weights {
        let weights = bytemuck::cast_slice_mut(weights);
        space.parts(u64::MAX).for_each(|part| write_weights_of(volume, &space, &part, weights));
    }
}

/// Reads a box of a file's values row by row, as they lie in memory.
fn rows(dense: &DenseVolume, [xs, ys, zs]: VoxelBox, mut values: Option<&mut [f32]>, mut weights: Option<&mut [f32]>) {
    let row = xs.len();
    let mut unwanted = [vec![0.0; row], vec![0.0; row]];
    for (at, (z, y)) in zs.flat_map(|z| ys.clone().map(move |y| (z, y))).enumerate() {
        let [other_values, other_weights] = &mut unwanted;
        let of_row = at * row..(at + 1) * row;
        let values = values.as_mut().map_or(&mut other_values[..], |values| &mut values[of_row.clone()]);
        let weights = weights.as_mut().map_or(&mut other_weights[..], |weights| &mut weights[of_row]);
        dense.values(dense.index([xs.start as i64, y as i64, z as i64]), values, weights);
    }
}

/// Divides voxels among at most so many threads.
fn parts(voxels: Option<&mut [f32]>, each: usize, threads: usize) -> Vec<Option<&mut [f32]>> {
    match voxels {
        Some(voxels) => voxels.chunks_mut(each).map(Some).collect(),
        None => (0..threads).map(|_| None).collect(),
    }
}
