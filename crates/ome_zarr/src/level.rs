//! A level of a volume for renderers: chunks are read when they are needed.

use std::sync::{Arc, Mutex, PoisonError};

use sonoweave_core::frames::{Transform, Volume, World};
use volume::brick::{BrickIndex, EDGE, VOXELS};
use volume::lattice::{Canonical, canonical};
use volume::{Grid, Values};

use crate::cache::Cache;
use crate::error::OmeZarrError;
use crate::reader::{Level, OmeZarr};

/// Values and weights of a level, on its [canonical](volume::lattice) lattice: voxels have the
/// indices that they have in a volume read from a file of another format.
///
/// Chunks that were read stay in memory up to a limit. Reading cannot report errors: voxels of a
/// damaged chunk are unseen, and [`Self::fault`] has the first error.
pub struct LevelValues {
    level: Arc<Level>,
    canonical: Canonical,
    slices_box: Option<[[i64; 3]; 2]>,
    /// Chunks that may hold seen voxels, by index along z, y, x, sorted.
    chunks: Vec<[u64; 3]>,
    bricks: Vec<BrickIndex>,
    cache: Cache<Chunk>,
    fault: Mutex<Option<OmeZarrError>>,
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
    /// [`OmeZarrError`] when there is no such level, or a shard's index is damaged.
    pub fn new(volume: &OmeZarr, level: usize, cache_bytes: u64) -> Result<Self, OmeZarrError> {
        let slices_box = volume.slices_box().filter(|_| level == 0);
        let level = volume.level(level)?.clone();
        let chunks = seen_chunks(&level)?;
        let canonical = canonical(level.world_from_volume);
        let bricks = bricks(&level, &canonical, &chunks);
        let (cache, fault) = (Cache::new(cache_bytes), Mutex::new(None));
        Ok(Self { level, canonical, slices_box, chunks, bricks, cache, fault })
    }

    /// Returns the grid, by the indices of the level's elements.
    pub fn grid(&self) -> Grid {
        self.level.grid
    }

    /// Maps canonical voxel indices to world mm.
    pub fn world_from_lattice(&self) -> Transform<World, Volume> {
        self.canonical.world_from_lattice
    }

    /// Converts the index of an element to its canonical index.
    pub fn index(&self, element: [i64; 3]) -> [i64; 3] {
        self.canonical.index(element)
    }

    /// First and last voxel of the box to view, by canonical index: the slices' box if the volume
    /// has one and this is level 0, else the whole level.
    pub fn bounds(&self) -> [[i64; 3]; 2] {
        let all = [[0; 3], self.level.grid.size.map(|n| n as i64 - 1)];
        let elements =
            self.slices_box.map(|ends| ends.map(|end| std::array::from_fn(|a| end[a] - self.level.first[a])));
        elements.unwrap_or(all).map(|element| self.canonical.index(element))
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
        let edges = self.level.values.chunk;
        let first: [u64; 3] = std::array::from_fn(|a| index[a] * edges[a]);
        let size: [u64; 3] = std::array::from_fn(|a| edges[a].min(self.level.values.shape[a] - first[a]));
        match self.level.read(first, size) {
            Ok([mut values, mut weights]) => {
                for (value, weight) in values.iter_mut().zip(&mut weights) {
                    if !(*weight > 0.0 && weight.is_finite() && value.is_finite()) {
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
            let element = voxel[axis].checked_sub(self.canonical.offset[axis])?;
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

/// Returns the bricks that chunks meet, each once, on the canonical lattice.
fn bricks(level: &Level, canonical: &Canonical, chunks: &[[u64; 3]]) -> Vec<BrickIndex> {
    let edge = EDGE as i64;
    let mut bricks = Vec::new();
    for chunk in chunks {
        let ends: [[i64; 2]; 3] = std::array::from_fn(|axis| {
            let a = 2 - axis;
            let first = (chunk[a] * level.values.chunk[a]) as i64;
            let last = ((chunk[a] + 1) * level.values.chunk[a]).min(level.values.shape[a]) as i64 - 1;
            [first, last].map(|at| at.saturating_add(canonical.offset[axis]).div_euclid(edge))
        });
        for z in ends[2][0]..=ends[2][1] {
            for y in ends[1][0]..=ends[1][1] {
                for x in ends[0][0]..=ends[0][1] {
                    // Rendering is limited to 31-bit indices.
                    if let [Ok(x), Ok(y), Ok(z)] = [x, y, z].map(i32::try_from) {
                        bricks.push([x, y, z]);
                    }
                }
            }
        }
    }
    bricks.sort_unstable_by_key(|[x, y, z]| [*z, *y, *x]);
    bricks.dedup();
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
                let ahead = self.canonical.offset[0].saturating_sub(voxel[0]);
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
