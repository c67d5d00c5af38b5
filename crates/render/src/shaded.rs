//! The classified and lit voxels of the render region: premultiplied colour and opacity of each,
//! in bricks that hold every cell that begins in them.
//!
//! A cell is the cube between eight voxels. The cells of a brick's last voxels end in the
//! neighbours. Each brick therefore also keeps the first voxels of the seven neighbours beyond
//! it, 9³ in all, so that a sample finds all eight in one place.

use std::ops::Range;

use simd::sharing::Sharing;
use simd::wide::{Job, Set, Wide};
use simd::{LANES, Simd};
use volume::brick::{EDGE, VOXELS};

use super::classify::interval::{Interval, SIDES, Side};
use super::classify::shade::{Lit, Shader};
use super::classify::steepness::steepest;
use super::region::RenderRegion;
use super::snapshot::{ABSENT, Bits, Brick, BrickTable, Changed, FIRST_X, VoxelSnapshot, apart, begins_in};

/// Voxels along an edge of a brick, including those kept of its neighbours.
pub(super) const SIDE: usize = EDGE + 1;
/// Voxels of such a brick.
pub(super) const CELLS: usize = SIDE * SIDE * SIDE;

/// Bricks that one thread task shades.
const BRICKS_PER_TASK: usize = 4;

/// Colour (premultiplied) and opacity of a step, x fastest. The numbers of a voxel are adjacent
/// in memory, and so are neighbours along x: a sample is four loads.
#[derive(Clone)]
pub(super) struct ShadedBrick<const C: usize> {
    pub(super) cells: [Lit<f32, C>; CELLS],
    /// Number of voxels on each [`Side`].
    sides: [u16; SIDES],
}

impl<const C: usize> ShadedBrick<C> {
    fn transparent() -> Box<Self> {
        let mut sides = [0; SIDES];
        sides[Side::Clear as usize] = CELLS as u16;
        Box::new(Self { cells: [Lit { colour: [0.0; C], alpha: 0.0 }; CELLS], sides })
    }

    /// Returns whether the given voxels of a layer are transparent.
    fn is_clear(&self, z: usize, voxels: u64) -> bool {
        voxels_of(z, voxels).all(|voxel| self.cells[cell(voxel)].alpha == 0.0)
    }

    /// Returns whether a cell holds these bits.
    #[inline(always)]
    fn is(&self, cell: usize, lit: &Lit<f32, C>) -> bool {
        let before = &self.cells[cell];
        let mut same = before.alpha.to_bits() == lit.alpha.to_bits();
        for c in 0..C {
            same &= before.colour[c].to_bits() == lit.colour[c].to_bits();
        }
        same
    }

    #[inline(always)]
    fn set(&mut self, cell: usize, lit: &Lit<f32, C>, interval: &Interval) {
        self.sides[interval.side(&self.cells[cell]) as usize] -= 1;
        self.sides[interval.side(lit) as usize] += 1;
        self.cells[cell] = *lit;
    }
}

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
}

/// A brick with voxels to be shaded, and the outcome.
struct Task<'a, const C: usize> {
    changed: &'a Changed,
    /// Stored brick; `None` while all of it is transparent.
    brick: Option<&'a mut ShadedBrick<C>>,
    /// New brick to be stored.
    fresh: Option<Box<ShadedBrick<C>>>,
    outcome: Outcome,
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

/// Result of shading a brick's voxels.
#[derive(Default)]
struct Outcome {
    /// Number of voxels shaded.
    shaded: u64,
    /// Voxels that have changed.
    lit: Bits,
}

impl<const C: usize> Shaded<C> {
    /// Creates an empty set. Bricks whose intensities lie outside of the interval are not
    /// sampled.
    pub(super) fn new(region: &RenderRegion, interval: Interval) -> Self {
        let table = BrickTable::new(region.bricks());
        let visible = table.slots().to_vec();
        Self { table, bricks: Vec::new(), visible, interval }
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
    /// samples were and are transparent. Returns the number of shaded voxels.
    pub(super) fn update(
        &mut self,
        snapshot: &VoxelSnapshot,
        voxels: &[Changed],
        shader: &Shader<f32>,
        simd: Simd,
        sharing: Sharing,
        dirty: &mut Vec<Dirty>,
    ) -> u64 {
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
        let interval = self.interval;
        sharing.chunks(&mut tasks, BRICKS_PER_TASK, |_, tasks| {
            for task in tasks {
                task.outcome = simd.wide(Shading { snapshot, shader, interval: &interval, task: &mut *task });
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
        for Done { at, lit, .. } in &done {
            if let Some(index) = self.table.index(*at) {
                self.update_visibility(index);
            }
            self.copy_to_those_before(*at, lit);
        }
        for Done { at, lit, was_seen, .. } in done {
            if was_seen || self.may_be_seen_about(at) {
                dirty.extend(surrounding(at, &lit));
            }
        }
        shaded
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

    /// Copies a brick's voxels to the preceding bricks that also keep them: each takes a face,
    /// an edge or the corner.
    fn copy_to_those_before(&mut self, at: [i64; 3], voxels: &Bits) {
        /// Row y = 0 of a layer's bits.
        const FIRST_Y: u64 = 0xFF;
        let Some(own) = self.table.get(at) else { return };
        for back in 1..8_usize {
            let back = [back & 1, back >> 1 & 1, back >> 2];
            let shared = if back[0] == 1 { FIRST_X } else { u64::MAX } & if back[1] == 1 { FIRST_Y } else { u64::MAX };
            let layers = if back[2] == 1 { 1 } else { EDGE };
            let changed = |z: usize| voxels[z] & shared;
            if (0..layers).all(|z| changed(z) == 0) {
                continue;
            }
            let place: [i64; 3] = std::array::from_fn(|a| at[a] - back[a] as i64);
            let Some(index) = self.table.index(place) else { continue };
            let slot = match self.table.slots()[index] {
                // Transparent voxels need no brick.
                ABSENT if (0..layers).all(|z| self.bricks[own].is_clear(z, changed(z))) => continue,
                ABSENT => self.add(index, ShadedBrick::transparent()),
                slot => slot as usize,
            };
            // The two slots differ.
            let Ok([from, into]) = self.bricks.get_disjoint_mut([own, slot]) else { continue };
            for z in 0..layers {
                for voxel in voxels_of(z, changed(z)) {
                    into.set(
                        cell(std::array::from_fn(|a| voxel[a] + back[a] * EDGE)),
                        &from.cells[cell(voxel)],
                        &self.interval,
                    );
                }
            }
            self.update_visibility(index);
        }
    }

    fn add(&mut self, index: usize, brick: Box<ShadedBrick<C>>) -> usize {
        self.table.set(index, self.bricks.len() as u32);
        self.bricks.push(brick);
        self.bricks.len() - 1
    }

    /// Notes whether anything of a brick is visible.
    fn update_visibility(&mut self, index: usize) {
        let slot = self.table.slots()[index];
        let may_show = slot != ABSENT && self.interval.may_show(self.bricks[slot as usize].sides);
        self.visible[index] = if may_show { slot } else { ABSENT };
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
        (2 * size_of_val(self.table.slots()) + self.bricks.len() * brick) as u64
    }
}

/// Returns the cell that begins at a voxel of a brick.
fn cell([x, y, z]: [usize; 3]) -> usize {
    (z * SIDE + y) * SIDE + x
}

/// Returns the voxels of a layer whose bits are set.
fn voxels_of(z: usize, mut left: u64) -> impl Iterator<Item = [usize; 3]> {
    std::iter::from_fn(move || {
        let inside = (left != 0).then(|| left.trailing_zeros() as usize)?;
        left &= left - 1;
        Some([inside % EDGE, inside / EDGE, z])
    })
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

/// Shades the voxels of a brick that may have changed, and stores those that have.
struct Shading<'a, 'b, const C: usize> {
    snapshot: &'a VoxelSnapshot,
    shader: &'a Shader<f32>,
    interval: &'a Interval,
    task: &'a mut Task<'b, C>,
}

/// Consecutive rows along x that fill the lanes of a vector: two.
const ROWS: usize = LANES / EDGE;
/// Missing bricks count as unseen.
static UNSEEN: Brick = Brick { value: [0.0; VOXELS], weight: [0.0; VOXELS] };

impl<const C: usize> Job for Shading<'_, '_, C> {
    type Output = Outcome;

    #[inline(always)]
    fn run<S: Set>(self) -> Outcome {
        let Self { snapshot, shader, interval, task: Task { changed, brick: kept, fresh, .. } } = self;
        let mut outcome = Outcome::default();
        let Some((own, beside)) = snapshot.neighbourhood(changed.at) else { return outcome };
        let origin = changed.at.map(|b| (b * EDGE as i64) as f32);
        let mut values = shader.visible();
        if shader.hides_flat() {
            values = shader.visible_below(steepest::<S>(own, beside, shader.pitch_mm()));
        }
        for (z, layer) in changed.voxels.iter().enumerate() {
            for y in (0..EDGE).step_by(ROWS) {
                let due = (layer >> (EDGE * y)) as u16;
                if due == 0 {
                    continue;
                }
                let place = (z * EDGE + y) * EDGE;
                let centre = (lanes::<S>(&own.value, place), lanes::<S>(&own.weight, place));
                let visible = Wide::<S>::bits(Shader::may_show_between(values, centre)) & due;
                outcome.shaded += u64::from(visible.count_ones());
                let mut rows = Rows { colour: [[0.0; LANES]; C], alpha: [0.0; LANES] };
                if visible != 0 {
                    let around =
                        [along_x(own, beside, place), along_y(own, beside, place), along_z(own, beside, place)];
                    let [x, y, z] = [origin[0], origin[1] + y as f32, origin[2] + z as f32];
                    let at = [
                        Wide::splat(x) + Wide::load(&OFFSETS[0]),
                        Wide::splat(y) + Wide::load(&OFFSETS[1]),
                        Wide::splat(z),
                    ];
                    let lit = shader.shade_all::<Wide<S>, C>(centre, around, at);
                    lit.alpha.store(&mut rows.alpha);
                    for c in 0..C {
                        lit.colour[c].store(&mut rows.colour[c]);
                    }
                }
                let into = match (&mut *kept, &mut *fresh) {
                    (Some(brick), _) => &mut **brick,
                    (None, Some(brick)) => &mut **brick,
                    (None, None) if rows.alpha == [0.0; LANES] => continue,
                    (None, fresh) => &mut **fresh.insert(ShadedBrick::transparent()),
                };
                let lit = into.put([y, z], due, &rows, interval);
                outcome.lit[z] |= u64::from(lit) << (EDGE * y);
            }
        }
        outcome
    }
}

/// Places of the lanes along x and y.
const OFFSETS: [[f32; LANES]; 2] = [
    [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0],
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
];

/// Shaded voxels of two rows.
struct Rows<const C: usize> {
    colour: [[f32; LANES]; C],
    alpha: [f32; LANES],
}

impl<const C: usize> ShadedBrick<C> {
    /// Stores the voxels of two rows whose bits are set, the first row at [y, z]; returns those
    /// that have changed.
    #[inline(always)]
    fn put(&mut self, [y, z]: [usize; 2], due: u16, rows: &Rows<C>, interval: &Interval) -> u16 {
        let (mut left, mut changed) = (due, 0);
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            let mut lit = Lit { colour: [0.0; C], alpha: rows.alpha[lane] };
            for c in 0..C {
                lit.colour[c] = rows.colour[c][lane];
            }
            let cell = cell([lane % EDGE, y + lane / EDGE, z]);
            if !self.is(cell, &lit) {
                self.set(cell, &lit, interval);
                changed |= 1 << lane;
            }
        }
        changed
    }
}

/// Value and weight of the voxels before and behind those of two rows, along an axis.
type Beside<S> = [(Wide<S>, Wide<S>); 2];

#[inline(always)]
fn lanes<S: Set>(voxels: &[f32; VOXELS], place: usize) -> Wide<S> {
    let mut rows = [0.0; LANES];
    rows.copy_from_slice(&voxels[place..place + LANES]);
    Wide::load(&rows)
}

#[inline(always)]
fn along_x<S: Set>(own: &Brick, beside: [Option<&Brick>; 6], place: usize) -> Beside<S> {
    let (before, behind) = (beside[0].unwrap_or(&UNSEEN), beside[1].unwrap_or(&UNSEEN));
    [
        (shifted_up(&own.value, &before.value, place), shifted_up(&own.weight, &before.weight, place)),
        (shifted_down(&own.value, &behind.value, place), shifted_down(&own.weight, &behind.weight, place)),
    ]
}

/// Returns rows that begin with the last voxel of the brick before.
#[inline(always)]
fn shifted_up<S: Set>(own: &[f32; VOXELS], before: &[f32; VOXELS], place: usize) -> Wide<S> {
    let mut rows = [0.0; LANES];
    for row in 0..ROWS {
        let (at, from) = (row * EDGE, place + row * EDGE);
        rows[at] = before[from + EDGE - 1];
        rows[at + 1..at + EDGE].copy_from_slice(&own[from..from + EDGE - 1]);
    }
    Wide::load(&rows)
}

/// Returns rows that end with the first voxel of the brick behind.
#[inline(always)]
fn shifted_down<S: Set>(own: &[f32; VOXELS], behind: &[f32; VOXELS], place: usize) -> Wide<S> {
    let mut rows = [0.0; LANES];
    for row in 0..ROWS {
        let (at, from) = (row * EDGE, place + row * EDGE);
        rows[at..at + EDGE - 1].copy_from_slice(&own[from + 1..from + EDGE]);
        rows[at + EDGE - 1] = behind[from];
    }
    Wide::load(&rows)
}

#[inline(always)]
fn along_y<S: Set>(own: &Brick, beside: [Option<&Brick>; 6], place: usize) -> Beside<S> {
    const LAST: usize = EDGE * (EDGE - 1);
    let y = place / EDGE % EDGE;
    let (before, behind) = (beside[2].unwrap_or(&UNSEEN), beside[3].unwrap_or(&UNSEEN));
    // The place of each row's neighbour, and the brick that holds it.
    let below = if y == 0 { (before, place + LAST) } else { (own, place - EDGE) };
    let above = if y + ROWS == EDGE { (behind, place + EDGE - LAST) } else { (own, place + 2 * EDGE) };
    [pair(below, (own, place)), pair((own, place + EDGE), above)]
}

/// Returns two rows from any two places.
#[inline(always)]
fn pair<S: Set>(first: (&Brick, usize), second: (&Brick, usize)) -> (Wide<S>, Wide<S>) {
    let (mut value, mut weight) = ([0.0; LANES], [0.0; LANES]);
    value[..EDGE].copy_from_slice(&first.0.value[first.1..first.1 + EDGE]);
    value[EDGE..].copy_from_slice(&second.0.value[second.1..second.1 + EDGE]);
    weight[..EDGE].copy_from_slice(&first.0.weight[first.1..first.1 + EDGE]);
    weight[EDGE..].copy_from_slice(&second.0.weight[second.1..second.1 + EDGE]);
    (Wide::load(&value), Wide::load(&weight))
}

#[inline(always)]
fn along_z<S: Set>(own: &Brick, beside: [Option<&Brick>; 6], place: usize) -> Beside<S> {
    const LAYER: usize = EDGE * EDGE;
    let z = place / LAYER;
    let (before, behind) = (beside[4].unwrap_or(&UNSEEN), beside[5].unwrap_or(&UNSEEN));
    let (below, from) = if z == 0 { (before, place + LAYER * (EDGE - 1)) } else { (own, place - LAYER) };
    let (above, to) = if z + 1 == EDGE { (behind, place % LAYER) } else { (own, place + LAYER) };
    [(lanes(&below.value, from), lanes(&below.weight, from)), (lanes(&above.value, to), lanes(&above.weight, to))]
}

#[cfg(test)]
mod tests;
