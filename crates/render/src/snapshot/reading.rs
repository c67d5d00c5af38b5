//! Reads the volume: finds the voxels that have changed, and the bricks that are to be held.
//!
//! A voxel whose value is never visible is transparent, whatever lies around it. So a brick
//! without visible values is read and tested, but neither compared nor held, unless it adjoins one
//! that shows something, whose gradients need it. In most scenes most bricks are neither. Once
//! held, a brick stays.

use simd::sharing::Sharing;
use simd::{Fused, Simd};
use volume::Values;
use volume::brick::{BrickIndex, EDGE};

use super::{
    ABSENT, Bits, Brick, Changed, FACES, UNSEEN, Visibility, VoxelSnapshot, apart, beside, difference, within_interval,
};

/// Bricks that one thread task reads.
const BRICKS_PER_TASK: usize = 8;

/// A brick to be read, and the outcome.
struct Task<'a> {
    index: usize,
    at: [i64; 3],
    brick: BrickIndex,
    /// Its slot, and its content at the last reading; `None` while it is not held.
    held: Option<(usize, &'a mut Brick)>,
    /// Whether visible values are looked for: its neighbours are not held yet.
    looks: bool,
    /// Whether it is held unless it is empty: a brick beside it needs it.
    needed: bool,
    /// Whether all that a brick not held before has is new: it is listed as changed, or it was
    /// empty when a brick beside it needed it first.
    is_new: bool,
    /// Whether a visible value was found.
    shows: bool,
    /// Content to be held from now on.
    fresh: Option<Box<Brick>>,
    voxels: Bits,
}

/// Reads a brick.
struct Reading<'a, 'b, V: ?Sized> {
    volume: &'a V,
    bounds: [[i64; 3]; 2],
    visible: [f32; 2],
    fresh: &'a mut Brick,
    task: &'a mut Task<'b>,
}

impl<V: Values + ?Sized> Fused for Reading<'_, '_, V> {
    /// Whether the content is to be held.
    type Output = bool;

    #[inline(always)]
    fn run(self) -> bool {
        let Self { volume, bounds, visible, fresh, task } = self;
        fresh.read(volume, task.brick, bounds);
        if let Some((_, held)) = &task.held {
            task.voxels = difference(fresh, held);
            let differs = any(&task.voxels);
            task.shows = differs && task.looks && any(&within_interval(fresh, visible));
            return differs;
        }
        let showing = within_interval(fresh, visible);
        let seen = if task.needed { difference(fresh, &UNSEEN) } else { [0; EDGE] };
        task.shows = any(&showing);
        // Voxels that were there before show nothing, and nothing beside them depends on them.
        task.voxels = if task.needed && task.is_new { seen } else { showing };
        task.shows || any(&seen)
    }
}

fn any(voxels: &Bits) -> bool {
    voxels.iter().any(|layer| *layer != 0)
}

impl VoxelSnapshot {
    /// Reads some bricks of the volume, given by lattice index divided by 8. Adds those with
    /// voxels of which any bit of a value or weight changed, and which can change what is seen, to
    /// `changed`; ignores those outside of the region. Bricks beside one that shows something are
    /// read, too, if they are `wanted`. Values outside of the interval `visible` are transparent.
    /// Returns the number of bricks that were not prepared.
    pub(crate) fn read(
        &mut self,
        volume: &(impl Values + ?Sized),
        bricks: &[BrickIndex],
        wanted: impl Fn(BrickIndex) -> bool,
        visible: [f32; 2],
        (simd, sharing): (Simd, Sharing),
        changed: &mut Vec<Changed>,
    ) -> u64 {
        let first = self.first_brick();
        let places = bricks.iter().map(|brick| std::array::from_fn(|a| i64::from(brick[a]) - first[a]));
        let mut due: Vec<usize> = places.filter_map(|at| self.table.index(at)).collect();
        let (mut is_listed, mut all_showing) = (true, Vec::new());
        while !due.is_empty() {
            // Each once, in their order, which is often that of the volume's memory.
            self.reached.clear();
            self.reached.resize(self.table.slots().len().div_ceil(64), 0);
            due.retain(|at| {
                let (word, bit) = (&mut self.reached[at / 64], 1 << (at % 64));
                let is_first = *word & bit == 0;
                *word |= bit;
                is_first
            });
            let showing = self.read_some(volume, &due, visible, is_listed, (simd, sharing), changed);
            // Their neighbours are needed, too. Changes since the last reading are not among these,
            // but those that another reading will list may be.
            let around = showing.iter().flat_map(|at| FACES.map(|face| beside(*at, face)));
            let around = around.filter(|at| wanted(std::array::from_fn(|a| (at[a] + first[a]) as i32)));
            due = around.filter_map(|at| self.table.index(at)).filter(|at| self.table.slots()[*at] == ABSENT).collect();
            is_listed = false;
            all_showing.extend(showing);
        }
        for slot in all_showing.into_iter().filter_map(|at| self.table.get(at)) {
            self.visibility[slot] = Visibility::Before;
        }
        self.stock.refill()
    }

    /// Reads the bricks at some indices of the table, each once. Returns the places of those that
    /// show something for the first time.
    fn read_some(
        &mut self,
        volume: &(impl Values + ?Sized),
        due: &[usize],
        visible: [f32; 2],
        is_listed: bool,
        (simd, sharing): (Simd, Sharing),
        changed: &mut Vec<Changed>,
    ) -> Vec<[i64; 3]> {
        let first = self.first_brick();
        let Self { table, bricks, visibility, stock, bounds, .. } = self;
        let (mut held, mut tasks) = (Vec::with_capacity(due.len()), Vec::with_capacity(due.len()));
        let task = |index| {
            let at = table.place(index);
            let brick = std::array::from_fn(|a| (at[a] + first[a]) as i32);
            let voxels = [0; EDGE];
            let (needed, is_new, shows) = (false, is_listed, false);
            Task { index, at, brick, held: None, looks: true, needed, is_new, shows, fresh: None, voxels }
        };
        for &index in due {
            match table.slots()[index] {
                ABSENT => {
                    let mut task = task(index);
                    let around = FACES.into_iter().filter_map(|face| table.get(beside(task.at, face)));
                    for other in around.map(|slot| visibility[slot]) {
                        task.needed |= other != Visibility::Never;
                        task.is_new |= other == Visibility::Before;
                    }
                    tasks.push(task);
                }
                slot => held.push((slot as usize, index)),
            }
        }
        held.sort_unstable();
        for (&(slot, index), brick) in held.iter().zip(apart(bricks, held.iter().map(|(slot, _)| *slot))) {
            tasks.push(Task { held: Some((slot, brick)), looks: visibility[slot] == Visibility::Never, ..task(index) });
        }
        let (bounds, stock) = (*bounds, &*stock);
        sharing.chunks(&mut tasks, BRICKS_PER_TASK, |_, tasks| {
            let mut fresh = Brick::default();
            for task in tasks {
                if !simd.fused(Reading { volume, bounds, visible, fresh: &mut fresh, task: &mut *task }) {
                    continue;
                }
                match &mut task.held {
                    Some((_, brick)) => brick.clone_from(&fresh),
                    None => task.fresh.insert(stock.take()).as_mut().clone_from(&fresh),
                }
            }
        });
        let outcomes: Vec<_> = tasks
            .into_iter()
            .map(|Task { index, at, held, shows, fresh, voxels, .. }| {
                (index, at, held.map(|(slot, _)| slot), shows, fresh, voxels)
            })
            .collect();
        let mut showing = Vec::new();
        for (index, at, slot, shows, fresh, voxels) in outcomes {
            if any(&voxels) {
                changed.push(Changed { at, voxels });
            }
            match (slot, fresh) {
                (Some(slot), _) if shows => self.visibility[slot] = Visibility::Now,
                (None, Some(brick)) => self.hold(index, brick, if shows { Visibility::Now } else { Visibility::Never }),
                _ => {}
            }
            if shows {
                showing.push(at);
            }
        }
        showing
    }

    fn first_brick(&self) -> [i64; 3] {
        self.first.map(|at| at / EDGE as i64)
    }
}
