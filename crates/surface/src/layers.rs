//! Ranges of grey values of a brick and of its lower layers, by which bricks are skipped.

use volume::Values;
use volume::brick::{BrickIndex, EDGE, VOXELS};

/// Smallest and largest value of the seen voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Range {
    low: f32,
    high: f32,
}

impl Range {
    /// No voxel.
    pub(crate) const EMPTY: Self = Self { low: f32::INFINITY, high: f32::NEG_INFINITY };

    /// Returns the range of both.
    #[inline]
    pub(crate) fn around(self, other: Self) -> Self {
        let low = if other.low < self.low { other.low } else { self.low };
        let high = if other.high > self.high { other.high } else { self.high };
        Self { low, high }
    }

    /// Whether some voxels are inside, at `iso` or above, and others are outside.
    pub(crate) fn straddles(self, iso: f32) -> bool {
        self.low < iso && self.high >= iso
    }
}

/// Ranges of rows of voxels, by x.
#[derive(Debug, Clone, Copy)]
struct Row {
    low: [f32; EDGE],
    high: [f32; EDGE],
}

impl Row {
    const EMPTY: Self = Self { low: [f32::INFINITY; EDGE], high: [f32::NEG_INFINITY; EDGE] };

    fn add(&mut self, value: &[f32; EDGE], weight: &[f32; EDGE]) {
        for x in 0..EDGE {
            let is_seen = weight[x] > 0.0;
            let low = if is_seen { value[x] } else { f32::INFINITY };
            let high = if is_seen { value[x] } else { f32::NEG_INFINITY };
            self.low[x] = if low < self.low[x] { low } else { self.low[x] };
            self.high[x] = if high > self.high[x] { high } else { self.high[x] };
        }
    }

    fn first(&self) -> Range {
        Range { low: self.low[0], high: self.high[0] }
    }

    fn whole(&self) -> Range {
        let ranges = self.low.iter().zip(&self.high).map(|(low, high)| Range { low: *low, high: *high });
        ranges.fold(Range::EMPTY, Range::around)
    }
}

/// Ranges of a brick's layers. Bit a of a layer's number restricts it to the lowest voxels along
/// axis a: 0 is the whole brick, 1 the face at its low x, 7 one corner.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Layers([Range; 8]);

impl Layers {
    /// Reads the ranges of a brick; `None` if no voxel is seen.
    pub(crate) fn read<V: Values + ?Sized>(volume: &V, brick: BrickIndex) -> Option<Self> {
        let (mut value, mut weight) = ([0.0; VOXELS], [0.0; VOXELS]);
        volume.brick(brick, &mut value, &mut weight);
        // The rows at the lowest y (bit 1), the lowest z (bit 2), both, or neither.
        let mut rows = [Row::EMPTY; 8];
        for (line, (value, weight)) in value.as_chunks().0.iter().zip(weight.as_chunks().0).enumerate() {
            let lowest = (usize::from(line % EDGE == 0) << 1) | (usize::from(line / EDGE == 0) << 2);
            rows[lowest].add(value, weight);
        }
        let ranges = rows.map(|row| [row.whole(), row.first()]);
        let range = |layer: usize| {
            let inner = layer & 0b110;
            let rows = ranges.iter().enumerate().filter(|(lowest, _)| lowest & inner == inner);
            rows.fold(Range::EMPTY, |range, (_, row)| range.around(row[layer & 1]))
        };
        let layers: [Range; 8] = std::array::from_fn(range);
        (layers[0] != Range::EMPTY).then_some(Self(layers))
    }

    /// Returns the range of a layer, by its number.
    pub(crate) fn range(&self, layer: usize) -> Range {
        self.0[layer]
    }
}
