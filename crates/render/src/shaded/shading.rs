//! Classifies and lights the voxels of a brick that may have changed, and stores those that have.

use simd::LANES;
use simd::wide::{Job, Set, Wide};
use volume::brick::EDGE;

use super::brick::{ShadedBrick, cell};
use super::neighbours::{ROWS, around, at, centre};
use crate::classify::interval::Interval;
use crate::classify::shade::{Lit, Shader};
use crate::classify::steepness::steepest;
use crate::snapshot::{Bits, Changed, VoxelSnapshot};
use crate::stock::Stock;

/// A brick with voxels to be shaded, and the outcome.
pub(super) struct Task<'a, const C: usize> {
    pub(super) changed: &'a Changed,
    /// Stored brick; `None` while all of it is transparent.
    pub(super) brick: Option<&'a mut ShadedBrick<C>>,
    /// New brick to be stored.
    pub(super) fresh: Option<Box<ShadedBrick<C>>>,
    pub(super) outcome: Outcome,
}

/// Result of shading a brick's voxels.
#[derive(Default)]
pub(super) struct Outcome {
    /// Number of voxels shaded.
    pub(super) shaded: u64,
    /// Voxels that have changed.
    pub(super) lit: Bits,
}

/// Shades the voxels of a brick that may have changed, and stores those that have.
pub(super) struct Shading<'a, 'b, const C: usize> {
    pub(super) snapshot: &'a VoxelSnapshot,
    pub(super) shader: &'a Shader<f32>,
    pub(super) interval: &'a Interval,
    pub(super) stock: &'a Stock<ShadedBrick<C>>,
    pub(super) task: &'a mut Task<'b, C>,
}

impl<const C: usize> Job for Shading<'_, '_, C> {
    type Output = Outcome;

    #[inline(always)]
    fn run<S: Set>(self) -> Outcome {
        let Self { snapshot, shader, interval, stock, task: Task { changed, brick: kept, fresh, .. } } = self;
        let mut outcome = Outcome::default();
        let Some((own, beside)) = snapshot.neighbourhood(changed.at) else { return outcome };
        let mut values = shader.visible();
        if shader.hides_flat() {
            values = shader.visible_below(steepest::<S>(own, beside, shader.pitch_mm()));
        }
        for (z, layer) in changed.voxels.iter().enumerate() {
            for y in (0..EDGE).step_by(ROWS) {
                let due = (layer >> (EDGE * y)) as u16;
                if due == 0 {
                    continue;
                }
                let place = (z * EDGE + y) * EDGE;
                let centre = centre::<S>(own, place);
                let visible = Wide::<S>::bits(Shader::may_show_between(values, centre)) & due;
                outcome.shaded += u64::from(visible.count_ones());
                let mut rows = Rows { colour: [[0.0; LANES]; C], alpha: [0.0; LANES] };
                if visible != 0 {
                    let around = around::<S>(own, beside, place);
                    let lit = shader.shade_all::<Wide<S>, C>(centre, around, at(changed.at, [y, z]));
                    lit.alpha.store(&mut rows.alpha);
                    for c in 0..C {
                        lit.colour[c].store(&mut rows.colour[c]);
                    }
                }
                let into = match (&mut *kept, &mut *fresh) {
                    (Some(brick), _) => &mut **brick,
                    (None, Some(brick)) => &mut **brick,
                    (None, None) if rows.alpha == [0.0; LANES] => continue,
                    (None, fresh) => &mut **fresh.insert(stock.take()),
                };
                let lit = into.put([y, z], due, &rows, interval);
                outcome.lit[z] |= u64::from(lit) << (EDGE * y);
            }
        }
        outcome
    }
}

/// Shaded voxels of two rows.
struct Rows<const C: usize> {
    colour: [[f32; LANES]; C],
    alpha: [f32; LANES],
}

impl<const C: usize> ShadedBrick<C> {
    /// Stores the voxels of two rows whose bits are set, the first row at [y, z]; returns those
    /// that have changed.
    #[inline(always)]
    fn put(&mut self, [y, z]: [usize; 2], due: u16, rows: &Rows<C>, interval: &Interval) -> u16 {
        let (mut left, mut changed) = (due, 0);
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            let mut lit = Lit { colour: [0.0; C], alpha: rows.alpha[lane] };
            for c in 0..C {
                lit.colour[c] = rows.colour[c][lane];
            }
            let cell = cell([lane % EDGE, y + lane / EDGE, z]);
            if !self.is(cell, &lit) {
                self.set(cell, &lit, interval);
                changed |= 1 << lane;
            }
        }
        changed
    }
}
