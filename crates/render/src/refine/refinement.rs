//! The remaining work for a new view.

use std::ops::Range;

use crate::camera::Camera;
use crate::rays::composite::Fold;
use crate::rays::rows::Row;
use crate::rays::visible_blocks::TILE;
use crate::refine::preview::Preview;
use crate::settings::Cache;
use simd::sharing::Sharing;

/// Remaining work for a new view.
pub(crate) struct Refinement<const C: usize> {
    pub(super) preview: Preview<C>,
    pub(super) begun: bool,
    /// Whether the light on voxels has changed.
    pub(crate) relight: bool,
    /// Bricks to be lit, and to be searched for small features.
    pub(super) unlit: Vec<[i64; 3]>,
    pub(super) unsearched: Vec<[i64; 3]>,
    /// Number of rows, from the first, that are set up for the view; and whether all are, and
    /// the cache is chosen.
    pub(super) lined: usize,
    pub(super) chosen: bool,
    /// Rows whose rays can be cast; unless rays are adaptive, they are.
    pub(crate) ready: Vec<bool>,
    /// Rows of tiles that are not cast; the next is the last one.
    pub(super) waiting: Vec<usize>,
}

impl<const C: usize> Refinement<C> {
    /// Creates the work for a view. `relight` are the bricks to be lit again, if the light on
    /// voxels has changed.
    pub(super) fn new(camera: &Camera, relight: Option<Vec<[i64; 3]>>, is_adaptive: bool) -> Self {
        let height = camera.size()[1] as usize;
        let rows = height.div_ceil(TILE);
        // From the middle outwards.
        let mut waiting = Vec::from_iter(0..rows);
        waiting.sort_by_key(|row| std::cmp::Reverse((2 * row + 1).abs_diff(rows)));
        Self {
            preview: Preview::new(camera.size()),
            begun: false,
            relight: relight.is_some(),
            unlit: relight.unwrap_or_default(),
            unsearched: Vec::new(),
            lined: 0,
            chosen: false,
            ready: vec![false; height],
            waiting: if is_adaptive { Vec::new() } else { waiting },
        }
    }

    /// Prepares the rows in `range` whose number is a multiple of `edge`, and the picture's last
    /// row.
    pub(super) fn prepare(
        &mut self,
        rows: &mut [Row<C>],
        range: Range<usize>,
        edge: usize,
        (cache, fold): (Cache, Fold),
        sharing: Sharing,
    ) {
        let (first, height) = (range.start, rows.len());
        sharing.chunks_beside(&mut rows[range.clone()], 1, &mut self.ready[range], |ready, at, rows| {
            let j = first + at;
            if !*ready && (j.is_multiple_of(edge) || j + 1 == height) {
                rows[0].reset_cache(cache, fold);
                *ready = true;
            }
        });
    }
}
