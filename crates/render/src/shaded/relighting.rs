//! Lights voxels again whose opacity is known: that of a voxel depends on no view.

use simd::sharing::Sharing;
use simd::wide::{Job, Set, Wide};
use simd::{LANES, Simd};
use volume::brick::EDGE;

use super::brick::{ShadedBrick, cell};
use super::neighbours::{ROWS, around, at, centre};
use super::{BRICKS_PER_TASK, Shaded};
use crate::classify::shade::Shader;
use crate::snapshot::{Bits, VoxelSnapshot, apart};

/// Job that lights the visible voxels of a brick; returns their number.
struct Relighting<'a, const C: usize> {
    snapshot: &'a VoxelSnapshot,
    shader: &'a Shader<f32>,
    at: [i64; 3],
    brick: &'a mut ShadedBrick<C>,
}

impl<const C: usize> Job for Relighting<'_, C> {
    type Output = u64;

    #[inline(always)]
    fn run<S: Set>(self) -> u64 {
        let Some((own, beside)) = self.snapshot.neighbourhood(self.at) else { return 0 };
        let mut lit = 0;
        for z in 0..EDGE {
            for y in (0..EDGE).step_by(ROWS) {
                let mut alpha = [0.0; LANES];
                for (lane, alpha) in alpha.iter_mut().enumerate() {
                    *alpha = self.brick.cells[cell([lane % EDGE, y + lane / EDGE, z])].alpha;
                }
                if alpha == [0.0; LANES] {
                    continue;
                }
                let place = (z * EDGE + y) * EDGE;
                let (centre, around) = (centre::<S>(own, place), around::<S>(own, beside, place));
                let shader = self.shader;
                let of = shader.relight::<_, C>(Wide::<S>::load(&alpha), centre, around, at(self.at, [y, z]));
                let mut colours = [[0.0; LANES]; C];
                for (colour, of) in colours.iter_mut().zip(of.colour) {
                    of.store(colour);
                }
                for (lane, alpha) in alpha.iter().enumerate() {
                    // Transparent voxels have no colour.
                    if *alpha > 0.0 {
                        lit += 1;
                        let cell = &mut self.brick.cells[cell([lane % EDGE, y + lane / EDGE, z])];
                        for (kept, colour) in cell.colour.iter_mut().zip(&colours) {
                            *kept = colour[lane];
                        }
                    }
                }
            }
        }
        lit
    }
}

impl<const C: usize> Shaded<C> {
    /// Lights the voxels of some visible bricks again, for a view in which they have the same
    /// opacity. Returns their number.
    pub(crate) fn relight(
        &mut self,
        snapshot: &VoxelSnapshot,
        places: &[[i64; 3]],
        shader: &Shader<f32>,
        (simd, sharing): (Simd, Sharing),
    ) -> u64 {
        let mut order: Vec<(usize, [i64; 3])> =
            places.iter().filter_map(|at| self.table.get(*at).map(|slot| (slot, *at))).collect();
        order.sort_unstable();
        let bricks = apart(&mut self.bricks, order.iter().map(|(slot, _)| *slot));
        let mut tasks: Vec<(u64, [i64; 3], &mut ShadedBrick<C>)> =
            bricks.zip(&order).map(|(brick, (_, at))| (0, *at, &mut **brick)).collect();
        sharing.chunks(&mut tasks, BRICKS_PER_TASK, |_, tasks| {
            for (lit, at, brick) in tasks {
                *lit = simd.wide(Relighting { snapshot, shader, at: *at, brick });
            }
        });
        let lit = tasks.iter().map(|(lit, ..)| lit).sum();
        let lit_again: Vec<([i64; 3], Bits)> = order.into_iter().map(|(_, at)| (at, [u64::MAX; EDGE])).collect();
        self.copy_to_those_before(&lit_again, sharing);
        lit
    }
}
