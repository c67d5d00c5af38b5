//! The stage's voxels classified and lit: premultiplied colour and opacity of each, in bricks that hold every cell that begins in them.
//!
//! A cell is the cube between eight voxels. That of a brick's last voxels ends in the neighbours; so that a sample finds all eight in one place, each brick
//! also keeps the first voxels of the seven neighbours beyond it: 9³ in all.

use super::shade::{Lit, Shader};
use super::shown::{ABSENT, Changed, Shown, Table};
use super::stage::Stage;
use crate::sharing::Sharing;
use crate::simd::{Fused, Simd};
use crate::volume::brick::EDGE;

/// Voxels along an edge of a brick with what it keeps of its neighbours.
pub(super) const SIDE: usize = EDGE + 1;
/// Voxels of such a brick.
pub(super) const CELLS: usize = SIDE * SIDE * SIDE;

/// Bricks that one task of a thread shades.
const BRICKS_PER_TASK: usize = 4;

/// Colour (premultiplied) and opacity of a step, x fastest.
#[derive(Clone)]
pub(super) struct ShadedBrick<const C: usize> {
    pub(super) colour: [[f32; CELLS]; C],
    pub(super) alpha: [f32; CELLS],
    /// Voxels with an opacity.
    filled: u16,
}

impl<const C: usize> ShadedBrick<C> {
    /// Whether samples here can be anything but transparent.
    pub(super) fn is_filled(&self) -> bool {
        self.filled > 0
    }

    /// Whether a cell holds these bits.
    #[inline(always)]
    fn is(&self, cell: usize, lit: &Lit<f32, C>) -> bool {
        let mut same = self.alpha[cell].to_bits() == lit.alpha.to_bits();
        for c in 0..C {
            same &= self.colour[c][cell].to_bits() == lit.colour[c].to_bits();
        }
        same
    }

    fn set(&mut self, cell: usize, lit: &Lit<f32, C>) {
        self.filled -= u16::from(self.alpha[cell] > 0.0);
        self.filled += u16::from(lit.alpha > 0.0);
        self.alpha[cell] = lit.alpha;
        for c in 0..C {
            self.colour[c][cell] = lit.colour[c];
        }
    }
}

/// A box of voxels that have changed, both inclusive, stage coordinates: samples within a voxel of it may have changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Dirty {
    pub(super) low: [i64; 3],
    pub(super) high: [i64; 3],
}

/// The shaded voxels of a stage.
pub(super) struct Shaded<const C: usize> {
    pub(super) table: Table,
    pub(super) bricks: Vec<ShadedBrick<C>>,
    results: Vec<Result<C>>,
}

/// What became of a brick's voxels.
struct Result<const C: usize> {
    at: [i64; 3],
    shaded: u64,
    /// Those that have changed.
    lit: Vec<(u16, Lit<f32, C>)>,
}

impl<const C: usize> Shaded<C> {
    pub(super) fn new(stage: &Stage) -> Self {
        Self { table: Table::new(stage.bricks()), bricks: Vec::new(), results: Vec::new() }
    }

    /// Shades voxels again, given as what may have changed, and adds the boxes of those that have to `dirty`. Returns how many were shaded.
    pub(super) fn update(
        &mut self,
        shown: &Shown,
        voxels: &[Changed],
        shader: &Shader<f32>,
        simd: Simd,
        sharing: Sharing,
        dirty: &mut Vec<Dirty>,
    ) -> u64 {
        self.results.clear();
        self.results.resize_with(voxels.len(), || Result { at: [0; 3], shaded: 0, lit: Vec::new() });
        let (table, bricks) = (&self.table, &self.bricks);
        sharing.chunks(&mut self.results, BRICKS_PER_TASK, |task, results| {
            for (result, changed) in results.iter_mut().zip(&voxels[task * BRICKS_PER_TASK..]) {
                let before = table.get(changed.at).map(|slot| &bricks[slot]);
                result.at = changed.at;
                result.shaded = simd.fused(Shading { shown, changed, before, shader, lit: &mut result.lit });
            }
        });
        let mut shaded = 0;
        for Result { at, shaded: n, lit } in std::mem::take(&mut self.results) {
            shaded += n;
            let mut bounds: Option<Dirty> = None;
            for (place, lit) in lit {
                let voxel = [place % 8, place / 8 % 8, place / 64].map(usize::from);
                self.put(at, voxel, &lit);
                let voxel: [i64; 3] = std::array::from_fn(|a| at[a] * EDGE as i64 + voxel[a] as i64);
                let b = bounds.get_or_insert(Dirty { low: voxel, high: voxel });
                for (a, x) in voxel.into_iter().enumerate() {
                    (b.low[a], b.high[a]) = (b.low[a].min(x), b.high[a].max(x));
                }
            }
            dirty.extend(bounds);
        }
        shaded
    }

    /// Puts a voxel into its brick and those before it that keep it too.
    fn put(&mut self, at: [i64; 3], voxel: [usize; 3], lit: &Lit<f32, C>) {
        let reach = voxel.map(|v| usize::from(v == 0));
        for back in 0..8_usize {
            let back = [back & 1, back >> 1 & 1, back >> 2];
            if (0..3).any(|a| back[a] > reach[a]) {
                continue;
            }
            let place: [i64; 3] = std::array::from_fn(|a| at[a] - back[a] as i64);
            let Some(index) = self.table.index(place) else { continue };
            let cell = (0..3).rev().fold(0, |cell, a| cell * SIDE + voxel[a] + back[a] * EDGE);
            let slot = match self.table.slots()[index] {
                // What is transparent needs no brick.
                ABSENT if lit.alpha == 0.0 => continue,
                ABSENT => self.add(index),
                slot => slot as usize,
            };
            self.bricks[slot].set(cell, lit);
        }
    }

    fn add(&mut self, index: usize) -> usize {
        self.table.set(index, self.bricks.len() as u32);
        self.bricks.push(ShadedBrick { colour: [[0.0; CELLS]; C], alpha: [0.0; CELLS], filled: 0 });
        self.bricks.len() - 1
    }

    pub(super) fn bytes(&self) -> u64 {
        (size_of_val(self.table.slots()) + self.bricks.len() * size_of::<ShadedBrick<C>>()) as u64
    }
}

/// Shades the voxels of a brick that may have changed, and notes those that have; gives how many were shaded.
struct Shading<'a, const C: usize> {
    shown: &'a Shown,
    changed: &'a Changed,
    before: Option<&'a ShadedBrick<C>>,
    shader: &'a Shader<f32>,
    lit: &'a mut Vec<(u16, Lit<f32, C>)>,
}

impl<const C: usize> Fused for Shading<'_, C> {
    type Output = u64;

    #[inline(always)]
    fn run(self) -> u64 {
        let Self { shown, changed, before, shader, lit } = self;
        const STEP: [usize; 3] = [1, EDGE, EDGE * EDGE];
        let Some((brick, beside)) = shown.neighbourhood(changed.at) else { return 0 };
        let mut shaded = 0;
        for (z, layer) in changed.voxels.iter().enumerate() {
            let mut left = *layer;
            while left != 0 {
                let inside = left.trailing_zeros() as usize;
                left &= left - 1;
                let voxel = [inside % EDGE, inside / EDGE, z];
                let place = z * EDGE * EDGE + inside;
                let centre = (brick.value[place], brick.weight[place]);
                let mut now = Lit { colour: [0.0; C], alpha: 0.0 };
                if shader.may_show(centre) {
                    let mut around = [[(0.0, 0.0); 2]; 3];
                    for axis in 0..3 {
                        let span = (EDGE - 1) * STEP[axis];
                        for (side, at_end) in [(0, voxel[axis] == 0), (1, voxel[axis] + 1 == EDGE)] {
                            let (of, place) = match (at_end, side) {
                                (false, 0) => (Some(brick), place - STEP[axis]),
                                (false, _) => (Some(brick), place + STEP[axis]),
                                (true, 0) => (beside[2 * axis], place + span),
                                (true, _) => (beside[2 * axis + 1], place - span),
                            };
                            if let Some(of) = of {
                                around[axis][side] = (of.value[place], of.weight[place]);
                            }
                        }
                    }
                    let mut at = changed.at;
                    for axis in 0..3 {
                        at[axis] = at[axis] * EDGE as i64 + voxel[axis] as i64;
                    }
                    now = shader.shade(centre, around, at);
                    shaded += 1;
                }
                let cell = (voxel[2] * SIDE + voxel[1]) * SIDE + voxel[0];
                let same = match before {
                    Some(before) => before.is(cell, &now),
                    None => now.alpha == 0.0,
                };
                if !same {
                    lit.push((place as u16, now));
                }
            }
        }
        shaded
    }
}
