//! A volume without most of its speckle, for pictures only.
//!
//! Speckle of compressed echoes adds to the intensity. Each voxel is therefore moved towards the
//! mean of its neighbourhood, the more the less the neighbourhood varies beyond the noise
//! (Lee 1980). The noise is the median variance over the volume. A Gaussian follows. Both use sums
//! over seen voxels only, divided by their weights: unseen voxels neither darken a border nor
//! become seen.
//!
//! Only bricks are smoothed in which anything may be visible. A smoothed value lies between the
//! smallest and the largest of the voxels it is made of, so that the ranges of a brick and of those
//! around it decide.

use simd::sharing::Sharing;
use simd::{Fused, Simd};
use volume::Values;
use volume::brick::{BrickIndex, EDGE, VOXELS};

use super::work::SoftWork;
use crate::classify::soft::SoftLight;
use crate::region::RenderRegion;

/// Voxels that a smoothed voxel depends on, on each side: one for the mean, the others for the
/// Gaussian.
const REACH: usize = 4;
/// Voxels of the Gaussian on each side.
const RADIUS: usize = REACH - 1;
/// Voxels along an edge of a brick with those that it depends on.
const SIDE: usize = EDGE + 2 * REACH;
const ALL: usize = SIDE * SIDE * SIDE;
/// Voxels to the next line and layer.
const LINE: usize = SIDE;
const LAYER: usize = SIDE * SIDE;
/// Bricks of a task.
const BRICKS_PER_TASK: usize = 8;
/// Entry of the table where no brick is kept.
const NONE: u32 = u32::MAX;
/// Histogram of variances: eight bins an octave, from 2⁻¹⁶ on.
const BINS: usize = 320;

/// Values and weights of a brick.
struct Brick {
    at: [i64; 3],
    value: [f32; VOXELS],
    weight: [f32; VOXELS],
}

/// Bricks of a region by place.
struct Table {
    slots: Vec<u32>,
    size: [i64; 3],
    bricks: Vec<Brick>,
}

/// A smoothed volume, of the bricks in which anything may be visible.
pub(crate) struct Smoothed {
    first: [i64; 3],
    table: Table,
}

impl Table {
    fn new(size: [u32; 3], places: impl Iterator<Item = [i64; 3]>) -> Self {
        let mut table = Self {
            slots: vec![NONE; size.map(|n| n as usize).iter().product()],
            size: size.map(i64::from),
            bricks: Vec::new(),
        };
        for at in places {
            let Some(index) = table.index(at) else { continue };
            table.slots[index] = table.bricks.len() as u32;
            table.bricks.push(Brick { at, value: [0.0; VOXELS], weight: [0.0; VOXELS] });
        }
        table
    }

    fn index(&self, at: [i64; 3]) -> Option<usize> {
        let inside = (0..3).all(|a| (0..self.size[a]).contains(&at[a]));
        inside.then(|| ((at[2] * self.size[1] + at[1]) * self.size[0] + at[0]) as usize)
    }

    fn get(&self, at: [i64; 3]) -> Option<&Brick> {
        self.bricks.get(self.slots[self.index(at)?] as usize)
    }

    /// Returns a brick and those around it, by place from [−1, −1, −1] on, x fastest.
    fn around(&self, at: [i64; 3]) -> [Option<&Brick>; 27] {
        std::array::from_fn(|n| self.get(beside(at, n)))
    }
}

/// Returns the place of one of the 27 bricks around a place.
fn beside(at: [i64; 3], n: usize) -> [i64; 3] {
    let n = n as i64;
    [at[0] + n % 3 - 1, at[1] + n / 3 % 3 - 1, at[2] + n / 9 - 1]
}

impl Smoothed {
    /// Smooths the voxels of a volume in a region. `visible` is the interval of intensities that
    /// may be visible.
    pub(crate) fn new(
        volume: &(impl Values + ?Sized),
        region: &RenderRegion,
        (light, visible): (&SoftLight, Option<[f64; 2]>),
        (simd, sharing): (Simd, Sharing<'_>),
        work: &mut SoftWork,
    ) -> Self {
        let first = region.first();
        let mut places: Vec<[i64; 3]> = volume.bricks().filter_map(|brick| region.place(brick)).collect();
        places.sort_unstable_by_key(|[x, y, z]| [*z, *y, *x]);
        work.bricks = places.len() as u64;
        let read = |brick: &mut Brick| volume.brick(brick_index(first, brick.at), &mut brick.value, &mut brick.weight);
        let mut ranges: Vec<([i64; 3], [f32; 2])> = places.iter().map(|at| (*at, NOTHING)).collect();
        sharing.chunks(&mut ranges, BRICKS_PER_TASK, |_, ranges| {
            for (at, range) in ranges {
                let mut brick = Brick { at: *at, value: [0.0; VOXELS], weight: [0.0; VOXELS] };
                read(&mut brick);
                *range = range_of(&brick);
            }
        });
        let places = visible.map_or_else(Vec::new, |visible| seen_places(region.bricks(), &ranges, visible));
        work.bricks_smoothed = places.len() as u64;
        // Those around are needed, too.
        let mut needed: Vec<[i64; 3]> = places.iter().flat_map(|at| (0..27).map(|n| beside(*at, n))).collect();
        needed.sort_unstable_by_key(|[x, y, z]| [*z, *y, *x]);
        needed.dedup();
        let mut raw = Table::new(region.bricks(), needed.into_iter());
        sharing.chunks(&mut raw.bricks, BRICKS_PER_TASK, |_, bricks| bricks.iter_mut().for_each(read));
        let noise = visible.map_or(0.0, |visible| noise(&raw, &places, visible, (simd, sharing)));
        work.noise = noise;
        let taps = taps(light.smoothing);
        let mut table = Table::new(region.bricks(), places.into_iter());
        sharing.chunks_with(&mut table.bricks, BRICKS_PER_TASK, Scratch::new, |scratch, _, bricks| {
            for brick in bricks {
                simd.fused(Smooth { around: raw.around(brick.at), taps, noise, scratch, brick });
            }
        });
        Self { first, table }
    }

    /// Returns values and weights of the smoothed bricks by place in the region, x fastest.
    pub(super) fn smoothed_bricks(&self) -> impl Iterator<Item = ([i64; 3], &[f32; VOXELS], &[f32; VOXELS])> {
        self.table.bricks.iter().map(|brick| (brick.at, &brick.value, &brick.weight))
    }
}

fn brick_index(first: [i64; 3], at: [i64; 3]) -> BrickIndex {
    std::array::from_fn(|a| (at[a] + first[a] / EDGE as i64) as i32)
}

const NOTHING: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

/// Returns the smallest and the largest seen value.
fn range_of(brick: &Brick) -> [f32; 2] {
    let seen = brick.value.iter().zip(&brick.weight).filter(|(_, weight)| **weight > 0.0);
    seen.fold(NOTHING, |[low, high], (value, _)| [low.min(*value), high.max(*value)])
}

/// Returns the places at which anything seen may be visible once it is smoothed.
fn seen_places(size: [u32; 3], ranges: &[([i64; 3], [f32; 2])], [low, high]: [f64; 2]) -> Vec<[i64; 3]> {
    let table = Table { slots: Vec::new(), size: size.map(i64::from), bricks: Vec::new() };
    let mut of = vec![NOTHING; size.map(|n| n as usize).iter().product()];
    for (at, range) in ranges {
        if let Some(index) = table.index(*at) {
            of[index] = *range;
        }
    }
    let may_show = |at: [i64; 3]| {
        let all = (0..27)
            .filter_map(|n| table.index(beside(at, n)))
            .fold(NOTHING, |[low, high], index| [low.min(of[index][0]), high.max(of[index][1])]);
        f64::from(all[0]) <= high && f64::from(all[1]) >= low
    };
    let own = |[low, high]: [f32; 2]| low <= high;
    ranges.iter().filter(|(at, range)| own(*range) && may_show(*at)).map(|(at, _)| *at).collect()
}

/// Returns the median variance of neighbourhoods whose mean is visible: the noise. Neighbourhoods
/// with unseen voxels do not count.
fn noise(raw: &Table, places: &[[i64; 3]], [low, high]: [f64; 2], (simd, sharing): (Simd, Sharing<'_>)) -> f32 {
    let mut counts: Vec<([i64; 3], Vec<u32>)> =
        places.chunks(BRICKS_PER_TASK).map(|_| ([0; 3], vec![0; BINS])).collect();
    let tasks: Vec<&[[i64; 3]]> = places.chunks(BRICKS_PER_TASK).collect();
    sharing.chunks(&mut counts, 1, |task, counts| {
        for at in tasks[task] {
            if let Some(brick) = raw.get(*at) {
                simd.fused(Variances { brick, visible: [low as f32, high as f32], counts: &mut counts[0].1 });
            }
        }
    });
    let sum: Vec<u64> = (0..BINS).map(|bin| counts.iter().map(|(_, counts)| u64::from(counts[bin])).sum()).collect();
    let (mut below, all) = (0, sum.iter().sum::<u64>());
    for (bin, count) in sum.iter().enumerate() {
        below += count;
        if 2 * below > all {
            return libm::exp2((bin as f64 + 0.5) / 8.0 - 16.0) as f32;
        }
    }
    0.0
}

/// Job that counts the variances of a brick's neighbourhoods.
struct Variances<'a> {
    brick: &'a Brick,
    visible: [f32; 2],
    counts: &'a mut [u32],
}

impl Fused for Variances<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { brick, visible: [low, high], counts } = self;
        for z in (1..EDGE - 1).step_by(2) {
            for y in (1..EDGE - 1).step_by(2) {
                for x in (1..EDGE - 1).step_by(2) {
                    let (mut sum, mut squares, mut seen) = (0.0_f32, 0.0_f32, 0);
                    for dz in z - 1..=z + 1 {
                        for dy in y - 1..=y + 1 {
                            for dx in x - 1..=x + 1 {
                                let at = (dz * EDGE + dy) * EDGE + dx;
                                let value = brick.value[at];
                                seen += u32::from(brick.weight[at] > 0.0);
                                sum += value;
                                squares = value.mul_add(value, squares);
                            }
                        }
                    }
                    let mean = sum / 27.0;
                    let variance = (-mean).mul_add(mean, squares / 27.0);
                    if seen == 27 && low <= mean && mean <= high && variance > 0.0 {
                        // The exponent and the three highest bits of the mantissa.
                        let bin = i64::from(variance.to_bits() >> 20) - ((127 - 16) << 3);
                        counts[bin.clamp(0, BINS as i64 - 1) as usize] += 1;
                    }
                }
            }
        }
    }
}

/// Returns the Gaussian's weights, which sum to 1.
fn taps(sigma: f64) -> [f32; 2 * RADIUS + 1] {
    let weight = |tap: usize| {
        let off = tap as f64 - RADIUS as f64;
        if sigma > 0.0 { libm::exp(-0.5 * (off / sigma) * (off / sigma)) } else { f64::from(u8::from(off == 0.0)) }
    };
    let sum: f64 = (0..=2 * RADIUS).map(weight).sum();
    std::array::from_fn(|tap| (weight(tap) / sum) as f32)
}

/// Memory of a thread.
struct Scratch {
    value: Box<[f32; ALL]>,
    weight: Box<[f32; ALL]>,
    /// Sums of weights, weighted values and weighted squares.
    sums: [Box<[f32; ALL]>; 3],
    along: Box<[f32; ALL]>,
}

impl Scratch {
    fn new() -> Self {
        let zeros = || Box::new([0.0; ALL]);
        Self { value: zeros(), weight: zeros(), sums: [zeros(), zeros(), zeros()], along: zeros() }
    }
}

/// Job that smooths a brick.
struct Smooth<'a> {
    around: [Option<&'a Brick>; 27],
    taps: [f32; 2 * RADIUS + 1],
    /// Variance of the noise.
    noise: f32,
    scratch: &'a mut Scratch,
    brick: &'a mut Brick,
}

impl Fused for Smooth<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { around, taps, noise, scratch: Scratch { value, weight, sums, along }, brick } = self;
        gather(&around, value, weight);
        let [weights, values, squares] = sums;
        for at in 0..ALL {
            let weighted = weight[at] * value[at];
            (weights[at], values[at], squares[at]) = (weight[at], weighted, weighted * value[at]);
        }
        box_sums(weights, along);
        box_sums(values, along);
        box_sums(squares, along);
        // Weighted values, with less speckle.
        for at in 0..ALL {
            let per = if weights[at] > 0.0 { 1.0 / weights[at] } else { 0.0 };
            let mean = values[at] * per;
            let variance = (-mean).mul_add(mean, squares[at] * per);
            let kept = if variance > noise { 1.0 - noise / variance } else { 0.0 };
            value[at] = weight[at] * kept.mul_add(value[at] - mean, mean);
        }
        let [blurred, blurred_weight, _] = sums;
        blur(value, along, blurred, taps);
        brick.weight = inner(weight);
        blur(weight, along, blurred_weight, taps);
        let (blurred, blurred_weight) = (inner(blurred), inner(blurred_weight));
        for at in 0..VOXELS {
            let is_seen = brick.weight[at] > 0.0;
            brick.value[at] = if is_seen { blurred[at] / blurred_weight[at] } else { 0.0 };
        }
    }
}

/// Replaces voxels by the sums of those around.
#[inline(always)]
fn box_sums(sum: &mut [f32; ALL], along: &mut [f32; ALL]) {
    three(sum, along, 1);
    three(along, sum, LINE);
    three(sum, along, LAYER);
    *sum = *along;
}

/// Sums three voxels along an axis.
#[inline(always)]
fn three(from: &[f32; ALL], to: &mut [f32; ALL], stride: usize) {
    let count = ALL - 2 * stride;
    let [before, here, behind] = [0, stride, 2 * stride].map(|first| &from[first..first + count]);
    let to = &mut to[stride..stride + count];
    for at in 0..count {
        to[at] = before[at] + here[at] + behind[at];
    }
}

/// Copies a brick and what it depends on; unseen voxels and those outside are 0.
#[inline(always)]
fn gather(around: &[Option<&Brick>; 27], value: &mut [f32; ALL], weight: &mut [f32; ALL]) {
    // Voxels of the lattice from the corner on: brick −1 from its fourth voxel, brick 0, brick 1.
    let of = |x: usize| ((x + EDGE - REACH) / EDGE, (x + EDGE - REACH) % EDGE);
    for z in 0..SIDE {
        for y in 0..SIDE {
            let ((bz, iz), (by, iy)) = (of(z), of(y));
            let line = (z * SIDE + y) * SIDE;
            for (bx, from, to, n) in [(0, EDGE - REACH, 0, REACH), (1, 0, REACH, EDGE), (2, 0, REACH + EDGE, REACH)] {
                let to = line + to..line + to + n;
                match around[(bz * 3 + by) * 3 + bx] {
                    Some(brick) => {
                        let from = (iz * EDGE + iy) * EDGE + from;
                        value[to.clone()].copy_from_slice(&brick.value[from..from + n]);
                        weight[to].copy_from_slice(&brick.weight[from..from + n]);
                    }
                    None => {
                        value[to.clone()].fill(0.0);
                        weight[to].fill(0.0);
                    }
                }
            }
        }
    }
}

/// Weights voxels by a Gaussian along each axis. The result is whole in the brick itself; `from`
/// is used up.
#[inline(always)]
fn blur(from: &mut [f32; ALL], between: &mut [f32; ALL], to: &mut [f32; ALL], taps: [f32; 2 * RADIUS + 1]) {
    weighted(from, to, 1, taps);
    weighted(to, between, LINE, taps);
    weighted(between, to, LAYER, taps);
}

/// Weights voxels along an axis.
#[inline(always)]
fn weighted(from: &[f32; ALL], to: &mut [f32; ALL], stride: usize, taps: [f32; 2 * RADIUS + 1]) {
    // Voxels whose sum is whole.
    let (first, count) = (RADIUS * stride, ALL - 2 * RADIUS * stride);
    let to = &mut to[first..first + count];
    to.fill(0.0);
    let mut tap = 0;
    while tap < taps.len() {
        let from = &from[tap * stride..tap * stride + count];
        for at in 0..count {
            to[at] = taps[tap].mul_add(from[at], to[at]);
        }
        tap += 1;
    }
}

/// Returns the voxels of the brick itself.
#[inline(always)]
fn inner(all: &[f32; ALL]) -> [f32; VOXELS] {
    let mut inner = [0.0; VOXELS];
    for (line, inner) in inner.chunks_exact_mut(EDGE).enumerate() {
        let at = ((line / EDGE + REACH) * SIDE + line % EDGE + REACH) * SIDE + REACH;
        inner.copy_from_slice(&all[at..at + EDGE]);
    }
    inner
}

impl Values for Smoothed {
    fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
        let edge = EDGE as i64;
        for (x, (value, weight)) in (0..).zip(value.iter_mut().zip(weight)) {
            let at = [start[0] + x - self.first[0], start[1] - self.first[1], start[2] - self.first[2]];
            let [i, j, k] = at.map(|x| x.rem_euclid(edge) as usize);
            let voxel = (k * EDGE + j) * EDGE + i;
            (*value, *weight) = match self.table.get(at.map(|x| x.div_euclid(edge))) {
                Some(brick) => (brick.value[voxel], brick.weight[voxel]),
                None => (0.0, 0.0),
            };
        }
    }

    fn brick(&self, block: BrickIndex, value: &mut [f32; VOXELS], weight: &mut [f32; VOXELS]) {
        let at = std::array::from_fn(|a| i64::from(block[a]) - self.first[a] / EDGE as i64);
        match self.table.get(at) {
            Some(brick) => (*value, *weight) = (brick.value, brick.weight),
            None => (*value, *weight) = ([0.0; VOXELS], [0.0; VOXELS]),
        }
    }

    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        Box::new(self.table.bricks.iter().map(|brick| brick_index(self.first, brick.at)))
    }
}
