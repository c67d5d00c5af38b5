//! The first voxels of a brick along each axis, which the seven bricks before it keep too: one
//! keeps a face of them, others an edge or the corner.
//!
//! The changed bricks' voxels are read first and then written, because most of these bricks are
//! also written to. Threads share both.

use simd::sharing::Sharing;
use volume::brick::EDGE;

use super::Shaded;
use super::brick::{Border, FACE, ShadedBrick, cell, voxels_of};
use crate::classify::shade::Lit;
use crate::snapshot::{ABSENT, Bits, FIRST_X, apart};

/// Row y = 0 of a layer's bits.
const FIRST_Y: u64 = 0xFF;
/// Bricks that a thread reads, or writes to, in one task.
const BRICKS_PER_TASK: usize = 8;

/// Returns the place of one of the first voxels in a border.
fn place([x, y, z]: [usize; 3]) -> usize {
    match (z, y) {
        (0, _) => y * EDGE + x,
        (_, 0) => FACE + z * EDGE + x,
        _ => 2 * FACE + z * EDGE + y,
    }
}

/// Returns those of the voxels that a brick before theirs keeps, which lies so many bricks back.
fn shared(voxels: &Bits, back: [usize; 3]) -> Bits {
    let layer = if back[0] == 1 { FIRST_X } else { u64::MAX } & if back[1] == 1 { FIRST_Y } else { u64::MAX };
    std::array::from_fn(|z| if back[2] == 1 && z > 0 { 0 } else { voxels[z] & layer })
}

/// A copy of voxels.
struct Copy {
    /// Slot of the brick that keeps them too, and the bricks between it and theirs.
    into: usize,
    back: [usize; 3],
    /// Number of their brick among those that are read.
    from: usize,
}

impl<const C: usize> ShadedBrick<C> {
    fn read_border(&self, border: &mut Border<C>) {
        for z in 0..EDGE {
            for y in 0..EDGE {
                let row = if z == 0 || y == 0 { EDGE } else { 1 };
                let [into, from] = [place([0, y, z]), cell([0, y, z])];
                border[into..into + row].copy_from_slice(&self.cells[from..from + row]);
            }
        }
    }
}

impl<const C: usize> Shaded<C> {
    /// Copies the given voxels of bricks to those before that keep them too; makes such bricks
    /// unless the voxels are transparent. Returns the indices in the table of the bricks that were
    /// written to.
    pub(super) fn copy_to_those_before(&mut self, changed: &[([i64; 3], Bits)], sharing: Sharing) -> Vec<usize> {
        let (mut sources, mut copies, mut written) = (Vec::new(), Vec::new(), Vec::new());
        for (at, voxels) in changed {
            let Some(own) = self.table.get(*at) else { continue };
            let before = copies.len();
            for back in 1..8_usize {
                let back = [back & 1, back >> 1 & 1, back >> 2];
                let voxels = shared(voxels, back);
                let Some(index) = self.table.index(std::array::from_fn(|a| at[a] - back[a] as i64)) else { continue };
                if voxels == [0; EDGE] {
                    continue;
                }
                let into = match self.table.slots()[index] {
                    // Transparent voxels need no brick.
                    ABSENT if (0..EDGE).all(|z| self.bricks[own].is_clear(z, voxels[z])) => continue,
                    ABSENT => self.add(index, self.stock.take()),
                    slot => slot as usize,
                };
                copies.push(Copy { into, back, from: sources.len() });
                written.push(index);
            }
            if copies.len() > before {
                sources.push((own, voxels));
            }
        }
        let Self { bricks, borders, interval, .. } = self;
        let blank = [Lit { colour: [0.0; C], alpha: 0.0 }; 3 * FACE];
        borders.resize(sources.len().max(borders.len()), blank);
        let borders = &mut borders[..sources.len()];
        sharing.chunks(borders, BRICKS_PER_TASK, |number, borders| {
            let sources = &sources[number * BRICKS_PER_TASK..];
            borders.iter_mut().zip(sources).for_each(|(border, (own, _))| bricks[*own].read_border(border));
        });
        copies.sort_by_key(|copy| copy.into);
        let groups = || copies.chunk_by(|a, b| a.into == b.into);
        let into = apart(bricks, groups().map(|group| group[0].into));
        let mut tasks: Vec<_> = into.zip(groups()).collect();
        let (borders, interval) = (&*borders, *interval);
        sharing.chunks(&mut tasks, BRICKS_PER_TASK, |_, tasks| {
            for (brick, copies) in tasks {
                for Copy { back, from, .. } in *copies {
                    for (z, layer) in shared(sources[*from].1, *back).into_iter().enumerate() {
                        for voxel in voxels_of(z, layer) {
                            let into = std::array::from_fn(|a| voxel[a] + back[a] * EDGE);
                            brick.set(cell(into), &borders[*from][place(voxel)], &interval);
                        }
                    }
                }
            }
        });
        written
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_brick_before_keeps_its_part_of_the_first_voxels() {
        let mut brick = *ShadedBrick::<1>::transparent();
        for z in 0..EDGE {
            for y in 0..EDGE {
                for x in 0..EDGE {
                    brick.cells[cell([x, y, z])].alpha = (1 + x + 10 * y + 100 * z) as f32;
                }
            }
        }
        let mut border = [Lit { colour: [0.0], alpha: 0.0 }; 3 * FACE];
        brick.read_border(&mut border);
        for back in 1..8_usize {
            let back = [back & 1, back >> 1 & 1, back >> 2];
            let parts = shared(&[u64::MAX; EDGE], back);
            let expected = back.iter().map(|back| if *back == 1 { 1 } else { EDGE }).product();
            assert_eq!(parts.iter().map(|layer| layer.count_ones() as usize).sum::<usize>(), expected, "{back:?}");
            for (z, layer) in parts.into_iter().enumerate() {
                for voxel in voxels_of(z, layer) {
                    assert!((0..3).all(|a| back[a] == 0 || voxel[a] == 0), "{back:?} {voxel:?}");
                    assert_eq!(border[place(voxel)].alpha, brick.cells[cell(voxel)].alpha, "{voxel:?}");
                }
            }
        }
    }
}
