//! Figures of a whole volume from a part of its voxels.

use volume::Voxels;
use volume::brick::{BrickIndex, VOXELS};

/// Returns all blocks, or every nth of a volume of more than `most` voxels.
pub(crate) fn sample(volume: &dyn Voxels, most: usize) -> impl Iterator<Item = BrickIndex> {
    let blocks: Vec<_> = volume.blocks().collect();
    let every = (blocks.len() * VOXELS).div_ceil(most).max(1);
    blocks.into_iter().step_by(every)
}

/// Returns a quantile of numbers in any order: the nearest rank.
pub(crate) fn quantile(numbers: &mut [f64], share: f64) -> Option<f64> {
    let rank = ((numbers.len() as f64 * share) as usize).min(numbers.len().checked_sub(1)?);
    Some(*numbers.select_nth_unstable_by(rank, f64::total_cmp).1)
}
