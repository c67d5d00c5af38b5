//! Filling of the holes of a volume that was read from a file.

use std::path::Path;
use std::sync::Arc;

use export::fill::{FILLED, Filled};
use export::volume::DenseBox;
use formats::image::{VolumeHeader, VolumeSlices};
use ome_zarr::{LevelValues, OmeZarr};
use sonoweave_core::reading::PixelType;
use volume::brick::{BrickIndex, EDGE, VOXELS};
use volume::dense::{FILL_FIELD, FILLED_FIELD, UNSEEN_FIELD};
use volume::placed::field;
use volume::{DenseVolume, Grid, Values, Voxels};

use crate::app::reconstruct::filling;
use crate::app::reconstruct::zarr::is_ome_zarr;
use crate::failure::Failure;

/// A volume whose holes are to be filled.
pub(super) enum Holes {
    /// A file's voxels, in memory.
    Dense(Box<DenseVolume>),
    /// The finest level of an OME-Zarr volume, of which chunks are in memory.
    Level(Box<LevelValues>),
}

impl Holes {
    /// Opens a volume. An OME-Zarr volume's chunks take at most a quarter of the memory.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be read, or a file's voxels take more memory.
    pub(super) fn open(path: &Path, weights: Option<&Path>, memory_bytes: u64) -> Result<Self, Failure> {
        Ok(match is_ome_zarr(path) {
            true => Self::Level(Box::new(LevelValues::new(&Arc::new(OmeZarr::open(path)?), 0, memory_bytes / 4)?)),
            false => Self::Dense(Box::new(DenseVolume::open(path, weights, memory_bytes)?)),
        })
    }

    /// Returns the seen voxels.
    pub(super) fn seen(&self) -> Seen<'_> {
        Seen(self.values())
    }

    /// Returns the box of all voxels, by the indices that [`Self::seen`] has.
    pub(super) fn space(&self, grid: Grid) -> DenseBox {
        DenseBox { first: self.first(), grid }
    }

    /// Checks that all voxels could be read so far.
    ///
    /// # Errors
    /// [`Failure`] with the first error.
    pub(super) fn check(&self) -> Result<(), Failure> {
        self.fault().map_or(Ok(()), |error| Err(error.into()))
    }

    /// Returns the filled volume slice by slice: values, and weights. `header` is that of the
    /// input.
    pub(super) fn slices<'a>(&'a self, filled: &'a Filled<'a>, header: &VolumeHeader) -> [FilledSlices<'a>; 2] {
        let mut header = header.clone();
        header.fields.retain(|(name, _)| name != FILL_FIELD && name != FILLED_FIELD);
        header.fields.extend(filling::fields(filled));
        let unseen = field::<f32, 1>(&header, UNSEEN_FIELD).map_or(0.0, |[value]| value);
        [false, true].map(|is_weights| {
            let pixel = if is_weights || is_real(header.pixel) { PixelType::F32 } else { header.pixel };
            let header = VolumeHeader { pixel, ..header.clone() };
            FilledSlices { header, holes: self, filled, unseen, is_weights, next: 0, bytes: Vec::new() }
        })
    }

    fn values(&self) -> &dyn Values {
        match self {
            Self::Dense(volume) => &**volume,
            Self::Level(level) => &**level,
        }
    }

    fn first(&self) -> [i64; 3] {
        match self {
            Self::Dense(volume) => volume.index([0; 3]),
            Self::Level(level) => level.placed().index([0; 3]),
        }
    }

    fn fault(&self) -> Option<formats::Error> {
        match self {
            Self::Dense(_) => None,
            Self::Level(level) => level.fault().map(|error| formats::Error::Volume(Box::new(error))),
        }
    }
}

/// Whether values of a type become single precision in the output.
fn is_real(pixel: PixelType) -> bool {
    !matches!(pixel, PixelType::U8 | PixelType::U16)
}

/// The seen voxels of a volume, each with weight 1, so that its value stays as it is.
pub(super) struct Seen<'a>(&'a dyn Values);

impl Voxels for Seen<'_> {
    fn voxel(&self, voxel: [i64; 3]) -> (f32, f32) {
        let (mut r, mut w) = ([0.0], [0.0]);
        self.row(voxel, &mut r, &mut w);
        (r[0], w[0])
    }

    fn row(&self, start: [i64; 3], r: &mut [f32], w: &mut [f32]) {
        self.0.values(start, r, w);
        w.iter_mut().for_each(|weight| *weight = if *weight > 0.0 { 1.0 } else { 0.0 });
    }

    fn block(&self, block: BrickIndex, r: &mut [f32; VOXELS], w: &mut [f32; VOXELS]) {
        self.0.brick(block, r, w);
        w.iter_mut().for_each(|weight| *weight = if *weight > 0.0 { 1.0 } else { 0.0 });
    }

    fn seen_bounds(&self) -> Option<([i64; 3], [i64; 3])> {
        let (mut r, mut w) = ([0.0; VOXELS], [0.0; VOXELS]);
        let (mut low, mut high) = ([i64::MAX; 3], [i64::MIN; 3]);
        for block in self.blocks() {
            self.block(block, &mut r, &mut w);
            for at in (0..VOXELS).filter(|at| w[*at] > 0.0) {
                let inside = [at % EDGE, at / EDGE % EDGE, at / (EDGE * EDGE)];
                for a in 0..3 {
                    let index = i64::from(block[a]) * EDGE as i64 + inside[a] as i64;
                    (low[a], high[a]) = (low[a].min(index), high[a].max(index));
                }
            }
        }
        (low[0] <= high[0]).then_some((low, high))
    }

    fn blocks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        self.0.bricks()
    }

    fn bytes(&self) -> u64 {
        0
    }
}

/// Values or weights of a filled volume, slice by slice along z.
pub(super) struct FilledSlices<'a> {
    header: VolumeHeader,
    holes: &'a Holes,
    filled: &'a Filled<'a>,
    unseen: f32,
    is_weights: bool,
    next: u32,
    bytes: Vec<u8>,
}

impl VolumeSlices for FilledSlices<'_> {
    fn header(&self) -> &VolumeHeader {
        &self.header
    }

    fn next_slice(&mut self) -> Result<Option<&[u8]>, formats::Error> {
        let [nx, ny, nz] = self.header.size;
        if self.next == nz {
            return Ok(None);
        }
        let [x0, y0, z0] = self.holes.first();
        let [mut r, mut w, mut value, mut weight] = std::array::from_fn(|_| vec![0.0_f32; nx as usize]);
        self.bytes.clear();
        for y in 0..i64::from(ny) {
            let start = [x0, y0 + y, z0 + i64::from(self.next)];
            self.filled.row(start, &mut r, &mut w);
            self.holes.values().values(start, &mut value, &mut weight);
            for (x, (r, w)) in r.iter().zip(&w).enumerate() {
                let (value, weight) = match *w {
                    FILLED => (r / w, FILLED),
                    w if w > 0.0 => (value[x], weight[x]),
                    _ => (self.unseen, 0.0),
                };
                let number = if self.is_weights { weight } else { value };
                match self.header.pixel {
                    PixelType::U8 => self.bytes.push(number.round_ties_even() as u8),
                    PixelType::U16 => self.bytes.extend((number.round_ties_even() as u16).to_ne_bytes()),
                    _ => self.bytes.extend(number.to_ne_bytes()),
                }
            }
        }
        self.next += 1;
        match self.holes.fault() {
            Some(error) => Err(error),
            None => Ok(Some(&self.bytes)),
        }
    }
}
