//! Samples of rays inside a body between planes: Ohbuchi's D-buffer, a first and a last sample
//! of each pixel.
//!
//! For all rays of a view, each plane is an affine function of the pixel. For parallel rays it
//! gives the number of the sample where a ray meets the plane. In perspective it gives the
//! inverse of that distance along the view's axis. At a pixel, a body between planes thus
//! extends from the largest of some affine functions to the smallest of others. Planes along the
//! rays only limit the pixels concerned.

use glam::{DMat3, DVec3};

use volume::prism::Faces;

use crate::camera::{Camera, Ray};
use crate::shaded::Dirty;

/// Faces are moved outwards by this, in voxels: more than the rounding of samples in single
/// precision.
pub(crate) const SLACK: f64 = 1e-2;
/// Planes count as parallel to a ray that approaches them by less per sample (perspective: on
/// the way from the eye).
const PARALLEL: f64 = 1e-12;
/// Pixels around the projection of a box that are included.
const MARGIN: f64 = 1.0;

/// All rays of a view, region coordinates: `origin + right·i + down·j + forward·k` for parallel
/// rays; `origin + (forward + right·i + down·j)·s` in perspective. There s is the distance from
/// the eye along the view's axis.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ViewRays {
    /// Pixel distance at 1 mm along the view's axis, and distance of sample 0 from the eye, mm;
    /// `None` for parallel rays.
    perspective: Option<[f64; 2]>,
    origin: DVec3,
    right: DVec3,
    down: DVec3,
    forward: DVec3,
    /// Maps to (i, j, k), or (i·s, j·s, s).
    pixel_from_region: DMat3,
    size: [u32; 2],
    /// Offset of pixel (0, 0) from the view's axis, pixels.
    corner: [f64; 2],
    step_mm: f64,
}

impl ViewRays {
    pub(crate) fn new(camera: &Camera) -> Self {
        let (Ray { base: origin, step: forward }, [right, down]) = camera.first_ray();
        let size = camera.size();
        Self {
            perspective: camera.perspective(),
            origin,
            right,
            down,
            forward,
            pixel_from_region: DMat3::from_cols(right, down, forward).inverse(),
            size,
            corner: size.map(|n| 0.5 * (1.0 - f64::from(n))),
            step_mm: camera.step_mm(),
        }
    }

    /// Returns the first and last pixel to the right and down that a box can reach, inclusive;
    /// `None` if it is not in the picture. Beside the eye of a perspective view a box may be
    /// anywhere.
    pub(crate) fn pixels(&self, low: DVec3, high: DVec3) -> Option<[[u32; 2]; 2]> {
        let (mut least, mut most) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        if self.perspective.is_some() {
            for seen in self.corners(low, high) {
                for a in 0..2 {
                    let [from, to] = match seen.z > 1e-6 {
                        true => [seen[a] / seen.z; 2],
                        false => [f64::NEG_INFINITY, f64::INFINITY],
                    };
                    (least[a], most[a]) = (least[a].min(from), most[a].max(to));
                }
            }
        } else {
            let centre = self.pixel_from_region * (0.5 * (low + high) - self.origin);
            let half = 0.5 * (high - low);
            for a in 0..2 {
                let reach = self.pixel_from_region.row(a).abs().dot(half);
                (least[a], most[a]) = (centre[a] - reach, centre[a] + reach);
            }
        }
        let axis = |a: usize| {
            let (first, last) = ((least[a] - MARGIN).ceil(), (most[a] + MARGIN).floor());
            let end = f64::from(self.size[a]) - 1.0;
            (first <= end && last >= 0.0).then(|| [first.max(0.0) as u32, last.min(end) as u32])
        };
        Some([axis(0)?, axis(1)?])
    }

    /// Returns the first and last place in a box that rays can reach, in samples.
    pub(crate) fn samples(&self, low: DVec3, high: DVec3) -> [f64; 2] {
        let Some([pixel, near_mm]) = self.perspective else {
            let centre = self.pixel_from_region.row(2).dot(0.5 * (low + high) - self.origin);
            let reach = self.pixel_from_region.row(2).abs().dot(0.5 * (high - low));
            return [centre - reach, centre + reach];
        };
        // The farthest place is a corner. The nearest one is not nearer than its distance along the
        // axis, times the least length of the rays that see the box.
        let (mut along, mut farthest) = (f64::INFINITY, 0.0_f64);
        let mut aside = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for seen in self.corners(low, high) {
            let offset = [0, 1].map(|a| (self.corner[a] * seen.z + seen[a]) * pixel);
            along = along.min(seen.z);
            farthest = farthest.max((seen.z * seen.z + offset[0] * offset[0] + offset[1] * offset[1]).sqrt());
            for (aside, offset) in aside.iter_mut().zip(offset) {
                *aside = [aside[0].min(offset / seen.z), aside[1].max(offset / seen.z)];
            }
        }
        if along <= 1e-6 {
            return [f64::NEG_INFINITY, (farthest - near_mm) / self.step_mm];
        }
        let [x, y] = aside.map(|[from, to]| from.max(-to).max(0.0));
        [along * (1.0 + x * x + y * y).sqrt(), farthest].map(|mm| (mm - near_mm) / self.step_mm)
    }

    /// Returns the corners of a box in a perspective view: offset in pixels from pixel (0, 0) times
    /// the distance along the axis, and that distance, mm.
    fn corners(&self, low: DVec3, high: DVec3) -> impl Iterator<Item = DVec3> {
        (0..8_usize).map(move |corner| {
            let at = DVec3::from_array(std::array::from_fn(|a| if corner >> a & 1 == 0 { low[a] } else { high[a] }));
            self.pixel_from_region * (at - self.origin)
        })
    }
}

/// A body between up to N planes, as seen by a view's rays. Each plane is an affine function of
/// the pixel: its value at pixel (0, 0), and its steps to the right and down.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Body<const N: usize> {
    planes: [[f64; 3]; N],
    /// Number of planes that the parameter must be above and below; the remaining planes must
    /// not be negative.
    above: usize,
    below: usize,
    all: usize,
}

impl<const N: usize> Body<N> {
    /// Creates the body between some pairs of planes, at most N / 2.
    pub(crate) fn new(rays: &ViewRays, pairs: &[Faces]) -> Self {
        let (mut above, mut below, mut beside) = ([[0.0; 3]; N], [[0.0; 3]; N], [[0.0; 3]; N]);
        let mut counts = [0; 3];
        for pair in pairs {
            for (normal, most) in [(pair.normal, pair.high), (-pair.normal, -pair.low)] {
                // Along a ray: slope·parameter ≤ rest, which is affine in the pixel.
                let steps = [rays.forward, rays.right, rays.down].map(|v| normal.dot(v));
                let room = most - normal.dot(rays.origin);
                let (slope, rest) = match rays.perspective {
                    None => (steps[0], [room, -steps[1], -steps[2]]),
                    Some(_) => (-room, steps.map(|x| -x)),
                };
                let (list, count) = match slope {
                    s if s.abs() < PARALLEL => (&mut beside, &mut counts[2]),
                    s if s < 0.0 => (&mut above, &mut counts[0]),
                    _ => (&mut below, &mut counts[1]),
                };
                list[*count] = if slope.abs() < PARALLEL { rest } else { rest.map(|x| x / slope) };
                *count += 1;
            }
        }
        let mut planes = [[0.0; 3]; N];
        let lists = [above, below, beside];
        let mut all = 0;
        for (list, count) in lists.iter().zip(counts) {
            planes[all..all + count].copy_from_slice(&list[..count]);
            all += count;
        }
        Self { planes, above: counts[0], below: counts[1], all }
    }

    /// Returns a row of pixels: value at its first pixel and steps to the right.
    #[inline(always)]
    pub(crate) fn row(&self, j: u32) -> BodyRow<N> {
        let j = f64::from(j);
        let mut planes = [[0.0; 2]; N];
        for (row, [base, right, down]) in planes.iter_mut().zip(self.planes) {
            *row = [base + down * j, right];
        }
        BodyRow { planes, above: self.above, below: self.below, all: self.all, j }
    }
}

/// A body at a row of pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BodyRow<const N: usize> {
    planes: [[f64; 2]; N],
    above: usize,
    below: usize,
    all: usize,
    j: f64,
}

impl<const N: usize> BodyRow<N> {
    /// Returns the first and last pixel of the row, within a range, that see the body, both
    /// inclusive. Empty if the last is smaller.
    #[inline(always)]
    pub(crate) fn columns(&self, [first, last]: [u32; 2]) -> [i64; 2] {
        let mut range = [f64::from(first), f64::from(last)];
        let (above, rest) = self.planes[..self.all].split_at(self.above);
        let (below, beside) = rest.split_at(self.below);
        for low in above {
            for high in below {
                not_negative([high[0] - low[0], high[1] - low[1]], &mut range);
            }
        }
        for plane in beside {
            not_negative(*plane, &mut range);
        }
        // The margin of 1e-5 covers rounding for nearly parallel planes. For those an empty
        // range can also have arbitrary ends.
        let [begin, end] = [(range[0] - 1e-5).ceil(), (range[1] + 1e-5).floor()];
        [begin.min(f64::from(u32::MAX)) as i64, end.max(-1.0) as i64]
    }

    /// Returns the first and last place of a pixel's ray in the body, in samples; none if the
    /// last is smaller.
    #[inline(always)]
    pub(crate) fn samples(&self, rays: &ViewRays, i: u32) -> [f64; 2] {
        let i = f64::from(i);
        let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
        for [base, step] in &self.planes[..self.above] {
            from = from.max(base + step * i);
        }
        for [base, step] in &self.planes[self.above..self.above + self.below] {
            to = to.min(base + step * i);
        }
        for [base, step] in &self.planes[self.above + self.below..self.all] {
            if base + step * i < 0.0 {
                return [1.0, 0.0];
            }
        }
        let Some([pixel, near_mm]) = rays.perspective else { return [from, to] };
        // The parameter is the inverse distance, so nearer places have larger values.
        if to <= 0.0 || from > to {
            return [1.0, 0.0];
        }
        let (x, y) = ((rays.corner[0] + i) * pixel, (rays.corner[1] + self.j) * pixel);
        let length = (1.0 + x * x + y * y).sqrt();
        let near = (length / to - near_mm) / rays.step_mm;
        let far = if from > 0.0 { (length / from - near_mm) / rays.step_mm } else { f64::INFINITY };
        [near, far]
    }
}

/// Narrows a range to where an affine function is not negative.
#[inline(always)]
fn not_negative([base, step]: [f64; 2], range: &mut [f64; 2]) {
    if step > 0.0 {
        range[0] = range[0].max(-base / step);
    } else if step < 0.0 {
        range[1] = range[1].min(-base / step);
    } else if base < 0.0 {
        *range = [1.0, 0.0];
    }
}

/// Returns the whole samples between two places, clipped to a range, and `reach` more behind
/// that depend on them; empty if there are none.
#[inline(always)]
pub(crate) fn whole([from, to]: [f64; 2], [first, end]: [u32; 2], reach: u32) -> [u32; 2] {
    // Conversions saturate at 0 and at the largest integer.
    let range = [(from.ceil() as u32).max(first), ((to + 1.0 + f64::from(reach)).floor() as u32).min(end)];
    if from <= to && range[0] < range[1] { range } else { [first, first] }
}

/// Returns the box of samples that changed voxels affect, as pairs of faces.
fn faces(dirty: &Dirty) -> [Faces; 3] {
    std::array::from_fn(|a| Faces {
        normal: DVec3::AXES[a],
        low: dirty.low[a] as f64 - 1.0 - SLACK,
        high: dirty.high[a] as f64 + 1.0 + SLACK,
    })
}

/// Widens two faces to the samples that can change with the voxels between them. These lie
/// within a voxel of the relit voxels, which are the changed ones and their six neighbours.
fn reached(pair: Faces) -> Faces {
    let normal = pair.normal.abs();
    let reach = normal.max_element() + normal.element_sum() * (1.0 + SLACK);
    Faces { low: pair.low - reach, high: pair.high + reach, ..pair }
}

/// A box of changed voxels, projected to the picture's pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Footprint {
    body: Body<6>,
    /// First and last pixel to the right and down, inclusive.
    pub(crate) columns: [u32; 2],
    pub(crate) rows: [u32; 2],
}

impl Footprint {
    /// Returns `None` if it is not in the picture.
    pub(crate) fn new(dirty: &Dirty, rays: &ViewRays) -> Option<Self> {
        let pairs = faces(dirty);
        let [low, high] = [pairs.map(|f| f.low), pairs.map(|f| f.high)].map(DVec3::from_array);
        let [columns, rows] = rays.pixels(low, high)?;
        Some(Self { body: Body::new(rays, &pairs), columns, rows })
    }

    #[inline(always)]
    pub(crate) fn row(&self, j: u32) -> BodyRow<6> {
        self.body.row(j)
    }
}

impl Body<12> {
    /// Creates the body that holds all changed voxels, from their box and, if known, the slab of
    /// the slice that changed them.
    pub(crate) fn around(dirty: &Dirty, slab: Option<&[Faces; 3]>, rays: &ViewRays) -> Self {
        let [x, y, z] = faces(dirty);
        match slab.map(|faces| faces.map(reached)) {
            None => Self::new(rays, &[x, y, z]),
            Some([u, v, n]) => Self::new(rays, &[u, v, n, x, y, z]),
        }
    }
}

#[cfg(test)]
mod tests;
