//! Gradients of a volume's values.

use glam::DVec3;

use volume::brick::{BrickIndex, EDGE};
use volume::read::SEEN;
use volume::{BrickVolume, Values, Voxels};

/// Voxels along the edge of a block with its neighbours.
const WIDE: usize = EDGE + 2;
/// Voxels of such a block.
const ALL: usize = WIDE * WIDE * WIDE;

/// Values of a block and of one voxel all around, for gradients along the lattice's axes, grey
/// levels per mm.
pub(super) struct Slopes {
    values: Box<[Option<f32>; ALL]>,
    spacing_mm: [f64; 3],
}

impl Slopes {
    /// Reads the values around a block.
    pub(super) fn new(volume: &BrickVolume, block: BrickIndex, spacing_mm: [f64; 3]) -> Self {
        let first = block.map(|b| i64::from(b) * EDGE as i64 - 1);
        let mut values = Box::new([None; ALL]);
        let (mut value, mut weight) = ([0.0; WIDE], [0.0; WIDE]);
        for (row, values) in values.chunks_exact_mut(WIDE).enumerate() {
            let start = [first[0], first[1] + (row % WIDE) as i64, first[2] + (row / WIDE) as i64];
            volume.values(start, &mut value, &mut weight);
            for (to, (value, weight)) in values.iter_mut().zip(value.iter().zip(&weight)) {
                *to = (*weight > SEEN).then_some(*value);
            }
        }
        Self { values, spacing_mm }
    }

    /// Returns the gradient at a voxel of the block; 0 if it is unseen.
    pub(super) fn of(&self, [x, y, z]: [usize; 3]) -> DVec3 {
        let at = ((z + 1) * WIDE + y + 1) * WIDE + x + 1;
        let stride = [1, WIDE, WIDE * WIDE];
        gradient(self.values[at], |a| [at - stride[a], at + stride[a]].map(|at| self.values[at]), self.spacing_mm)
    }

    /// Returns the gradient at one voxel of a volume.
    pub(super) fn at(volume: &BrickVolume, voxel: [i64; 3], spacing_mm: [f64; 3]) -> DVec3 {
        let value = |at: [i64; 3]| match volume.voxel(at) {
            (r, w) if w > SEEN => Some(r / w),
            _ => None,
        };
        let beside = |axis: usize| {
            [-1, 1].map(|step| {
                let mut at = voxel;
                at[axis] += step;
                value(at)
            })
        };
        gradient(value(voxel), beside, spacing_mm)
    }
}

/// Returns a gradient from a voxel's value and those before and after it along each axis: one-sided
/// at the border of the scan.
fn gradient(own: Option<f32>, beside: impl Fn(usize) -> [Option<f32>; 2], spacing_mm: [f64; 3]) -> DVec3 {
    let Some(own) = own else { return DVec3::ZERO };
    let slope = |axis: usize| {
        let sides = beside(axis);
        let steps = sides.iter().flatten().count().max(1) as f64;
        let [low, high] = sides.map(|side| side.unwrap_or(own));
        f64::from(high - low) / (steps * spacing_mm[axis])
    };
    DVec3::new(slope(0), slope(1), slope(2))
}
