//! A tile of rays of a new view, cast in lockstep: each visible block of all of them before the
//! next. They meet the same bricks, which then stay in the processor's cache.

use std::ops::Range;

use simd::Fused;

use crate::rays::cast::Casting;
use crate::rays::composite::Accumulated;
use crate::rays::rows::Row;
use crate::rays::visible_blocks::{BITS, TILE};

/// Job that casts the rays of a tile, all samples of which have changed.
pub(crate) struct CastTile<'a, const C: usize> {
    /// The rows of pixels of the tile.
    pub(crate) rows: &'a mut [Row<C>],
    pub(crate) columns: Range<usize>,
    pub(crate) visible: &'a [u64],
    pub(crate) casting: Casting<'a, C>,
}

/// The rays of a tile, a bit each.
type Rays = u64;
const _: () = assert!(TILE * TILE <= Rays::BITS as usize);

impl<const C: usize> Fused for CastTile<'_, C> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { rows, columns, visible, casting: Casting { sampler, fold, .. } } = self;
        let mut cast: Rays = 0;
        for (y, row) in rows.iter_mut().enumerate() {
            for (x, at) in columns.clone().enumerate() {
                cast |= Rays::from(row.begin(at, fold)) << (y * TILE + x);
            }
        }
        let mut pixels = [Accumulated::CLEAR; TILE * TILE];
        let mut live = cast;
        for (word, bits) in (0..).zip(visible) {
            let mut left = *bits;
            while left != 0 && live != 0 {
                let block = word * BITS + left.trailing_zeros();
                left &= left - 1;
                let begin = block * fold.arity;
                let samples = [begin, begin.saturating_add(fold.arity)];
                let mut rays = live;
                while rays != 0 {
                    let ray = rays.trailing_zeros() as usize;
                    rays &= rays - 1;
                    let (row, at) = (&mut rows[ray / TILE], columns.start + ray % TILE);
                    if let Some(folded) = row.first_block(at, block, samples, sampler, fold)
                        && pixels[ray].ends_behind(&folded, fold, &mut row.work)
                    {
                        live &= !(1 << ray);
                    }
                }
            }
        }
        while cast != 0 {
            let ray = cast.trailing_zeros() as usize;
            cast &= cast - 1;
            let row = &mut rows[ray / TILE];
            row.set(columns.start + ray % TILE, pixels[ray]);
            row.work.rays += 1;
        }
    }
}
