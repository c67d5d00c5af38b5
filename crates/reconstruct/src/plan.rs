//! A slice's work list: the bricks it will change, found before anything is changed, and the
//! insertion into them.

use simd::Simd;
use simd::sharing::{Handed, Sharing};
use volume::BrickVolume;
use volume::brick::{Ages, Brick, BrickBox, BrickIndex, Squares, Stamps};
use volume::brick_volume::Slot;

use super::entry::BrickData;
use super::insert::{Scratch, insert, touches};
use super::refusal::Refused;
use super::slab::{MaskSummary, Overlap, SlabGeometry};
use super::task::{FilteredSlice, Task};

/// Bricks that one task of a thread processes.
const BRICKS_PER_TASK: usize = 16;

/// The bricks of one slice. Reused for each slice to keep its memory.
#[derive(Default)]
pub(super) struct Plan {
    /// Bricks that may change, in the lattice's order.
    pub(super) tasks: Vec<Task>,
    /// Bricks among them that do not exist and will change: index of the task, and position.
    /// Their slots are unknown until they are created.
    pub(super) absent: Vec<(usize, BrickIndex)>,
    /// Bricks that interval tests could not exclude.
    pub(super) considered: u64,
}

impl Plan {
    /// Finds a slice's bricks in a box. A brick that does not exist is added only if a voxel of it
    /// would change.
    ///
    /// # Errors
    /// [`Refused::Memory`].
    #[allow(clippy::too_many_arguments, reason = "called once, beside the filtering of the image")]
    pub(super) fn find(
        &mut self,
        geometry: &SlabGeometry,
        bricks: &BrickBox,
        mask: &MaskSummary,
        volume: &BrickVolume,
        filtered: &FilteredSlice<'_>,
        simd: Simd,
        limit_bytes: u64,
    ) -> Result<(), Refused> {
        self.tasks.clear();
        self.absent.clear();
        self.considered = 0;
        let most = limit_bytes / volume.brick_bytes();
        let room = most.saturating_sub(volume.len() as u64);
        let rows: u64 = [1, 2].map(|a| u64::from(bricks.high[a].abs_diff(bricks.low[a])) + 1).into_iter().product();
        // A slab of n bricks spans at most about n rows; a slab with far more rows than the
        // memory holds bricks cannot fit.
        if rows / 64 > most {
            return Err(Refused::Memory { needed: rows - most, limit_bytes });
        }
        let mut scratch = Scratch::new();
        let mut finder = volume.finder();
        geometry.walk(bricks, mask, |index, overlap| {
            self.considered += 1;
            let found = finder.find(index);
            let task = Task::new(found.unwrap_or_default(), overlap, geometry.in_brick(index));
            if found.is_some() {
                self.tasks.push(task);
            } else if touches(simd, &task, filtered, &mut scratch) {
                self.absent.push((self.tasks.len(), index));
                self.tasks.push(task);
            }
            self.absent.len() as u64 <= room
        });
        match (self.absent.len() as u64).saturating_sub(room) {
            0 => Ok(()),
            needed => Err(Refused::Memory { needed, limit_bytes }),
        }
    }
}

/// A chunk of bricks with their stamps, ages and sums of squares, shared between threads that use
/// different bricks of it.
#[derive(Clone, Copy)]
pub(super) struct BrickChunk {
    bricks: Handed<Brick>,
    stamps: Option<Handed<Stamps>>,
    ages: Option<Handed<Ages>>,
    squares: Option<Handed<Squares>>,
}

/// Inserts the slice into all bricks, each brick by one thread.
#[allow(unsafe_code, reason = "hands bricks of the arena to threads")]
pub(super) fn insert_all(
    volume: &mut BrickVolume,
    chunks: &mut Vec<BrickChunk>,
    tasks: &mut [Task],
    filtered: &FilteredSlice<'_>,
    simd: Simd,
    sharing: Sharing,
) {
    chunks.clear();
    chunks.extend(volume.chunk_pointers().map(|bricks| BrickChunk {
        bricks: Handed(bricks),
        stamps: None,
        ages: None,
        squares: None,
    }));
    for (chunk, stamps) in chunks.iter_mut().zip(volume.stamp_pointers()) {
        chunk.stamps = Some(Handed(stamps));
    }
    for (chunk, ages) in chunks.iter_mut().zip(volume.age_pointers()) {
        chunk.ages = Some(Handed(ages));
    }
    for (chunk, squares) in chunks.iter_mut().zip(volume.square_pointers()) {
        chunk.squares = Some(Handed(squares));
    }
    let (chunks, volume) = (chunks.as_slice(), &*volume);
    let run = |scratch: &mut Scratch, task: &mut Task| {
        let (chunk, at) = volume.locate(task.slot);
        let chunk: BrickChunk = chunks[chunk];
        let change = filtered.rule.entry.epoch_change(volume, task.slot, filtered.time.elapsed_ns);
        // SAFETY: `chunks` holds the base of each chunk of the volume, which is borrowed
        // mutably meanwhile. `locate` gives a position inside its chunk for every slot that the
        // volume has handed out. Each brick of the lattice is visited once in a walk and has
        // its own slot, so no two tasks reach the same brick. Stamps, ages and squares, if
        // any, are arranged like bricks.
        let mut data = unsafe {
            let stamps = chunk.stamps.map(|stamps| &mut *stamps.0.add(at));
            let ages = chunk.ages.map(|ages| &mut *ages.0.add(at));
            let squares = chunk.squares.map(|squares| &mut *squares.0.add(at));
            BrickData { brick: &mut *chunk.bricks.0.add(at), stamps, ages, squares, change }
        };
        insert(simd, &mut data, task, filtered, scratch);
    };
    sharing.chunks_with(tasks, BRICKS_PER_TASK, Scratch::new, |scratch, _, tasks| {
        tasks.iter_mut().for_each(|task| run(scratch, task));
    });
}

impl Task {
    fn new(slot: Slot, overlap: Overlap, functions: [[f32; 4]; 3]) -> Self {
        Self { slot, overlap, functions, updated: 0, clamped: 0, vectors: 0 }
    }
}
