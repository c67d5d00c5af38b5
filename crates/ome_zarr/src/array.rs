//! One array of a volume, of this or another program, read by boxes as single precision.

use std::num::NonZeroU64;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rayon::prelude::*;
use serde_json::Value;
use zarrs::array::{Array, ArrayMetadata};

use crate::chunks::{Chunks, Fault};
use crate::error::OmeZarrError;
use crate::metadata::{FILE, read_json};
use crate::store::FolderStore;

/// Most bytes of a chunk: a damaged or hostile file must not take all memory.
const CHUNK_BYTES: u64 = 1 << 30;
/// Most chunks of a shard.
const CHUNKS: u64 = 1 << 24;

/// Scalar types that are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Element {
    U8,
    U16,
    I16,
    U32,
    I32,
    F32,
    F64,
}

impl Element {
    fn of(name: &str) -> Option<Self> {
        Some(match name {
            "uint8" => Self::U8,
            "uint16" => Self::U16,
            "int16" => Self::I16,
            "uint32" => Self::U32,
            "int32" => Self::I32,
            "float32" => Self::F32,
            "float64" => Self::F64,
            _ => return None,
        })
    }

    fn bytes(self) -> u64 {
        match self {
            Self::U8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Converts to single precision, which holds integers of up to 24 bits exactly.
    fn convert(self, bytes: &[u8]) -> Vec<f32> {
        fn each<const N: usize>(bytes: &[u8], read: impl Fn([u8; N]) -> f32) -> Vec<f32> {
            bytes.as_chunks::<N>().0.iter().map(|word| read(*word)).collect()
        }
        match self {
            Self::U8 => each(bytes, |b| f32::from(u8::from_ne_bytes(b))),
            Self::U16 => each(bytes, |b| f32::from(u16::from_ne_bytes(b))),
            Self::I16 => each(bytes, |b| f32::from(i16::from_ne_bytes(b))),
            Self::U32 => each(bytes, |b| u32::from_ne_bytes(b) as f32),
            Self::I32 => each(bytes, |b| i32::from_ne_bytes(b) as f32),
            Self::F32 => each(bytes, f32::from_ne_bytes),
            Self::F64 => each(bytes, |b| f64::from_ne_bytes(b) as f32),
        }
    }
}

/// An array of three axes z, y, x, after axes of one element each.
pub(crate) struct LevelArray {
    path: PathBuf,
    key: String,
    chunks: Chunks,
    leading: usize,
    pub(crate) element: Element,
    /// Voxels along z, y, x.
    pub(crate) shape: [u64; 3],
    /// Voxels along z, y, x of a chunk: the smallest part that is read.
    pub(crate) chunk: [u64; 3],
    /// Voxels along z, y, x of a shard, which is a chunk if the array has no shards.
    shard: [u64; 3],
    /// Value of voxels that are not stored.
    pub(crate) fill: f32,
}

impl LevelArray {
    /// Opens an array of a volume, after `leading` axes.
    pub(crate) fn open(path: &Path, key: &str, leading: usize) -> Result<Self, OmeZarrError> {
        let file = format!("{key}/{FILE}");
        let at = |field: &str, problem: String| OmeZarrError::Metadata {
            path: path.into(),
            key: file.clone(),
            field: field.to_owned(),
            problem,
        };
        let broken = |problem: String| OmeZarrError::Array { path: path.into(), key: key.to_owned(), problem };
        let json = read_json(path, &file)?.ok_or_else(|| broken(format!("{file} is missing")))?;
        let name = match &json["data_type"] {
            Value::String(name) => name.clone(),
            other => other.to_string(),
        };
        let element = Element::of(&name).ok_or_else(|| {
            let read = "uint8, uint16, int16, uint32, int32, float32 and float64 are read";
            at("data_type", format!("is {name}: {read}; convert it"))
        })?;
        let metadata: ArrayMetadata =
            serde_json::from_value(json.clone()).map_err(|error| broken(error.to_string()))?;
        let store = Arc::new(FolderStore(path.into()));
        let array = Array::new_with_metadata(store, &format!("/{key}"), metadata);
        let array = array.map_err(|error| broken(error.to_string()))?;

        let (before, shape) = array.shape().split_at(leading.min(array.shape().len()));
        let Ok(shape) = <[u64; 3]>::try_from(shape) else {
            let (found, expected) = (array.shape().len(), leading + 3);
            return Err(at("shape", format!("has {found} axes, but must have the {expected} of the image")));
        };
        if before.iter().any(|n| *n != 1) {
            let advice = "only images of one time and one channel are read; choose one, and write it alone";
            return Err(at("shape", format!("has several times or channels: {advice}")));
        }
        if shape.contains(&0) || shape.iter().any(|n| *n > 1 << 40) {
            return Err(at("shape", "must have 1 to 2⁴⁰ voxels along each axis".to_owned()));
        }
        let chunks = Chunks::new(array, &json).map_err(broken)?;
        let product = |edges: &[NonZeroU64]| edges.iter().try_fold(1_u64, |n, edge| n.checked_mul(edge.get()));
        let bytes = product(&chunks.chunk).and_then(|n| n.checked_mul(element.bytes()));
        let in_shard = product(&chunks.shard).zip(product(&chunks.chunk)).map(|(shard, chunk)| shard / chunk);
        if bytes.is_none_or(|n| n > CHUNK_BYTES) || in_shard.is_none_or(|n| n > CHUNKS) {
            let problem = "have chunks of more than 1 GiB, or too many in a shard; write smaller ones";
            return Err(at("codecs", problem.to_owned()));
        }
        let edges = |edges: &[NonZeroU64]| std::array::from_fn(|a| edges[leading + a].get());
        let (chunk, shard) = (edges(&chunks.chunk), edges(&chunks.shard));
        let fill = element.convert(chunks.fill()).first().copied().unwrap_or(0.0);
        Ok(Self { path: path.into(), key: key.to_owned(), chunks, leading, element, shape, chunk, shard, fill })
    }

    /// Reads a box, which lies within the array, x fastest. The threads of the pool share the work
    /// if `is_shared`.
    pub(crate) fn read(&self, first: [u64; 3], size: [u64; 3], is_shared: bool) -> Result<Vec<f32>, OmeZarrError> {
        let mut voxels = vec![self.fill; size.iter().product::<u64>() as usize];
        let ends: [[u64; 2]; 3] =
            std::array::from_fn(|a| [first[a] / self.chunk[a], (first[a] + size[a]).div_ceil(self.chunk[a])]);
        // Chunks in one layer along z write to rows of the same planes.
        let layers: Vec<u64> = (ends[0][0]..ends[0][1]).collect();
        let plane = (size[1] * size[2]) as usize;
        let mut parts = Vec::new();
        let mut rest = voxels.as_mut_slice();
        for layer in layers {
            let from = (layer * self.chunk[0]).max(first[0]);
            let to = ((layer + 1) * self.chunk[0]).min(first[0] + size[0]);
            let (part, behind) = std::mem::take(&mut rest).split_at_mut((to - from) as usize * plane);
            parts.push((layer, from, part));
            rest = behind;
        }
        let read = |(layer, from, part): (u64, u64, &mut [f32])| {
            let box_first = [from, first[1], first[2]];
            let box_size = [(part.len() / plane) as u64, size[1], size[2]];
            for chunk in indices([layer, ends[1][0], ends[2][0]], [layer + 1, ends[1][1], ends[2][1]]) {
                self.read_part(chunk, box_first, box_size, part)?;
            }
            Ok(())
        };
        match is_shared {
            true => parts.into_par_iter().try_for_each(read)?,
            false => parts.into_iter().try_for_each(read)?,
        }
        Ok(voxels)
    }

    /// Copies the part of a chunk that lies in a box.
    fn read_part(
        &self,
        chunk: [u64; 3],
        first: [u64; 3],
        size: [u64; 3],
        voxels: &mut [f32],
    ) -> Result<(), OmeZarrError> {
        let bytes = self.chunks.read(&self.with_leading(chunk)).map_err(|fault| self.error(fault))?;
        let Some(bytes) = bytes else { return Ok(()) };
        let read = self.element.convert(&bytes);
        let begin: [u64; 3] = std::array::from_fn(|a| chunk[a] * self.chunk[a]);
        let from: [u64; 3] = std::array::from_fn(|a| begin[a].max(first[a]));
        let to: [u64; 3] = std::array::from_fn(|a| (begin[a] + self.chunk[a]).min(first[a] + size[a]));
        for z in from[0]..to[0] {
            for y in from[1]..to[1] {
                let place = |at: [u64; 3], edges: [u64; 3]| {
                    let [z, y, x] = [z - at[0], y - at[1], from[2] - at[2]];
                    ((z * edges[1] + y) * edges[2] + x) as usize
                };
                let (to_row, from_row, count) =
                    (place(first, size), place(begin, self.chunk), (to[2] - from[2]) as usize);
                voxels[to_row..to_row + count].copy_from_slice(&read[from_row..from_row + count]);
            }
        }
        Ok(())
    }

    /// Returns the bytes of the chunks read so far, as they are stored.
    pub(crate) fn bytes_read(&self) -> u64 {
        self.chunks.bytes_read()
    }

    /// Returns the chunks that are stored, by their index along z, y, x, sorted.
    pub(crate) fn stored_chunks(&self) -> Result<Vec<[u64; 3]>, OmeZarrError> {
        let mut stored = Vec::new();
        // By shards, so that each index is read once.
        for shard in indices([0; 3], std::array::from_fn(|a| self.shape[a].div_ceil(self.shard[a]))) {
            let per_shard: [u64; 3] = std::array::from_fn(|a| self.shard[a] / self.chunk[a]);
            let first: [u64; 3] = std::array::from_fn(|a| shard[a] * per_shard[a]);
            let end = std::array::from_fn(|a| (first[a] + per_shard[a]).min(self.shape[a].div_ceil(self.chunk[a])));
            for chunk in indices(first, end) {
                if self.chunks.is_stored(&self.with_leading(chunk)).map_err(|fault| self.error(fault))? {
                    stored.push(chunk);
                }
            }
        }
        stored.sort_unstable();
        Ok(stored)
    }

    /// Returns all chunks, by their index along z, y, x, sorted.
    pub(crate) fn all_chunks(&self) -> Vec<[u64; 3]> {
        indices([0; 3], std::array::from_fn(|a| self.shape[a].div_ceil(self.chunk[a]))).collect()
    }

    /// Returns an index along all axes.
    fn with_leading(&self, index: [u64; 3]) -> Vec<u64> {
        std::iter::repeat_n(0, self.leading).chain(index).collect()
    }

    fn error(&self, fault: Fault) -> OmeZarrError {
        match fault {
            Fault::System(error) => OmeZarrError::io(self.path.join(&self.key), "reading")(error),
            Fault::Damaged(problem) => {
                OmeZarrError::Damaged { path: self.path.clone(), key: self.key.clone(), problem }
            }
        }
    }
}

/// Returns the indices z, y, x from `first` to before `end`, x fastest.
fn indices(first: [u64; 3], end: [u64; 3]) -> impl Iterator<Item = [u64; 3]> {
    (first[0]..end[0])
        .flat_map(move |z| (first[1]..end[1]).flat_map(move |y| (first[2]..end[2]).map(move |x| [z, y, x])))
}
