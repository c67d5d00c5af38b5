//! The first picture of a new view, before any voxel is lit for it: a few rays, which light the
//! voxels they meet themselves.
//!
//! One ray is cast for every eighth pixel (in a large picture for every sixteenth, …). It takes
//! the nearest voxel at every second sample, which counts twice, and lights it like all voxels.
//! If the voxels' light does not depend on the view, it takes all samples. Pixels between the
//! rays are interpolated bilinearly. Opacity does not depend on the view, so bricks without
//! visible voxels are known and skipped.

use glam::DVec3;

use simd::sharing::Sharing;
use simd::{Fused, Simd};
use volume::brick::EDGE;

use crate::camera::{Camera, Ray};
use crate::classify::shade::Shader;
use crate::rays::composite::{Accumulated, Fold};
use crate::rays::line::Line;
use crate::rays::slab::Footprint;
use crate::refine::adaptive::{REGION, bilinear};
use crate::region::RenderRegion;
use crate::shaded::Shaded;
use crate::snapshot::{FACES, VoxelSnapshot};
use crate::voxels::Sampler;
use crate::work::RenderWork;

/// Approximate upper limit of the rays along a side of the picture.
const MOST_RAYS: usize = 40;
/// Samples that each taken sample stands for.
const STRIDE: u32 = 2;

/// Inputs of the preview rays.
#[derive(Clone, Copy)]
pub(crate) struct PreviewInputs<'a, const C: usize> {
    pub(crate) camera: &'a Camera,
    pub(crate) region: &'a RenderRegion,
    /// Set if the voxels are not lit for this view.
    pub(crate) unlit: Option<Unlit<'a, C>>,
    pub(crate) sampler: Sampler<'a, C>,
    pub(crate) fold: Fold,
}

/// Voxels that have to be lit first.
#[derive(Clone, Copy)]
pub(crate) struct Unlit<'a, const C: usize> {
    pub(crate) snapshot: &'a VoxelSnapshot,
    pub(crate) shaded: &'a Shaded<C>,
    pub(crate) shader: &'a Shader<f32>,
}

/// A grid of rays.
pub(crate) struct Preview<const C: usize> {
    size: [usize; 2],
    spacing: usize,
    count: [usize; 2],
    nodes: Vec<Accumulated<C>>,
}

impl<const C: usize> Preview<C> {
    /// Creates an empty preview.
    pub(crate) fn new(size: [u32; 2]) -> Self {
        let size = size.map(|s| s as usize);
        let mut spacing = REGION;
        while size.iter().any(|s| s.div_ceil(spacing) > MOST_RAYS) {
            spacing *= 2;
        }
        let count = size.map(|s| (s - 1).div_ceil(spacing) + 1);
        Self { size, spacing, count, nodes: vec![Accumulated::CLEAR; count[0] * count[1]] }
    }

    /// Returns the pixels between rays.
    pub(crate) fn spacing(&self) -> usize {
        self.spacing
    }

    fn pixel(&self, node: usize, axis: usize) -> usize {
        (node * self.spacing).min(self.size[axis] - 1)
    }

    /// Casts the rays that some footprints reach, or all; returns their number.
    pub(crate) fn cast(
        &mut self,
        inputs: PreviewInputs<'_, C>,
        reached: Option<&[Footprint]>,
        simd: Simd,
        sharing: Sharing,
    ) -> u64 {
        let [columns, rows] = self.count;
        let mut nodes = std::mem::take(&mut self.nodes);
        let mut cast = vec![0; rows];
        let lattice = &*self;
        sharing.chunks_beside(&mut nodes, columns, &mut cast, |cast, row, nodes| {
            let j = lattice.pixel(row, 1) as u32;
            for (column, node) in nodes.iter_mut().enumerate() {
                let i = lattice.pixel(column, 0) as u32;
                let concerns = |footprint: &Footprint| {
                    let Footprint { columns, rows, .. } = footprint;
                    (columns[0]..=columns[1]).contains(&i) && (rows[0]..=rows[1]).contains(&j)
                };
                if reached.is_none_or(|reached| reached.iter().any(concerns)) {
                    *node = simd.fused(PreviewRay { inputs, at: [i, j] });
                    *cast += 1;
                }
            }
        });
        self.nodes = nodes;
        cast.iter().sum()
    }

    /// Draws row `j` of the picture.
    pub(crate) fn draw(&self, j: usize, pixels: &mut [Accumulated<C>]) {
        // The cell of a pixel along an axis, and the part of it that lies before the pixel.
        let part = |at: usize, axis: usize| {
            let cell = (at / self.spacing).min(self.count[axis].saturating_sub(2));
            let [from, to] = [cell, cell + 1].map(|node| self.pixel(node, axis));
            (cell, (at - from) as f32 / (to - from).max(1) as f32)
        };
        let (row, y) = part(j, 1);
        let [upper, lower] = [row, (row + 1).min(self.count[1] - 1)].map(|row| row * self.count[0]);
        for (i, pixel) in pixels.iter_mut().enumerate() {
            let (column, x) = part(i, 0);
            let right = (column + 1).min(self.count[0] - 1);
            *pixel = bilinear(
                [upper + column, upper + right, lower + column, lower + right].map(|node| self.nodes[node]),
                [x, y],
            );
        }
    }
}

/// One ray.
struct PreviewRay<'a, const C: usize> {
    inputs: PreviewInputs<'a, C>,
    at: [u32; 2],
}

impl<const C: usize> Fused for PreviewRay<'_, C> {
    type Output = Accumulated<C>;

    #[inline(always)]
    fn run(self) -> Accumulated<C> {
        let Self { inputs: PreviewInputs { camera, region, unlit, sampler, fold }, at: [i, j] } = self;
        let ray = camera.ray(i, j);
        let [low, high] = region.bounds();
        let first = region.first();
        let line = Line::new(
            &ray,
            [low[0] - first[0], low[1] - first[1], low[2] - first[2]],
            [high[0] - first[0], high[1] - first[1], high[2] - first[2]],
            camera.samples(),
        );
        let Some(Unlit { snapshot, shaded, shader }) = unlit else {
            return sampler.cast(&line, None, fold, &mut RenderWork::default());
        };
        let mut seen = Accumulated::CLEAR;
        // All rays sample at the same numbers.
        let mut k = line.first.next_multiple_of(STRIDE);
        let mut last = None;
        while k < line.end && seen.transmittance >= fold.stop {
            let at = (ray.base + ray.step * f64::from(k) + DVec3::splat(0.5)).floor();
            let voxel = [at.x as i64, at.y as i64, at.z as i64];
            let brick = [voxel[0] >> 3, voxel[1] >> 3, voxel[2] >> 3];
            if shaded.filled(brick).is_none() {
                k = beyond(&ray, k, brick).next_multiple_of(STRIDE);
                continue;
            }
            k += STRIDE;
            if last.is_none_or(|(at, _)| at != brick) {
                last = Some((brick, snapshot.neighbourhood(brick)));
            }
            let Some((_, Some((own, beside)))) = last else { continue };
            let inside = [voxel[0] & 7, voxel[1] & 7, voxel[2] & 7];
            let place = (inside[0] + inside[1] * 8 + inside[2] * 64) as usize;
            let centre = (own.value[place], own.weight[place]);
            if !shader.may_show(centre) {
                continue;
            }
            let mut around = [[(0.0, 0.0); 2]; 3];
            let mut face = 0;
            while face < FACES.len() {
                let (axis, side) = FACES[face];
                let pitch = 1_i64 << (3 * axis);
                let next = inside[axis] + side;
                // In the neighbouring brick the voxel lies on the opposite face.
                let (of, place) = match next {
                    0..8 => (Some(own), place as i64 + side * pitch),
                    _ => (beside[face], place as i64 - 7 * side * pitch),
                };
                if let Some(of) = of {
                    around[axis][usize::from(side > 0)] = (of.value[place as usize], of.weight[place as usize]);
                }
                face += 1;
            }
            let lit = shader.shade(centre, around, voxel);
            for _ in 0..STRIDE {
                seen.add(lit.colour, lit.alpha);
            }
        }
        seen
    }
}

/// Returns the first sample after `k` whose nearest voxel may lie in another brick.
#[inline(always)]
fn beyond(ray: &Ray, k: u32, brick: [i64; 3]) -> u32 {
    let mut least = f64::from(u16::MAX);
    for (a, brick) in brick.into_iter().enumerate() {
        let step = ray.step[a];
        if step != 0.0 {
            let face = (brick + i64::from(step > 0.0)) as f64 * EDGE as f64 - 0.5;
            least = least.min((face - ray.base[a]) / step);
        }
    }
    // Sample numbers do not exceed 65 000.
    (least.max(0.0).ceil() as u32).max(k + 1)
}
