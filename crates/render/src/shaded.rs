//! The classified and lit voxels of the render region: premultiplied colour and opacity of each,
//! in bricks that hold every cell that begins in them.
//!
//! A cell is the cube between eight voxels. The cells of a brick's last voxels end in the
//! neighbours. Each brick therefore also keeps the first voxels of the seven neighbours beyond
//! it, 9³ in all, so that a sample finds all eight in one place.

mod borders;
mod brick;
mod neighbours;
mod relighting;
mod shading;

use std::ops::Range;

use simd::Simd;
use simd::sharing::Sharing;
use volume::brick::EDGE;

use super::classify::interval::Interval;
use super::classify::shade::Shader;
use super::region::RenderRegion;
use super::snapshot::{ABSENT, Bits, BrickTable, Changed, VoxelSnapshot, apart, begins_in};
use super::stock::Stock;
use super::work::RenderWork;
use brick::Border;
pub(super) use brick::{CELLS, SIDE, ShadedBrick};
use shading::{Outcome, Shading, Task};

/// Bricks that one thread task shades.
const BRICKS_PER_TASK: usize = 4;

/// A box of changed voxels, both ends inclusive, region coordinates: samples within a voxel of
/// it may have changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Dirty {
    pub(super) low: [i64; 3],
    pub(super) high: [i64; 3],
}

/// The shaded voxels of a render region.
pub(super) struct Shaded<const C: usize> {
    table: BrickTable,
    bricks: Vec<Box<ShadedBrick<C>>>,
    /// Slots like the table's, but without the bricks in which every sample is transparent.
    visible: Vec<u32>,
    interval: Interval,
    stock: Stock<ShadedBrick<C>>,
    /// Scratch of [`Self::copy_to_those_before`].
    borders: Vec<Border<C>>,
}

/// A brick with changed voxels.
struct Done<const C: usize> {
    at: [i64; 3],
    /// New brick to be stored.
    fresh: Option<Box<ShadedBrick<C>>>,
    /// Voxels that have changed.
    lit: Bits,
    /// Whether any sample that depends on them could be visible before.
    was_seen: bool,
}

impl<const C: usize> Shaded<C> {
    /// Creates an empty set. Bricks whose intensities lie outside of the interval are not
    /// sampled. Up to `stocked` bricks are made in advance.
    pub(super) fn new(region: &RenderRegion, interval: Interval, stocked: usize) -> Self {
        let table = BrickTable::new(region.bricks());
        let visible = table.slots().to_vec();
        let stock = Stock::new(ShadedBrick::transparent, stocked);
        // Room for all: a table that grows is moved to fresh memory.
        Self { bricks: Vec::with_capacity(table.slots().len()), table, visible, interval, stock, borders: Vec::new() }
    }

    /// Returns the slots by index of all bricks in which a sample may be anything but
    /// transparent.
    pub(super) fn visible(&self) -> &[u32] {
        &self.visible
    }

    /// Returns the slots by index of all stored bricks.
    pub(super) fn kept(&self) -> &[u32] {
        self.table.slots()
    }

    /// Returns the number of bricks along each axis.
    pub(super) fn size(&self) -> [u32; 3] {
        self.table.size()
    }

    /// Returns the brick at a place, if samples there may be anything but transparent.
    pub(super) fn filled(&self, at: [i64; 3]) -> Option<&ShadedBrick<C>> {
        self.bricks.get(self.visible[self.table.index(at)?] as usize).map(|brick| &**brick)
    }

    /// Returns the places of all bricks in which a sample may be anything but transparent.
    pub(super) fn places(&self) -> impl Iterator<Item = [i64; 3]> {
        self.visible.iter().enumerate().filter(|(_, slot)| **slot != ABSENT).map(|(index, _)| self.table.place(index))
    }

    /// Returns the bricks by slot.
    pub(super) fn bricks(&self) -> &[Box<ShadedBrick<C>>] {
        &self.bricks
    }

    /// Shades the given voxels again and adds the boxes of changed ones to `dirty`, except where
    /// samples were and are transparent. Adds the places of bricks that have become visible to
    /// `appeared`. Returns the number of shaded voxels, and of bricks that were not prepared.
    pub(super) fn update(
        &mut self,
        snapshot: &VoxelSnapshot,
        voxels: &[Changed],
        shader: &Shader<f32>,
        (simd, sharing): (Simd, Sharing),
        dirty: &mut Vec<Dirty>,
        appeared: &mut Vec<[i64; 3]>,
    ) -> RenderWork {
        let mut order: Vec<(usize, &Changed)> =
            voxels.iter().map(|changed| (self.table.get(changed.at).unwrap_or(usize::MAX), changed)).collect();
        order.sort_by_key(|(slot, _)| *slot);
        let kept = order.partition_point(|(slot, _)| *slot != usize::MAX);
        let mut bricks = apart(&mut self.bricks, order[..kept].iter().map(|(slot, _)| *slot));
        let mut tasks: Vec<Task<C>> = order
            .iter()
            .map(|(_, changed)| Task {
                changed,
                brick: bricks.next().map(|brick| &mut **brick),
                fresh: None,
                outcome: Outcome::default(),
            })
            .collect();
        drop(bricks);
        let (interval, stock) = (self.interval, &self.stock);
        sharing.chunks(&mut tasks, BRICKS_PER_TASK, |_, tasks| {
            for task in tasks {
                task.outcome = simd.wide(Shading { snapshot, shader, interval: &interval, stock, task: &mut *task });
            }
        });
        let mut shaded = 0;
        let mut done = Vec::with_capacity(tasks.len());
        for Task { changed, fresh, outcome, .. } in tasks {
            shaded += outcome.shaded;
            if outcome.lit != Bits::default() {
                done.push(Done { at: changed.at, fresh, lit: outcome.lit, was_seen: true });
            }
        }
        for Done { at, fresh, was_seen, .. } in &mut done {
            *was_seen = self.may_be_seen_about(*at);
            if let (Some(brick), Some(index)) = (fresh.take(), self.table.index(*at)) {
                // Neighbours that hold visible voxels are stored already, and copy their shared
                // voxels themselves.
                self.add(index, brick);
            }
        }
        let changed: Vec<([i64; 3], Bits)> = done.iter().map(|Done { at, lit, .. }| (*at, *lit)).collect();
        let written = self.copy_to_those_before(&changed, sharing);
        let own: Vec<usize> = changed.iter().filter_map(|(at, _)| self.table.index(*at)).collect();
        for index in own.into_iter().chain(written) {
            if self.update_visibility(index) {
                appeared.push(self.table.place(index));
            }
        }
        for Done { at, lit, was_seen, .. } in done {
            if was_seen || self.may_be_seen_about(at) {
                dirty.extend(surrounding(at, &lit));
            }
        }
        let bricks_unprepared = self.stock.refill();
        RenderWork { voxels_shaded: shaded, bricks_unprepared, ..RenderWork::default() }
    }

    /// Returns whether any sample that depends on a brick's voxels may be anything but
    /// transparent.
    fn may_be_seen_about(&self, at: [i64; 3]) -> bool {
        let Some(reach) = self.interval.reach() else { return true };
        let side = 2 * reach + 1;
        (0..side.pow(3)).any(|i| {
            let beside = [i % side - reach, i / side % side - reach, i / (side * side) - reach];
            self.filled(std::array::from_fn(|a| at[a] + beside[a])).is_some()
        })
    }

    fn add(&mut self, index: usize, brick: Box<ShadedBrick<C>>) -> usize {
        self.table.set(index, self.bricks.len() as u32);
        self.bricks.push(brick);
        self.bricks.len() - 1
    }

    /// Notes whether anything of a brick is visible; returns whether it has become visible.
    fn update_visibility(&mut self, index: usize) -> bool {
        let slot = self.table.slots()[index];
        let may_show = slot != ABSENT && self.interval.may_show(self.bricks[slot as usize].sides);
        let before = std::mem::replace(&mut self.visible[index], if may_show { slot } else { ABSENT });
        may_show && before == ABSENT
    }

    /// Moves all bricks into a wider region, each by so many bricks.
    pub(super) fn widen(&mut self, region: &RenderRegion, by: [i64; 3], stocked: usize) {
        let (wider, index) = self.table.widened(region.bricks(), by);
        let mut visible = vec![ABSENT; wider.slots().len()];
        for (at, slot) in self.visible.iter().enumerate().filter(|(_, slot)| **slot != ABSENT) {
            visible[index(at)] = *slot;
        }
        drop(index);
        self.bricks.reserve(visible.len() - self.bricks.len());
        self.stock.hold(stocked);
        (self.table, self.visible) = (wider, visible);
    }

    /// Takes over the bricks of another set of the region, within some layers of voxels that it
    /// does not hold itself.
    pub(super) fn adopt(&mut self, other: Self, layers: &Range<i64>) {
        let mut bricks: Vec<Option<Box<ShadedBrick<C>>>> = other.bricks.into_iter().map(Some).collect();
        for (index, slot) in other.table.slots().iter().enumerate() {
            if begins_in(other.table.place(index), layers)
                && let Some(brick) = bricks.get_mut(*slot as usize).and_then(Option::take)
            {
                self.add(index, brick);
                self.update_visibility(index);
            }
        }
    }

    pub(super) fn bytes(&self) -> u64 {
        let brick = size_of::<ShadedBrick<C>>() + size_of::<Box<ShadedBrick<C>>>();
        (2 * size_of_val(self.table.slots()) + (self.bricks.len() + self.stock.len()) * brick) as u64
    }
}

/// Returns the bounding box of a brick's voxels; `None` if there are none.
fn surrounding(at: [i64; 3], voxels: &Bits) -> Option<Dirty> {
    let all = voxels.iter().fold(0, |all, layer| all | layer);
    let columns = (0..EDGE).fold(0, |columns, y| columns | (all >> (EDGE * y)) as u8);
    let layers = (0..EDGE).fold(0, |layers, z| layers | u8::from(voxels[z] != 0) << z);
    // From the first set bit to the last: along y by rows of eight.
    let span = |bits: u8| [i64::from(bits.trailing_zeros()), 7 - i64::from(bits.leading_zeros())];
    let spans =
        [span(columns), [all.trailing_zeros() / 8, 7 - all.leading_zeros().min(63) / 8].map(i64::from), span(layers)];
    let end = |of: usize| std::array::from_fn(|a: usize| at[a] * EDGE as i64 + spans[a][of]);
    (all != 0).then(|| Dirty { low: end(0), high: end(1) })
}

#[cfg(test)]
mod tests;
