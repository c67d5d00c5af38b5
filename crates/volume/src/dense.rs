//! A dense volume in memory, read from a file of this or another program.

use std::path::{Path, PathBuf};

use glam::DVec3;

use formats::Limits;
use formats::image::{VolumeHeader, VolumeReader, VolumeSlices};
use sonoweave_core::frames::{Transform, Volume, World};
use sonoweave_core::reading::PixelType;

use super::Grid;
use super::brick::{BrickIndex, EDGE};
use super::placed::{PlacedHeader, field, grid};
pub use super::placed::{RANGE_FIELD, SLICE_AXES_FIELD, SLICES_BOX_FIELD};
use super::read::{SEEN, Values};

/// Header field with the value of voxels that were not seen.
pub const UNSEEN_FIELD: &str = "SonoweaveUnseen";

/// Header field with the method by which holes were filled; see `export::fill`.
pub const FILL_FIELD: &str = "SonoweaveFill";
/// Header field with the number of filled voxels.
pub const FILLED_FIELD: &str = "SonoweaveFilled";

/// Two files are on one grid if they agree to this fraction of a voxel at its far end.
const SAME_GRID: f64 = 1e-3;

/// A volume read from a file. Its voxel indices are those of the [canonical](super::lattice)
/// lattice.
#[derive(Debug)]
pub struct DenseVolume {
    placed: PlacedHeader,
    /// x fastest. Without weights, NaN marks unseen voxels.
    value: Vec<f32>,
    /// 0 for unseen voxels.
    weight: Option<Vec<f32>>,
    bricks: Vec<BrickIndex>,
    seen: u64,
    extremes: Option<[f32; 2]>,
    notes: Vec<String>,
}

/// Reasons for which a file cannot be used as a volume.
#[derive(Debug, thiserror::Error)]
pub enum DenseError {
    /// The file, its header or its data.
    #[error(transparent)]
    File(#[from] formats::Error),
    /// Several values a voxel.
    #[error("{path}: has {channels} channels; a volume to be rendered has one: convert it, or choose a channel", path = path.display())]
    Channels {
        /// The file.
        path: PathBuf,
        /// Number of channels.
        channels: u32,
    },
    /// Axes that do not span space.
    #[error("{path}: field TransformMatrix (space directions, srow) has axes that lie in one plane, so the volume has no place in space: correct it", path = path.display())]
    Flat {
        /// The file.
        path: PathBuf,
    },
    /// No axes at all.
    #[error("{path}: has no place in space: neither sform nor qform of this NIfTI is given (their codes are 0); give it one, or take the file it was made of", path = path.display())]
    Nowhere {
        /// The file.
        path: PathBuf,
    },
    /// More memory than allowed.
    #[error(
        "{path}: {} voxels would take {needed:.1} GiB of memory, of which {limit:.1} may be taken: raise the memory limit, or crop the volume",
        size.map(|n| n.to_string()).join("×"), path = path.display(), needed = gib(*needed_bytes), limit = gib(*limit_bytes)
    )]
    Memory {
        /// The file.
        path: PathBuf,
        /// Voxels along x, y, z.
        size: [u32; 3],
        /// Memory needed, bytes.
        needed_bytes: u64,
        /// Memory allowed, bytes.
        limit_bytes: u64,
    },
    /// Weights of another volume.
    #[error(
        "{weights}: these are not the weights of {path}: {what} differs; give the file that was written with it",
        weights = weights.display(), path = path.display()
    )]
    OtherGrid {
        /// The volume.
        path: PathBuf,
        /// The weights.
        weights: PathBuf,
        /// Size, spacing, origin or direction.
        what: &'static str,
    },
}

fn gib(bytes: u64) -> f64 {
    bytes as f64 / f64::from(1 << 30)
}

impl DenseVolume {
    /// Reads a volume, slice by slice, and its weights if there are any. Both take 4 bytes a
    /// voxel, together no more than `limit_bytes`.
    ///
    /// If weights are given, voxels of at most [`SEEN`] are unseen; these include
    /// filled ones (`export::fill`). Without weights, all voxels are seen, with weight 1,
    /// except those whose value equals that of the header's [`UNSEEN_FIELD`]. Values that are
    /// not finite count as unseen.
    ///
    /// # Errors
    /// [`DenseError`] when a file cannot be read whole, has several channels, needs more
    /// memory, or the weights are on another grid.
    pub fn open(path: &Path, weights: Option<&Path>, limit_bytes: u64) -> Result<Self, DenseError> {
        let open = |path: &Path| VolumeReader::open(path, &Limits::default());
        let values = (path, open(path)?);
        Self::read(values, weights.map(|path| Ok::<_, DenseError>((path, open(path)?))).transpose()?, limit_bytes)
    }

    /// Like [`Self::open`], for readers of the values and the weights, with the paths that errors
    /// name.
    ///
    /// # Errors
    /// Same as [`Self::open`].
    pub fn read(
        (path, reader): (&Path, impl VolumeSlices),
        weights: Option<(&Path, impl VolumeSlices)>,
        limit_bytes: u64,
    ) -> Result<Self, DenseError> {
        let header = reader.header().clone();
        checked_grid((path, &header), weights.as_ref().map(|(path, weights)| (*path, weights.header())))?;
        let voxels = header.size.iter().try_fold(1_u64, |n, s| n.checked_mul(u64::from(*s)));
        let each = if weights.is_some() { 8 } else { 4 };
        let needed_bytes = voxels.and_then(|n| n.checked_mul(each)).unwrap_or(u64::MAX);
        let too_large = || DenseError::Memory { path: path.into(), size: header.size, needed_bytes, limit_bytes };
        let voxels = voxels.and_then(|n| usize::try_from(n).ok()).filter(|_| needed_bytes <= limit_bytes);
        let voxels = voxels.ok_or_else(too_large)?;
        let mut value = scalars(reader, voxels, too_large)?;
        let mut weight = weights.map(|(_, reader)| scalars(reader, voxels, too_large)).transpose()?;
        let notes = hide_unseen(&header, &mut value, weight.as_deref_mut());
        let mut this = Self {
            placed: PlacedHeader::new(header),
            value,
            weight,
            bricks: Vec::new(),
            seen: 0,
            extremes: None,
            notes,
        };
        this.survey();
        Ok(this)
    }

    /// Determines the number, bricks and value range of seen voxels.
    fn survey(&mut self) {
        let [nx, ny, nz] = self.header().size.map(i64::from);
        let edge = EDGE as i64;
        let first = self.placed.offset();
        let low = first.map(|o| o.div_euclid(edge));
        let count: [usize; 3] = std::array::from_fn(|a| {
            let last = first[a].saturating_add([nx, ny, nz][a] - 1).div_euclid(edge);
            (last - low[a] + 1) as usize
        });
        let mut held = vec![false; count.iter().product()];
        let (mut extremes, mut seen) = ([f32::INFINITY, f32::NEG_INFINITY], 0);
        let mut at = 0;
        for z in 0..nz {
            for y in 0..ny {
                let brick = |a: usize, i: i64| (first[a].saturating_add(i).div_euclid(edge) - low[a]) as usize;
                let row = (brick(2, z) * count[1] + brick(1, y)) * count[0];
                for x in 0..nx {
                    let value = self.value[at];
                    if self.weight.as_ref().map_or(!value.is_nan(), |w| w[at] > 0.0) {
                        held[row + brick(0, x)] = true;
                        extremes = [extremes[0].min(value), extremes[1].max(value)];
                        seen += 1;
                    }
                    at += 1;
                }
            }
        }
        self.seen = seen;
        self.extremes = (seen > 0).then_some(extremes);
        let places = held.iter().enumerate().filter(|(_, held)| **held).map(|(i, _)| {
            let at = [i % count[0], i / count[0] % count[1], i / (count[0] * count[1])];
            std::array::from_fn(|a| i32::try_from(low[a].saturating_add(at[a] as i64)))
        });
        // Rendering is limited to 31-bit indices; the render region reports it.
        self.bricks = places.filter_map(|[x, y, z]| Some([x.ok()?, y.ok()?, z.ok()?])).collect();
    }

    /// The file's header, and the voxels' place.
    pub fn placed(&self) -> &PlacedHeader {
        &self.placed
    }

    /// The file's header.
    pub fn header(&self) -> &VolumeHeader {
        self.placed.header()
    }

    /// Converts a voxel's index in the file to its canonical index.
    pub fn index(&self, voxel: [i64; 3]) -> [i64; 3] {
        self.placed.index(voxel)
    }

    /// The grid of the file's voxels, by their indices in the file.
    pub fn grid(&self) -> Grid {
        self.placed.grid()
    }

    /// Maps canonical voxel indices to world mm.
    pub fn world_from_lattice(&self) -> Transform<World, Volume> {
        self.placed.world_from_lattice()
    }

    /// Same as [`PlacedHeader::bounds`].
    pub fn bounds(&self) -> [[i64; 3]; 2] {
        self.placed.bounds()
    }

    /// Same as [`PlacedHeader::slice_axes`].
    pub fn slice_axes(&self) -> Option<[DVec3; 2]> {
        self.placed.slice_axes()
    }

    /// Values of black and white: those of the file, else of the scalar type, else
    /// [`Self::extremes`].
    pub fn range(&self) -> [f32; 2] {
        self.placed.range_of(self.extremes)
    }

    /// Smallest and largest value seen; `None` if nothing was seen.
    pub fn extremes(&self) -> Option<[f32; 2]> {
        self.extremes
    }

    /// Number of seen voxels.
    pub fn seen(&self) -> u64 {
        self.seen
    }

    /// Whether weights were read.
    pub fn has_weights(&self) -> bool {
        self.weight.is_some()
    }

    /// Notes for the user: sentences.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Adds notes for the user.
    pub fn add_notes(&mut self, notes: impl IntoIterator<Item = String>) {
        self.notes.extend(notes);
    }

    /// Bytes used by voxels.
    pub fn bytes(&self) -> u64 {
        let each = size_of::<f32>() * (1 + usize::from(self.weight.is_some()));
        (self.value.len() * each) as u64
    }
}

impl Values for DenseVolume {
    fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
        assert_eq!(value.len(), weight.len(), "a value and a weight a voxel");
        value.fill(0.0);
        weight.fill(0.0);
        let [nx, ny, nz] = self.header().size.map(i64::from);
        let offset = self.placed.offset();
        let [x, y, z] = std::array::from_fn(|a| start[a] - offset[a]);
        if !((0..ny).contains(&y) && (0..nz).contains(&z)) {
            return;
        }
        let row = (z * ny + y) * nx;
        let (from, to) = (x.clamp(0, nx), x.saturating_add(value.len() as i64).clamp(0, nx));
        if from >= to {
            return;
        }
        let held = (row + from) as usize..(row + to) as usize;
        let part = (from - x) as usize..(to - x) as usize;
        let (value, weight) = (&mut value[part.clone()], &mut weight[part]);
        match &self.weight {
            Some(weights) => {
                value.copy_from_slice(&self.value[held.clone()]);
                weight.copy_from_slice(&weights[held]);
            }
            None => {
                for ((value, weight), held) in value.iter_mut().zip(weight).zip(&self.value[held]) {
                    if !held.is_nan() {
                        (*value, *weight) = (*held, 1.0);
                    }
                }
            }
        }
    }

    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        Box::new(self.bricks.iter().copied())
    }
}

/// Returns the grid of a volume's file, and checks that it is one of a single channel, and that the
/// weights are on it.
///
/// # Errors
/// [`DenseError`] otherwise.
pub fn checked_grid(
    (path, header): (&Path, &VolumeHeader),
    weights: Option<(&Path, &VolumeHeader)>,
) -> Result<Grid, DenseError> {
    for (path, header) in [(path, header)].into_iter().chain(weights) {
        if header.channels != 1 {
            return Err(DenseError::Channels { path: path.into(), channels: header.channels });
        }
    }
    if let Some((of_weights, weights)) = weights
        && let Some(what) = difference(header, weights)
    {
        return Err(DenseError::OtherGrid { path: path.into(), weights: of_weights.into(), what });
    }
    if !header.placed {
        return Err(DenseError::Nowhere { path: path.into() });
    }
    let grid = grid(header);
    if grid.direction.determinant().abs() < 1e-6 {
        return Err(DenseError::Flat { path: path.into() });
    }
    Ok(grid)
}

/// Reads all voxels.
fn scalars(
    mut reader: impl VolumeSlices,
    voxels: usize,
    too_large: impl Fn() -> DenseError,
) -> Result<Vec<f32>, DenseError> {
    let mut values = Vec::new();
    values.try_reserve_exact(voxels).map_err(|_| too_large())?;
    let pixel = reader.header().pixel;
    while let Some(slice) = reader.next_slice()? {
        append(slice, pixel, &mut values);
    }
    Ok(values)
}

/// Appends scalars in native byte order as single precision, which holds integers of up to 24
/// bits exactly.
pub fn append(bytes: &[u8], pixel: PixelType, values: &mut Vec<f32>) {
    fn each<const N: usize>(bytes: &[u8], values: &mut Vec<f32>, read: impl Fn([u8; N]) -> f32) {
        values.extend(bytes.as_chunks::<N>().0.iter().map(|word| read(*word)));
    }
    match pixel {
        PixelType::U8 => each(bytes, values, |b| f32::from(u8::from_ne_bytes(b))),
        PixelType::I8 => each(bytes, values, |b| f32::from(i8::from_ne_bytes(b))),
        PixelType::U16 => each(bytes, values, |b| f32::from(u16::from_ne_bytes(b))),
        PixelType::I16 => each(bytes, values, |b| f32::from(i16::from_ne_bytes(b))),
        PixelType::U32 => each(bytes, values, |b| u32::from_ne_bytes(b) as f32),
        PixelType::I32 => each(bytes, values, |b| i32::from_ne_bytes(b) as f32),
        PixelType::U64 => each(bytes, values, |b| u64::from_ne_bytes(b) as f32),
        PixelType::I64 => each(bytes, values, |b| i64::from_ne_bytes(b) as f32),
        PixelType::F32 => each(bytes, values, f32::from_ne_bytes),
        PixelType::F64 => each(bytes, values, |b| f64::from_ne_bytes(b) as f32),
    }
}

/// Marks unseen voxels in the same way for all kinds of files; returns notes for the user.
fn hide_unseen(header: &VolumeHeader, value: &mut [f32], weight: Option<&mut [f32]>) -> Vec<String> {
    let (mut not_finite, mut named) = (0_u64, 0_u64);
    let unseen = field::<f32, 1>(header, UNSEEN_FIELD).map(|[value]| value);
    let has_weights = weight.is_some();
    match weight {
        Some(weight) => {
            for (value, weight) in value.iter_mut().zip(weight) {
                // The comparison is false for NaN.
                let seen = *weight > SEEN && weight.is_finite();
                not_finite += u64::from(seen && !value.is_finite());
                if !(seen && value.is_finite()) {
                    (*value, *weight) = (0.0, 0.0);
                }
            }
        }
        None => {
            for value in value {
                if unseen.is_some_and(|unseen| *value == unseen || (value.is_nan() && unseen.is_nan())) {
                    named += 1;
                    *value = f32::NAN;
                } else if !value.is_finite() {
                    not_finite += 1;
                    *value = f32::NAN;
                }
            }
        }
    }
    let mut notes = Vec::new();
    if not_finite > 0 {
        notes.push(format!("{not_finite} voxels have a value that is not finite: they count as not seen"));
    }
    if let Some(unseen) = unseen.filter(|_| named > 0) {
        notes.push(format!(
            "{named} voxels of the value {unseen}, the header's {UNSEEN_FIELD}, count as not seen; the weights would show those that were"
        ));
    }
    if let (false, Some([count])) = (has_weights, field::<u64, 1>(header, FILLED_FIELD).filter(|[count]| *count > 0)) {
        notes.push(format!(
            "{count} voxels were filled from those around them, by the header's {FILLED_FIELD}, and are shown like seen ones; the weights would show which"
        ));
    }
    notes
}

/// Returns the property in which two grids differ.
fn difference(a: &VolumeHeader, b: &VolumeHeader) -> Option<&'static str> {
    if a.size != b.size {
        return Some("the size");
    }
    let longest = |axis: usize| f64::from(a.size[axis]);
    if (0..3).any(|i| (b.spacing[i] / a.spacing[i] - 1.0).abs() * longest(i) > SAME_GRID) {
        return Some("the spacing");
    }
    if (0..3).any(|i| (0..3).any(|k| (a.axes[i][k] - b.axes[i][k]).abs() * longest(i) > SAME_GRID)) {
        return Some("the direction");
    }
    let finest = a.spacing.iter().copied().fold(f64::INFINITY, f64::min);
    (0..3).any(|k| (a.origin[k] - b.origin[k]).abs() > SAME_GRID * finest).then_some("the origin")
}

#[cfg(test)]
mod tests;
