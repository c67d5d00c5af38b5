//! Values and weights of two rows of voxels and of their neighbours, in the lanes of a vector.

use simd::LANES;
use simd::wide::{Set, Wide};
use volume::brick::{EDGE, VOXELS};

use crate::snapshot::Brick;

/// Consecutive rows along x that fill the lanes of a vector: two.
pub(super) const ROWS: usize = LANES / EDGE;
/// Missing bricks count as unseen.
static UNSEEN: Brick = Brick { value: [0.0; VOXELS], weight: [0.0; VOXELS] };

/// Places of the lanes along x and y.
const OFFSETS: [[f32; LANES]; 2] = [
    [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0],
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
];

/// Returns the region coordinates of the voxels of two rows, the first row at [y, z] of a brick.
#[inline(always)]
pub(super) fn at<S: Set>(brick: [i64; 3], [y, z]: [usize; 2]) -> [Wide<S>; 3] {
    let origin = brick.map(|b| (b * EDGE as i64) as f32);
    [
        Wide::splat(origin[0]) + Wide::load(&OFFSETS[0]),
        Wide::splat(origin[1] + y as f32) + Wide::load(&OFFSETS[1]),
        Wide::splat(origin[2] + z as f32),
    ]
}

/// Returns the voxels of two rows, the first one beginning at a place.
#[inline(always)]
pub(super) fn centre<S: Set>(own: &Brick, place: usize) -> (Wide<S>, Wide<S>) {
    (lanes(&own.value, place), lanes(&own.weight, place))
}

/// Returns the neighbours of [`centre`] along x, y and z.
#[inline(always)]
pub(super) fn around<S: Set>(own: &Brick, beside: [Option<&Brick>; 6], place: usize) -> [Beside<S>; 3] {
    [along_x(own, beside, place), along_y(own, beside, place), along_z(own, beside, place)]
}

/// Value and weight of the voxels before and behind those of two rows, along an axis.
pub(super) type Beside<S> = [(Wide<S>, Wide<S>); 2];

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
