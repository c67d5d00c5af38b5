//! The filtered image: spline coefficients on nodes, in f32 as computed and in 16 bits as
//! sampled.
#![allow(unsafe_code, reason = "packing runs on `Lanes`, by pointer")]

use simd::sharing::Sharing;
use simd::{LANES, Lanes, Simd, dispatch};

/// Largest number of nodes of a filtered image, including row padding. f32 counts them exactly
/// up to here, as the hot loop requires.
pub(crate) const MOST_NODES: usize = 1 << 24;
/// Nodes that one task packs.
const NODES_PER_TASK: usize = 1 << 13;

/// Values on the nodes: `data[row·stride + column]`; column c is node `first[0] + c` along u,
/// row r node `first[1] + r` along v.
#[derive(Debug, Clone)]
pub(crate) struct Nodes {
    pub(crate) first: [i64; 2],
    pub(crate) columns: usize,
    pub(crate) rows: usize,
    /// A multiple of the lanes of a vector.
    pub(crate) stride: usize,
    pub(crate) data: Vec<f32>,
    /// The same in 16 bits, `data·2^scale` rounded, each node with the one below it in the high
    /// half. The hot loop samples these: half the loads of f32, for an error of 2⁻¹⁵ of the
    /// image's range, far below the spline's own deviation.
    pub(crate) pairs: Vec<u32>,
    pub(crate) scale: i32,
}

impl Nodes {
    /// All zero.
    pub(crate) fn new(first: [i64; 2], columns: usize, rows: usize, stride: usize) -> Self {
        let (data, pairs) = (vec![0.0; rows * stride], vec![0; rows * stride]);
        Self { first, columns, rows, stride, data, pairs, scale: 0 }
    }

    /// Computes the pairs, from data whose magnitudes are at most `most`.
    pub(crate) fn pack(&mut self, simd: Simd, most: f32, sharing: Sharing) {
        // A power of two, so that scaling is exact.
        self.scale = if most > 0.0 { (32767.0 / most).log2().floor().clamp(-60.0, 60.0) as i32 } else { 0 };
        let factor = 2.0_f32.powi(self.scale);
        let (data, stride) = (&self.data, self.stride);
        sharing.chunks(&mut self.pairs, NODES_PER_TASK, |index, pairs| {
            pack(simd, &data[index * NODES_PER_TASK..], stride, factor, pairs);
        });
    }
}

dispatch!(
    /// Packs each node with the one `stride` further on, times `factor`. Zeros follow below the
    /// last row.
    fn pack => pack_lanes(data: &[f32], stride: usize, factor: f32, pairs: &mut [u32])
);

/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
unsafe fn pack_lanes<L: Lanes>(data: &[f32], stride: usize, factor: f32, pairs: &mut [u32]) {
    assert!(pairs.len().is_multiple_of(LANES) && data.len() >= pairs.len());
    // Up to here a row below exists for all of a vector.
    let paired = data.len().saturating_sub(stride).min(pairs.len()) / LANES * LANES;
    // SAFETY: loads end at `at + stride + 16 ≤ data.len()` up to `paired` and at
    // `at + 16 ≤ pairs.len() ≤ data.len()` beyond, stores at `at + 16 ≤ pairs.len()`; the
    // instruction set as for this function.
    unsafe {
        let factor = L::splat(factor);
        for at in (0..pairs.len()).step_by(LANES) {
            let low = L::load(data.as_ptr().add(at)).mul(factor);
            let high = if at < paired { L::load(data.as_ptr().add(at + stride)).mul(factor) } else { L::splat(0.0) };
            L::store_pairs(low, high, pairs.as_mut_ptr().add(at));
        }
    }
}

#[cfg(test)]
mod tests {
    use simd::team::Team;

    use super::*;

    #[test]
    fn pairs_hold_node_and_next_row_in_finest_unit() {
        // More than one task's worth of nodes, so that pairs cross their borders.
        let (columns, rows, stride) = (60, 200, 64);
        let mut nodes = Nodes::new([0, 0], columns, rows, stride);
        for (i, x) in nodes.data.iter_mut().enumerate() {
            *x = ((i * 37) % 511) as f32 - 255.0;
        }
        nodes.pack(Simd::detect(), 255.0, Sharing::Alone);
        assert_eq!(nodes.scale, 7, "255·2⁷ fits 16 bits, 255·2⁸ does not");
        for (i, pair) in nodes.pairs.iter().enumerate() {
            let halves = [*pair as u16, (*pair >> 16) as u16].map(|half| f32::from(half.cast_signed()) / 128.0);
            let below = nodes.data.get(i + stride).copied().unwrap_or(0.0);
            assert_eq!(halves, [nodes.data[i], below], "node {i}");
        }
        let one = nodes.pairs.clone();
        let team = Team::new("test", 3).unwrap();
        for simd in Simd::ALL.into_iter().filter(|s| s.is_available()) {
            nodes.pack(simd, 255.0, Sharing::of(team.as_ref()));
            assert!(nodes.pairs == one, "{}", simd.name());
        }
    }
}
