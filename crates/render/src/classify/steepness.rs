//! An upper bound on the intensity gradients in a brick, without computing them.
//!
//! A slope along an axis is a mean of differences between a voxel and its neighbours there. It
//! is at most the range of seen intensities in the brick and its neighbours, divided by the
//! pitch. The gradient is at most the length of three such slopes. If a transfer function shows
//! an intensity only where it is steep enough, this bound shows that most voxels of a brick are
//! transparent.

use simd::LANES;
use simd::wide::{Set, Wide};
use volume::brick::{EDGE, VOXELS};

use crate::real::Number;
use crate::snapshot::{Brick, FACES};

/// Intensities and weights for which a gradient is accurate to [`ROUNDING`]: its formula
/// multiplies them, and divides by the weights.
const LARGEST: f32 = 1e15;
const LEAST_WEIGHT: f32 = 1e-20;
/// Above the relative rounding error of a gradient's length in single precision; and the loss by
/// products below the least normal number, per mm.
const ROUNDING: f64 = 1e-3;
const LOST_PER_MM: f64 = 1e-6;
/// Voxels of a face.
const FACE: usize = EDGE * EDGE;

/// The range of seen intensities.
#[derive(Clone, Copy)]
struct Range<S: Set> {
    least: Wide<S>,
    largest: Wide<S>,
    /// Above 0 if a seen voxel holds an invalid or extreme number.
    strange: Wide<S>,
}

impl<S: Set> Range<S> {
    #[inline(always)]
    fn add(&mut self, value: Wide<S>, weight: Wide<S>) {
        let (none, one) = (Wide::zero(), Wide::one());
        let seen = none.lt(weight);
        self.least = self.least.min(Wide::select(seen, value, self.least));
        self.largest = self.largest.max(Wide::select(seen, value, self.largest));
        let weighed = Wide::<S>::both(Wide::splat(LEAST_WEIGHT).le(weight), weight.le(Wide::splat(LARGEST)));
        let sane = Wide::<S>::both(weighed, value.abs().le(Wide::splat(LARGEST)));
        self.strange = self.strange.max(Wide::select(seen, Wide::select(sane, none, one), none));
    }

    #[inline(always)]
    fn add_all(&mut self, value: &[f32], weight: &[f32]) {
        let (mut values, mut weights) = ([0.0; LANES], [0.0; LANES]);
        for (value, weight) in value.chunks_exact(LANES).zip(weight.chunks_exact(LANES)) {
            values.copy_from_slice(value);
            weights.copy_from_slice(weight);
            self.add(Wide::load(&values), Wide::load(&weights));
        }
    }
}

/// Returns the largest gradient that a brick's voxels can have, grey levels per mm, given its
/// face neighbours in the order of [`FACES`]; infinite if unknown.
#[inline(always)]
pub(crate) fn steepest<S: Set>(own: &Brick, beside: [Option<&Brick>; 6], pitch_mm: [f32; 3]) -> f64 {
    let mut range = Range::<S> {
        least: Wide::splat(f32::INFINITY),
        largest: Wide::splat(f32::NEG_INFINITY),
        strange: Wide::zero(),
    };
    range.add_all(&own.value, &own.weight);
    let (mut value, mut weight) = ([0.0; FACE], [0.0; FACE]);
    let mut face = 0;
    while face < FACES.len() {
        if let Some(brick) = beside[face] {
            let (axis, side) = FACES[face];
            on_face(&brick.value, axis, side, &mut value);
            on_face(&brick.weight, axis, side, &mut weight);
            range.add_all(&value, &weight);
        }
        face += 1;
    }
    let (mut least, mut largest, mut strange) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    range.least.store(&mut least);
    range.largest.store(&mut largest);
    range.strange.store(&mut strange);
    let (mut low, mut high, mut is_strange) = (f32::INFINITY, f32::NEG_INFINITY, false);
    for lane in 0..LANES {
        low = low.min(least[lane]);
        high = high.max(largest[lane]);
        is_strange |= strange[lane] > 0.0;
    }
    if is_strange {
        return f64::INFINITY;
    }
    let rise = (f64::from(high) - f64::from(low)).max(0.0);
    let [x, y, z] = [f64::from(pitch_mm[0]), f64::from(pitch_mm[1]), f64::from(pitch_mm[2])];
    let steepest = rise * (1.0 / (x * x) + 1.0 / (y * y) + 1.0 / (z * z)).sqrt();
    steepest * (1.0 + ROUNDING) + LOST_PER_MM
}

/// Copies the voxels on the face that a brick shares with another, which it lies beside along
/// `axis` on one side.
#[inline(always)]
fn on_face(voxels: &[f32; VOXELS], axis: usize, side: i64, face: &mut [f32; FACE]) {
    let (along, across) = [(EDGE, FACE), (1, FACE), (1, EDGE)][axis];
    let layer = if side < 0 { EDGE - 1 } else { 0 };
    let first = layer * [1, EDGE, FACE][axis];
    for (i, voxel) in face.iter_mut().enumerate() {
        *voxel = voxels[first + i % EDGE * along + i / EDGE * across];
    }
}
