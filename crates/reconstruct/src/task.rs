//! The work of an insertion: the part of a slice that falls on one brick, and the filtered slice.

use volume::brick_volume::Slot;

use super::compounding::Entry;
use super::falloff::Falloff;
use super::nodes::Nodes;
use super::sampling::Sampling;
use super::slab::Overlap;

/// The part of a slice that falls on one brick.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Task {
    pub(crate) slot: Slot,
    pub(crate) overlap: Overlap,
    /// Node column, node row, plane distance in σ: value at the brick's first voxel, steps per
    /// voxel along x, y, z.
    pub(crate) functions: [[f32; 4]; 3],
    /// Voxels that gained weight.
    pub(crate) updated: u32,
    /// Voxels whose weight was clamped.
    pub(crate) clamped: u32,
    /// Vectors that were sampled.
    pub(crate) vectors: u32,
}

/// Parameters common to all slices: sampling, weighting and entry of an image.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rule {
    pub(crate) sampling: Sampling,
    pub(crate) falloff: Falloff,
    pub(crate) entry: Entry,
    /// Largest weight a voxel keeps.
    pub(crate) most_weight: f32,
}

/// Time of a slice.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SliceTime {
    /// In ticks of [`Stamps`](volume::brick::Stamps).
    pub(crate) stamp: u32,
    /// On the decay's clock, ns.
    pub(crate) elapsed_ns: i64,
}

/// The filtered slice, and the way it enters the volume.
#[derive(Clone, Copy)]
pub(crate) struct FilteredSlice<'a> {
    pub(crate) value: &'a Nodes,
    pub(crate) certainty: &'a Nodes,
    /// Weights of the pixels by their shadows, on the same nodes; `None` if all count in full.
    pub(crate) pixel_weights: Option<&'a Nodes>,
    /// Grey level that the values are relative to.
    pub(crate) level: f32,
    pub(crate) time: SliceTime,
    /// Weight of the whole slice.
    pub(crate) weight: f32,
    pub(crate) rule: Rule,
    /// Factors that convert the sums over patches of values, certainties and weights of pixels into
    /// grey levels and fractions: powers of two.
    pub(crate) unit: [f32; 3],
}

impl<'a> FilteredSlice<'a> {
    /// Combines an image and its certainty.
    pub(crate) fn new(
        value: &'a Nodes,
        level: f32,
        certainty: &'a Nodes,
        (time, weight): (SliceTime, f32),
        rule: Rule,
    ) -> Self {
        let [value_unit, certainty_unit] = [value, certainty].map(|nodes| unit(nodes, rule));
        let unit = [value_unit, certainty_unit, 1.0];
        Self { value, certainty, pixel_weights: None, level, time, weight, rule, unit }
    }

    /// Sets the weights of its pixels, which have the shape of its values.
    pub(crate) fn with_pixel_weights(self, weights: Option<&'a Nodes>) -> Self {
        let [value, certainty, _] = self.unit;
        let last = weights.map_or(1.0, |nodes| unit(nodes, self.rule));
        Self { pixel_weights: weights, unit: [value, certainty, last], ..self }
    }
}

/// Returns the factor that converts sums over patches of nodes.
fn unit(nodes: &Nodes, rule: Rule) -> f32 {
    2.0_f32.powi(-nodes.scale - rule.sampling.weight_bits())
}
