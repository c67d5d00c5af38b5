//! A level of a volume for renderers: chunks are read when they are needed.

use std::collections::{BTreeSet, HashSet};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use serde::Serialize;
use simd::sharing::Sharing;
use simd::team::Team;
use volume::brick::{BrickIndex, EDGE, VOXELS};
use volume::read::SEEN;
use volume::{PlacedHeader, Values};

use crate::array::LevelArray;
use crate::cache::Cache;
use crate::error::OmeZarrError;
use crate::reader::{Level, OmeZarr};
use crate::slices::{header, pixel};

/// Locks of chunks that are being read, so that a chunk which several threads need is read once.
const LOCKS: usize = 64;

/// Values and weights of a level, on its [canonical](volume::lattice) lattice: voxels have the
/// indices that they have in a volume read from a file of another format.
///
/// Chunks that were read stay in memory up to a limit. Reading cannot report errors: voxels of a
/// damaged chunk are unseen, and [`Self::fault`] has the first error.
pub struct LevelValues {
    level: Arc<Level>,
    placed: PlacedHeader,
    /// Chunks that may hold seen voxels, by index along z, y, x, sorted.
    chunks: Vec<[u64; 3]>,
    /// Bricks that chunks meet, chunk by chunk.
    bricks: Vec<BrickIndex>,
    cache: Cache<Chunk>,
    cache_bytes: u64,
    locks: [Mutex<()>; LOCKS],
    chunks_read: AtomicU64,
    has_not_finite: AtomicBool,
    fault: Mutex<Option<OmeZarrError>>,
}

/// Work of reading a level.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct ChunkWork {
    /// Chunks that may hold seen voxels.
    pub chunks: u64,
    /// Chunks read; one counts again if it was read again, for want of memory.
    pub chunks_read: u64,
    /// Bytes of the read chunks of values and weights, as they are stored.
    pub bytes_read: u64,
}

/// Voxels of a chunk, x fastest; 0 where nothing was seen.
struct Chunk {
    values: Vec<f32>,
    weights: Vec<f32>,
    /// Voxels along z, y, x.
    size: [usize; 3],
}

impl LevelValues {
    /// Prepares a level for reading: looks up which chunks are stored. Chunks of at most
    /// `cache_bytes` stay in memory.
    ///
    /// # Errors
    /// [`OmeZarrError`] when there is no such level, a shard's index is damaged, or the size
    /// exceeds 32 bits.
    pub fn new(volume: &OmeZarr, level: usize, cache_bytes: u64) -> Result<Self, OmeZarrError> {
        let of = volume.level(level)?.clone();
        let placed = PlacedHeader::new(header(volume, level, pixel(of.values.element))?);
        let chunks = seen_chunks(&of)?;
        let bricks = bricks(&of, placed.offset(), &chunks);
        Ok(Self {
            level: of,
            placed,
            chunks,
            bricks,
            cache: Cache::new(cache_bytes),
            cache_bytes,
            locks: std::array::from_fn(|_| Mutex::new(())),
            chunks_read: AtomicU64::new(0),
            has_not_finite: AtomicBool::new(false),
            fault: Mutex::new(None),
        })
    }

    /// Returns the header, as that of a file of another format, and the voxels' place.
    pub fn placed(&self) -> &PlacedHeader {
        &self.placed
    }

    /// Returns the work done so far.
    pub fn work(&self) -> ChunkWork {
        let arrays = [Some(&self.level.values), self.level.weights.as_ref()];
        ChunkWork {
            chunks: self.chunks.len() as u64,
            chunks_read: self.chunks_read.load(Ordering::Relaxed),
            bytes_read: arrays.into_iter().flatten().map(LevelArray::bytes_read).sum(),
        }
    }

    /// Returns whether a voxel that was read has a weight and a value that is not finite. It counts
    /// as unseen.
    pub fn has_not_finite(&self) -> bool {
        self.has_not_finite.load(Ordering::Relaxed)
    }

    /// Returns whether the volume has weights.
    pub fn has_weights(&self) -> bool {
        self.level.weights.is_some()
    }

    /// Returns the memory of a chunk's voxels, bytes.
    pub fn chunk_bytes(&self) -> u64 {
        2 * size_of::<f32>() as u64 * self.level.values.chunk.iter().product::<u64>()
    }

    /// Cuts bricks, in the order of [`Values::bricks`], into groups whose chunks take about half
    /// of the memory for chunks, to be [loaded](Self::load) one after the other.
    pub fn groups<'a>(&self, bricks: &'a [BrickIndex]) -> impl Iterator<Item = &'a [BrickIndex]> + use<'a> {
        let at_once = (self.cache_bytes / 2 / self.chunk_bytes()).max(1);
        let in_chunk: u64 = self.level.values.chunk.iter().map(|edge| edge.div_ceil(EDGE as u64)).product();
        bricks.chunks(usize::try_from(at_once.saturating_mul(in_chunk)).unwrap_or(usize::MAX))
    }

    /// Reads the chunks that some bricks meet, unless they are in memory: the threads of a team at
    /// once, or the calling thread. The bricks can then be read without waiting for the disk.
    pub fn load(&self, bricks: &[BrickIndex], team: Option<&Team>) {
        let edge = EDGE as i64;
        let mut wanted = BTreeSet::new();
        for brick in bricks {
            let ends: [[u64; 2]; 3] = std::array::from_fn(|a| {
                let axis = 2 - a;
                let first = i64::from(brick[axis]) * edge - self.placed.offset()[axis];
                let [shape, edge_of_chunk] = [self.level.values.shape[a], self.level.values.chunk[a]];
                match [first, first + edge].map(|at| at.clamp(0, shape as i64) as u64) {
                    [from, to] if from < to => [from / edge_of_chunk, to.div_ceil(edge_of_chunk)],
                    _ => [0, 0],
                }
            });
            for z in ends[0][0]..ends[0][1] {
                for y in ends[1][0]..ends[1][1] {
                    wanted.extend((ends[2][0]..ends[2][1]).map(|x| [z, y, x]));
                }
            }
        }
        self.read_chunks(Vec::from_iter(wanted), team);
    }

    /// Returns values of black and white: those of the volume, else of the scalar type, else the
    /// smallest and the largest seen, for which all chunks are read.
    pub fn range(&self, team: Option<&Team>) -> [f32; 2] {
        if let Some(range) = self.placed.range() {
            return range;
        }
        let at_once = usize::try_from((self.cache_bytes / 2 / self.chunk_bytes()).max(1)).unwrap_or(usize::MAX);
        let [mut low, mut high] = [f32::INFINITY, f32::NEG_INFINITY];
        for group in self.chunks.chunks(at_once) {
            self.read_chunks(group.to_vec(), team);
            for chunk in group.iter().filter_map(|index| self.chunk(*index)) {
                for (value, _) in chunk.values.iter().zip(&chunk.weights).filter(|(_, weight)| **weight > 0.0) {
                    (low, high) = (low.min(*value), high.max(*value));
                }
            }
        }
        self.placed.range_of((low <= high).then_some([low, high]))
    }

    fn read_chunks(&self, mut wanted: Vec<[u64; 3]>, team: Option<&Team>) {
        Sharing::of(team).chunks(&mut wanted, 1, |_, index| drop(self.chunk(index[0])));
    }

    /// Returns the first error of reading, once.
    pub fn fault(&self) -> Option<OmeZarrError> {
        self.fault.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Returns a chunk; `None` if it holds nothing.
    fn chunk(&self, index: [u64; 3]) -> Option<Arc<Chunk>> {
        self.chunks.binary_search(&index).ok()?;
        if let Some(chunk) = self.cache.get(index) {
            return Some(chunk);
        }
        // Neighbours, which are needed at about the same time, have other locks.
        let lock = (index[0] * 16 + index[1] * 4 + index[2]) as usize % LOCKS;
        let _reading = self.locks[lock].lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(chunk) = self.cache.get(index) {
            return Some(chunk);
        }
        self.chunks_read.fetch_add(1, Ordering::Relaxed);
        let edges = self.level.values.chunk;
        let first: [u64; 3] = std::array::from_fn(|a| index[a] * edges[a]);
        let size: [u64; 3] = std::array::from_fn(|a| edges[a].min(self.level.values.shape[a] - first[a]));
        // A thread that holds the lock must not take up other work, which may need it.
        match self.level.read(first, size, false) {
            Ok([mut values, mut weights]) => {
                for (value, weight) in values.iter_mut().zip(&mut weights) {
                    let is_seen = *weight > SEEN && weight.is_finite();
                    if is_seen && !value.is_finite() {
                        self.has_not_finite.store(true, Ordering::Relaxed);
                    }
                    if !(is_seen && value.is_finite()) {
                        (*value, *weight) = (0.0, 0.0);
                    }
                }
                let bytes = size_of_val(&*values) + size_of_val(&*weights);
                let chunk = Arc::new(Chunk { values, weights, size: size.map(|n| n as usize) });
                self.cache.put(index, chunk.clone(), bytes as u64);
                Some(chunk)
            }
            Err(error) => {
                let mut fault = self.fault.lock().unwrap_or_else(PoisonError::into_inner);
                fault.get_or_insert(error);
                None
            }
        }
    }

    /// Returns an element's chunk and its place there, along z, y, x; `None` beyond the level.
    fn locate(&self, voxel: [i64; 3]) -> Option<([u64; 3], [usize; 3])> {
        let (shape, edges) = (self.level.values.shape, self.level.values.chunk);
        let (mut chunk, mut place) = ([0; 3], [0; 3]);
        for (a, axis) in [2, 1, 0].into_iter().enumerate() {
            let element = voxel[axis].checked_sub(self.placed.offset()[axis])?;
            let element = u64::try_from(element).ok().filter(|element| *element < shape[a])?;
            (chunk[a], place[a]) = (element / edges[a], (element % edges[a]) as usize);
        }
        Some((chunk, place))
    }
}

/// Returns the chunks that may hold seen voxels, sorted.
fn seen_chunks(level: &Level) -> Result<Vec<[u64; 3]>, OmeZarrError> {
    match &level.weights {
        // Weights may be cut into other chunks than values.
        Some(weights) if weights.chunk == level.values.chunk && weights.fill == 0.0 => weights.stored_chunks(),
        None if level.unseen.is_some() => level.values.stored_chunks(),
        _ => Ok(level.values.all_chunks()),
    }
}

/// Returns the bricks that chunks meet, each once, chunk by chunk, on the canonical lattice of that
/// offset. Bricks are then read with few chunks in memory.
fn bricks(level: &Level, offset: [i64; 3], chunks: &[[u64; 3]]) -> Vec<BrickIndex> {
    let edge = EDGE as i64;
    let mut bricks = Vec::new();
    let mut met = HashSet::new();
    for chunk in chunks {
        let ends: [[i64; 2]; 3] = std::array::from_fn(|axis| {
            let a = 2 - axis;
            let first = (chunk[a] * level.values.chunk[a]) as i64;
            let last = ((chunk[a] + 1) * level.values.chunk[a]).min(level.values.shape[a]) as i64 - 1;
            [first, last].map(|at| at.saturating_add(offset[axis]).div_euclid(edge))
        });
        for z in ends[2][0]..=ends[2][1] {
            for y in ends[1][0]..=ends[1][1] {
                for x in ends[0][0]..=ends[0][1] {
                    // Rendering is limited to 31-bit indices.
                    if let [Ok(x), Ok(y), Ok(z)] = [x, y, z].map(i32::try_from)
                        && met.insert([x, y, z])
                    {
                        bricks.push([x, y, z]);
                    }
                }
            }
        }
    }
    bricks
}

impl Values for LevelValues {
    fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
        assert_eq!(value.len(), weight.len(), "a value and a weight a voxel");
        value.fill(0.0);
        weight.fill(0.0);
        let mut done = 0;
        while done < value.len() {
            let voxel = [start[0].saturating_add(done as i64), start[1], start[2]];
            let Some((index, [z, y, x])) = self.locate(voxel) else {
                // Before the level, or behind it.
                let ahead = self.placed.offset()[0].saturating_sub(voxel[0]);
                if ahead <= 0 {
                    return;
                }
                done = done.saturating_add(ahead as usize);
                continue;
            };
            let shape = self.level.values.shape[2] - index[2] * self.level.values.chunk[2];
            let width = self.level.values.chunk[2].min(shape) as usize;
            let count = (width - x).min(value.len() - done);
            if let Some(chunk) = self.chunk(index) {
                let at = (z * chunk.size[1] + y) * chunk.size[2] + x;
                value[done..done + count].copy_from_slice(&chunk.values[at..at + count]);
                weight[done..done + count].copy_from_slice(&chunk.weights[at..at + count]);
            }
            done += count;
        }
    }

    fn brick(&self, block: BrickIndex, value: &mut [f32; VOXELS], weight: &mut [f32; VOXELS]) {
        let first = block.map(|b| i64::from(b) * EDGE as i64);
        let last = first.map(|at| at + EDGE as i64 - 1);
        match (self.locate(first), self.locate(last)) {
            // Most bricks lie in one chunk, which is then looked up once.
            (Some((index, [z, y, x])), Some((of_last, _))) if index == of_last => {
                let Some(chunk) = self.chunk(index) else {
                    value.fill(0.0);
                    weight.fill(0.0);
                    return;
                };
                for (line, (value, weight)) in
                    value.chunks_exact_mut(EDGE).zip(weight.chunks_exact_mut(EDGE)).enumerate()
                {
                    let at = ((z + line / EDGE) * chunk.size[1] + y + line % EDGE) * chunk.size[2] + x;
                    value.copy_from_slice(&chunk.values[at..at + EDGE]);
                    weight.copy_from_slice(&chunk.weights[at..at + EDGE]);
                }
            }
            _ => {
                for (line, (value, weight)) in
                    value.chunks_exact_mut(EDGE).zip(weight.chunks_exact_mut(EDGE)).enumerate()
                {
                    let start = [first[0], first[1] + (line % EDGE) as i64, first[2] + (line / EDGE) as i64];
                    self.values(start, value, weight);
                }
            }
        }
    }

    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        Box::new(self.bricks.iter().copied())
    }
}
