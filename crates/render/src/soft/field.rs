//! Computes the light that reaches the places of a volume from their opacities.

use glam::DVec3;

use simd::sharing::Sharing;
use volume::brick::EDGE;

use super::smoothed::Smoothed;
use crate::classify::soft::{LightField, SoftLight};
use crate::classify::transfer::Transfer;
use crate::region::RenderRegion;

/// Cells of a brick along an edge.
const CELLS: usize = EDGE / 2;
/// Share of a cell's light that comes from each of the four beside it, a slice nearer to the
/// light. Shadows are the softer, the farther the body that casts them.
const SPREAD: f32 = 0.09;
/// Box means of the opacity: cells on each side, and their shares.
const HOLLOWS: [(usize, f32); 3] = [(1, 0.4), (2, 0.35), (4, 0.25)];
/// Least light that is told apart; less is none.
const LEAST: f32 = 1e-4;

/// Computes the light at all cells of a region. `to_light` is a unit vector, world frame.
pub(super) fn light(
    volume: &Smoothed,
    transfer: &Transfer,
    (light, to_light): (&SoftLight, DVec3),
    region: &RenderRegion,
    sharing: Sharing<'_>,
) -> LightField {
    let opacity = Opacities::new(volume, transfer, region);
    // Cells per mm, along the lattice's axes.
    let towards = (region.region_from_world().matrix3 * to_light * 0.5).to_array();
    let edge_mm = 2.0 * region.spacing_mm().min_element();
    let (direct, hollows) =
        sharing.both(|| opacity.transmitted(transfer, towards, SPREAD), || opacity.hollows(transfer, edge_mm));
    let size = opacity.size;
    let mut cells = vec![[1.0; 4]; direct.len()];
    let extinction = light.extinction.map(|share| share as f32);
    let occlusion = light.occlusion as f32;
    let plane = size[0] * size[1];
    sharing.chunks(&mut cells, plane.max(1), |z, cells| {
        for (at, cell) in cells.iter_mut().enumerate() {
            let at = z * plane + at;
            if direct[at] >= 1.0 && hollows[at] <= 0.0 {
                continue;
            }
            let depth = direct[at].clamp(LEAST, 1.0);
            // log₂ and 2ˣ of numbers from 0 to 1, the same on every machine.
            let log = crate::elementary::log2_1p(depth - 1.0);
            let of = |share: f32| 1.0 + crate::elementary::exp2_m1(share * log);
            let hollow = hollows[at] * hollows[at];
            *cell = [of(extinction[0]), of(extinction[1]), of(extinction[2]), 0.0];
            cell[3] = 1.0 + crate::elementary::exp2_m1(-occlusion * hollow * std::f32::consts::LOG2_E);
        }
    });
    LightField::new(size, cells)
}

/// Opacities of cells, over the unit length of the transfer function.
pub(crate) struct Opacities {
    pub(crate) size: [usize; 3],
    pub(crate) alpha: Vec<f32>,
}

impl Opacities {
    fn new(volume: &Smoothed, transfer: &Transfer, region: &RenderRegion) -> Self {
        let size = region.bricks().map(|n| n as usize * CELLS);
        let index = |[x, y, z]: [usize; 3]| (z * size[1] + y) * size[0] + x;
        // Means of seen voxels; NaN where there are none.
        let mut mean = vec![f32::NAN; size.iter().product()];
        for (at, value, weight) in volume.smoothed_bricks() {
            let first = at.map(|b| b as usize * CELLS);
            for cell in 0..CELLS * CELLS * CELLS {
                let cell = [cell % CELLS, cell / CELLS % CELLS, cell / (CELLS * CELLS)];
                let (mut sum, mut seen) = (0.0_f32, 0.0_f32);
                for corner in 0..8 {
                    let [x, y, z] = [0, 1, 2].map(|a| 2 * cell[a] + (corner >> a & 1));
                    let voxel = (z * EDGE + y) * EDGE + x;
                    if weight[voxel] > 0.0 {
                        sum += value[voxel];
                        seen += 1.0;
                    }
                }
                if seen > 0.0 {
                    mean[index(std::array::from_fn(|a| first[a] + cell[a]))] = sum / seen;
                }
            }
        }
        let pitch = region.spacing_mm().to_array().map(|mm| (2.0 * mm) as f32);
        let stride = [1, size[0], size[0] * size[1]];
        let slope = |at: usize, place: [usize; 3]| {
            let along = |a: usize| {
                let [low, high] = [place[a] > 0, place[a] + 1 < size[a]];
                let low = if low { mean[at - stride[a]] } else { f32::NAN };
                let high = if high { mean[at + stride[a]] } else { f32::NAN };
                let [low, high] = [low, high].map(|of| if of.is_nan() { mean[at] } else { of });
                (high - low) / (2.0 * pitch[a])
            };
            let [x, y, z] = [along(0), along(1), along(2)];
            (x * x + y * y + z * z).sqrt()
        };
        let mut alpha = vec![0.0; mean.len()];
        for at in 0..mean.len() {
            if !mean[at].is_nan() {
                let place = [at % size[0], at / size[0] % size[1], at / stride[2]];
                let slope = if transfer.uses_gradient() { slope(at, place) } else { 0.0 };
                alpha[at] = transfer.alpha(mean[at], slope);
            }
        }
        Self { size, alpha }
    }

    /// Returns the share of the light that reaches each cell. `towards` leads to the light, cells
    /// per mm. Light goes from slice to slice along the axis nearest to it, and a share of it to
    /// each of four sides.
    pub(crate) fn transmitted(&self, transfer: &Transfer, towards: [f64; 3], spread: f32) -> Vec<f32> {
        let axis = (0..3).fold(0, |best, a| if towards[a].abs() > towards[best].abs() { a } else { best });
        let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
        let stride = [1, self.size[0], self.size[0] * self.size[1]];
        let (width, height, depth) = (self.size[u], self.size[v], self.size[axis]);
        let along = towards[axis].abs();
        let shift = [u, v].map(|a| (towards[a] / along) as f32);
        // From a slice to the next.
        let way_mm = (1.0 / along) as f32;
        let mut light = vec![1.0_f32; self.alpha.len()];
        // Light that leaves the slice before.
        let (mut before, mut spread_light) = (vec![1.0_f32; width * height], vec![1.0_f32; width * height]);
        for n in 0..depth {
            let slice = if towards[axis] > 0.0 { depth - 1 - n } else { n };
            let place = |i: usize, j: usize| slice * stride[axis] + i * stride[u] + j * stride[v];
            for j in 0..height {
                for i in 0..width {
                    light[place(i, j)] = shifted(&before, [width, height], [i, j], shift);
                }
            }
            let of = |i: usize, j: usize| light[place(i, j)];
            for j in 0..height {
                for i in 0..width {
                    let beside = of(i.saturating_sub(1), j)
                        + of((i + 1).min(width - 1), j)
                        + of(i, j.saturating_sub(1))
                        + of(i, (j + 1).min(height - 1));
                    spread_light[j * width + i] = spread * beside + (1.0 - 4.0 * spread) * of(i, j);
                }
            }
            for j in 0..height {
                for i in 0..width {
                    let at = place(i, j);
                    light[at] = spread_light[j * width + i];
                    before[j * width + i] = light[at] * (1.0 - over(transfer, self.alpha[at], way_mm));
                }
            }
        }
        light
    }

    /// Returns the mean opacity over `edge_mm` around each cell, of boxes of several sizes.
    fn hollows(&self, transfer: &Transfer, edge_mm: f64) -> Vec<f32> {
        let of_edge: Vec<f32> = self.alpha.iter().map(|alpha| over(transfer, *alpha, edge_mm as f32)).collect();
        let mut sum = vec![0.0; of_edge.len()];
        for (radius, share) in HOLLOWS {
            let mut mean = of_edge.clone();
            for axis in 0..3 {
                self.box_means(&mut mean, axis, radius);
            }
            sum.iter_mut().zip(mean).for_each(|(sum, mean)| *sum += share * mean);
        }
        sum
    }

    /// Replaces cells by the means of those around along an axis; none lie outside.
    fn box_means(&self, cells: &mut [f32], axis: usize, radius: usize) {
        let stride = [1, self.size[0], self.size[0] * self.size[1]];
        let n = self.size[axis];
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut line = vec![0.0_f64; n + 1];
        for j in 0..self.size[v] {
            for i in 0..self.size[u] {
                let first = i * stride[u] + j * stride[v];
                for k in 0..n {
                    line[k + 1] = line[k] + f64::from(cells[first + k * stride[axis]]);
                }
                for k in 0..n {
                    let [from, to] = [k.saturating_sub(radius), (k + radius + 1).min(n)];
                    cells[first + k * stride[axis]] = ((line[to] - line[from]) / (2 * radius + 1) as f64) as f32;
                }
            }
        }
    }
}

/// Returns an opacity over a way in mm. Most cells are transparent.
fn over(transfer: &Transfer, alpha: f32, way_mm: f32) -> f32 {
    if alpha > 0.0 { transfer.step_corrected(alpha, way_mm) } else { 0.0 }
}

/// Returns the light between four cells of a slice, of which all is open outside.
#[inline(always)]
fn shifted(slice: &[f32], [width, height]: [usize; 2], [i, j]: [usize; 2], [du, dv]: [f32; 2]) -> f32 {
    let (x, y) = (i as f32 + du, j as f32 + dv);
    let (left, top) = (x.floor(), y.floor());
    let (right, below) = (x - left, y - top);
    let of = |x: i64, y: i64| {
        let inside = (0..width as i64).contains(&x) && (0..height as i64).contains(&y);
        if inside { slice[y as usize * width + x as usize] } else { 1.0 }
    };
    let (left, top) = (left as i64, top as i64);
    let upper = of(left, top) + right * (of(left + 1, top) - of(left, top));
    let lower = of(left, top + 1) + right * (of(left + 1, top + 1) - of(left, top + 1));
    upper + below * (lower - upper)
}
