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
    /// Grey level that the values are relative to.
    pub(crate) level: f32,
    pub(crate) time: SliceTime,
    pub(crate) rule: Rule,
    /// Factors that convert the sums over patches of values and certainties into grey levels
    /// and fractions: powers of two.
    pub(crate) unit: [f32; 2],
}

impl<'a> FilteredSlice<'a> {
    /// Combines an image and its certainty.
    pub(crate) fn new(value: &'a Nodes, level: f32, certainty: &'a Nodes, time: SliceTime, rule: Rule) -> Self {
        let unit = [value, certainty].map(|nodes| 2.0_f32.powi(-nodes.scale - rule.sampling.weight_bits()));
        Self { value, certainty, level, time, rule, unit }
    }
}
