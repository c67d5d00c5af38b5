//! Samples between voxels, sixteen neighbours of a ray at once.
//!
//! The positions of all sixteen are computed together, in eight lanes; they depend only on the
//! ray. Then each sample reads the two voxels at either end of its cell's four edges along x,
//! which are adjacent in memory. It interpolates along z and y in as many lanes as the voxels
//! have numbers. Both loops are plain code in a form that the compiler vectorizes. Every
//! operation is IEEE's, in one order, so all ways of compiling give the same bits.

use volume::brick::EDGE;

use crate::classify::shade::Lit;
use crate::rays::line::Line;
use crate::shaded::{CELLS, SIDE, Shaded, ShadedBrick};
use crate::work::RenderWork;

/// Samples that are interpolated at once.
pub(crate) const RUN: u32 = 16;
const LANES: usize = RUN as usize;

/// Adding this to a small whole number leaves that number in the lowest bits, without a
/// conversion. The number must be below 2²³.
const WHOLE: f32 = 8_388_608.0;
/// Mask of those bits.
const WHOLE_BITS: u32 = 0x7F_FFFF;

/// Positions of samples, and the voxels around them.
pub(crate) struct Run<const C: usize> {
    /// Index of the brick in the table.
    brick: [u32; LANES],
    /// The cell's first voxel in the brick.
    cell: [u32; LANES],
    /// Distance from that voxel, along x, y and z.
    part: [[f32; LANES]; 3],
    /// The two ends along x, already interpolated along y and z.
    ends: [[Lit<f32, C>; 2]; LANES],
}

impl<const C: usize> Run<C> {
    const NOTHING: Lit<f32, C> = Lit { colour: [0.0; C], alpha: 0.0 };

    #[inline(always)]
    pub(crate) fn new() -> Self {
        Self { brick: [0; LANES], cell: [0; LANES], part: [[0.0; LANES]; 3], ends: [[Self::NOTHING; 2]; LANES] }
    }

    /// Replaces sample `i`.
    #[inline(always)]
    pub(crate) fn put(&mut self, i: usize, lit: Lit<f32, C>) {
        self.ends[i] = [lit; 2];
    }

    /// Returns a sample: the last step of its interpolation, along x.
    #[inline(always)]
    pub(crate) fn sample(&self, i: usize) -> Lit<f32, C> {
        let [before, behind] = self.ends[i];
        between(self.part[0][i], before, behind)
    }

    /// Computes positions. Lanes beyond a line's end may hold any position.
    #[inline(always)]
    fn place(&mut self, line: &Line, k: u32, [nx, ny, _]: [u32; 3]) {
        // Exact: there are fewer than 2¹⁶ samples, and fewer than 2²³ bricks along an axis.
        let k = k.cast_signed();
        let ([x, y, z], [bx, by, bz]) = (line.step, line.base);
        const EDGES: f32 = EDGE as f32;
        const ROW: f32 = SIDE as f32;
        const LAYER: f32 = (SIDE * SIDE) as f32;
        for i in 0..LANES {
            let k = k.wrapping_add(i as i32) as f32;
            let at = [x.mul_add(k, bx), y.mul_add(k, by), z.mul_add(k, bz)];
            let brick =
                [(at[0] * (1.0 / EDGES)).floor(), (at[1] * (1.0 / EDGES)).floor(), (at[2] * (1.0 / EDGES)).floor()];
            let inside =
                [brick[0].mul_add(-EDGES, at[0]), brick[1].mul_add(-EDGES, at[1]), brick[2].mul_add(-EDGES, at[2])];
            let floor = [inside[0].floor(), inside[1].floor(), inside[2].floor()];
            self.part[0][i] = inside[0] - floor[0];
            self.part[1][i] = inside[1] - floor[1];
            self.part[2][i] = inside[2] - floor[2];
            let cell = floor[2].mul_add(LAYER, floor[1].mul_add(ROW, floor[0] + WHOLE));
            self.cell[i] = cell.to_bits() & 0x3FF;
            let number = [
                (brick[0] + WHOLE).to_bits() & WHOLE_BITS,
                (brick[1] + WHOLE).to_bits() & WHOLE_BITS,
                (brick[2] + WHOLE).to_bits() & WHOLE_BITS,
            ];
            self.brick[i] = number[2].wrapping_mul(ny).wrapping_add(number[1]).wrapping_mul(nx).wrapping_add(number[0]);
        }
    }
}

/// Interpolates between shaded voxels.
#[derive(Clone, Copy)]
pub(crate) struct Reader<'a, const C: usize> {
    /// Slots of the bricks that are read, by index; samples elsewhere are transparent.
    slots: &'a [u32],
    bricks: &'a [Box<ShadedBrick<C>>],
    size: [u32; 3],
}

impl<'a, const C: usize> Reader<'a, C> {
    /// Creates a reader of the bricks in which a sample may be anything but transparent.
    pub(crate) fn of_visible(shaded: &'a Shaded<C>) -> Self {
        Self { slots: shaded.visible(), bricks: shaded.bricks(), size: shaded.size() }
    }

    /// Creates a reader of all bricks.
    pub(crate) fn of_all(shaded: &'a Shaded<C>) -> Self {
        Self { slots: shaded.kept(), ..Self::of_visible(shaded) }
    }

    /// Reads up to [`RUN`] samples of a line, `n` from `k` on, into a run. Returns false if all
    /// are transparent; the run must then not be read.
    #[inline(always)]
    pub(crate) fn run(&self, line: &Line, k: u32, n: u32, run: &mut Run<C>, work: &mut RenderWork) -> bool {
        run.place(line, k, self.size);
        let mut interpolated = 0;
        for i in 0..n.min(RUN) as usize {
            let mut ends = [Run::NOTHING; 2];
            if let Some(slot) = self.slots.get(run.brick[i] as usize)
                && let Some(brick) = self.bricks.get(*slot as usize)
            {
                ends = along_z_and_y(&brick.cells, run.cell[i] as usize, run.part[1][i], run.part[2][i]);
                interpolated += 1;
            }
            run.ends[i] = ends;
        }
        work.samples += u64::from(interpolated);
        work.samples_skipped += u64::from(n - interpolated);
        interpolated > 0
    }

    /// Returns the sample at one place; `None` outside of the read bricks or the region.
    #[inline(always)]
    pub(crate) fn at(&self, at: [f32; 3]) -> Option<Lit<f32, C>> {
        for (x, bricks) in at.iter().zip(self.size) {
            if !(*x >= 0.0 && *x < (bricks * EDGE as u32) as f32) {
                return None;
            }
        }
        let mut run = Run::new();
        let line = Line { base: at, step: [0.0; 3], first: 0, end: 1 };
        if self.run(&line, 0, 1, &mut run, &mut RenderWork::default()) { Some(run.sample(0)) } else { None }
    }
}

/// Interpolates between a voxel and the next.
#[inline(always)]
fn between<const C: usize>(part: f32, a: Lit<f32, C>, b: Lit<f32, C>) -> Lit<f32, C> {
    let mut lit = a;
    for c in 0..C {
        lit.colour[c] = part.mul_add(b.colour[c] - a.colour[c], a.colour[c]);
    }
    lit.alpha = part.mul_add(b.alpha - a.alpha, a.alpha);
    lit
}

/// Interpolates a cell along z, then y; returns both ends along x.
#[inline(always)]
fn along_z_and_y<const C: usize>(cells: &[Lit<f32, C>; CELLS], first: usize, y: f32, z: f32) -> [Lit<f32, C>; 2] {
    const LAYER: usize = SIDE * SIDE;
    // One bounds check for all eight.
    let cells = &cells[first..][..LAYER + SIDE + 2];
    let edge = [between(z, cells[0], cells[LAYER]), between(z, cells[1], cells[LAYER + 1])];
    let next = [between(z, cells[SIDE], cells[LAYER + SIDE]), between(z, cells[SIDE + 1], cells[LAYER + SIDE + 1])];
    [between(y, edge[0], next[0]), between(y, edge[1], next[1])]
}
