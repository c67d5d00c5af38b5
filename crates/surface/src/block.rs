//! A cube of voxels, read from the volume.

use volume::Values;
use volume::brick::{BrickIndex, EDGE, VOXELS};

/// Values of a cube of voxels, x fastest. Unseen voxels, and values that are not finite, are NaN.
#[derive(Debug, Default)]
pub struct Block {
    /// Values.
    pub values: Vec<f32>,
    weights: Vec<f32>,
    is_whole: bool,
}

impl Block {
    /// Reads `edge`³ voxels, the lowest of which is `low`.
    pub fn read<V: Values + ?Sized>(&mut self, volume: &V, low: [i64; 3], edge: usize) {
        self.values.resize(edge.pow(3), 0.0);
        self.weights.resize(edge, 0.0);
        self.is_whole = true;
        for (line, values) in self.values.chunks_exact_mut(edge).enumerate() {
            let start = [low[0], low[1] + (line % edge) as i64, low[2] + (line / edge) as i64];
            volume.values(start, values, &mut self.weights);
            self.is_whole &= hide_unseen(values, &self.weights);
        }
    }

    /// Reads the voxels of a brick's cells: its own, and the first ones of the bricks above it.
    pub(crate) fn read_cells<V: Values + ?Sized>(&mut self, volume: &V, brick: BrickIndex) {
        const LINE: usize = EDGE + 1;
        let [mut own, mut next] = [Brick::default(), Brick::default()];
        own.read(volume, brick);
        next.read(volume, [brick[0].saturating_add(1), brick[1], brick[2]]);
        let low = brick.map(|b| i64::from(b) * EDGE as i64);
        self.values.resize(LINE.pow(3), 0.0);
        self.weights.resize(LINE, 0.0);
        self.is_whole = true;
        for (line, values) in self.values.chunks_exact_mut(LINE).enumerate() {
            let (y, z) = (line % LINE, line / LINE);
            if y < EDGE && z < EDGE {
                let start = (z * EDGE + y) * EDGE;
                values[..EDGE].copy_from_slice(&own.values[start..][..EDGE]);
                self.weights[..EDGE].copy_from_slice(&own.weights[start..][..EDGE]);
                (values[EDGE], self.weights[EDGE]) = (next.values[start], next.weights[start]);
            } else {
                volume.values([low[0], low[1] + y as i64, low[2] + z as i64], values, &mut self.weights);
            }
            self.is_whole &= hide_unseen(values, &self.weights);
        }
    }

    /// Voxels along an edge.
    pub(crate) fn edge(&self) -> usize {
        self.weights.len()
    }

    /// Whether all voxels are seen.
    pub(crate) fn is_whole(&self) -> bool {
        self.is_whole
    }
}

/// Values and weights of a brick.
struct Brick {
    values: [f32; VOXELS],
    weights: [f32; VOXELS],
}

impl Default for Brick {
    fn default() -> Self {
        Self { values: [0.0; VOXELS], weights: [0.0; VOXELS] }
    }
}

impl Brick {
    fn read<V: Values + ?Sized>(&mut self, volume: &V, brick: BrickIndex) {
        volume.brick(brick, &mut self.values, &mut self.weights);
    }
}

/// Makes unseen values NaN; returns whether there are none.
fn hide_unseen(values: &mut [f32], weights: &[f32]) -> bool {
    let mut is_whole = true;
    for (value, weight) in values.iter_mut().zip(weights) {
        let is_seen = *weight > 0.0 && value.is_finite();
        *value = if is_seen { *value } else { f32::NAN };
        is_whole &= is_seen;
    }
    is_whole
}
