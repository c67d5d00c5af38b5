//! Speckle: scatterers fixed in the body; those within the slice are added to the raster.

use glam::{DAffine3, DVec3, Vec3, Vec3Swizzles as _};

use simd::Fused;

use super::layout::{Layout, REACH};
use super::raster::Raster;
use super::real::{atan, exp_minus};
use super::spread::Spread;
use super::{Scanner, Transducer, hash};
use crate::body::{Body, Fibres, Nearby};
use crate::elementary::exp;

/// Cells along an edge of a block; neighbouring solids are determined once per block.
const BLOCK: i32 = 8;
const CELLS: usize = (BLOCK * BLOCK * BLOCK) as usize;
/// Half of the slice's thickness that counts, σ. The power beyond it is a thousandth.
const THICK: f64 = 2.3;

/// Parameters of a scanner and a body for adding scatterers to a raster.
#[derive(Debug, Clone)]
pub(super) struct Scatter {
    key: u32,
    texture: Texture,
    pitch: f64,
    /// Amplitude of scatterers, for each material.
    levels: Vec<f32>,
    /// For each row: 1/2σ² across the slice, and half of the thickness that counts within a
    /// block's radius.
    sharpness: Vec<f32>,
    half_mm: Vec<f64>,
    /// The largest of `half_mm`.
    most_half_mm: f64,
    /// Margin beyond the outermost beams and ranges, mm.
    beside: f64,
}

/// Scatterers of a block, field by field.
#[derive(Debug, Clone)]
pub(super) struct Batch {
    /// Face coordinates, mm; later column and row in x and y.
    x: [f32; CELLS],
    y: [f32; CELLS],
    z: [f32; CELLS],
    /// Position in the block, cells.
    at: [[f32; CELLS]; 3],
    re: [f32; CELLS],
    im: [f32; CELLS],
}

impl Batch {
    pub(super) fn new() -> Self {
        let none = [0.0; CELLS];
        Self { x: none, y: none, z: none, at: [none; 3], re: none, im: none }
    }
}

impl Scatter {
    pub(super) fn new(scanner: &Scanner, layout: &Layout, body: &Body) -> Self {
        let pitch = scanner.scatterer_pitch_mm;
        // A material without scatterers has amplitude 0, not 0 dB.
        let levels = body.materials.iter().map(|m| m.backscatter_db.map_or(0.0, |db| amplitude(db) as f32)).collect();
        let sigma: Vec<f64> = (0..layout.rows).map(|r| scanner.elevation_sigma_mm(layout.range(r).max(0.0))).collect();
        let near = (f64::from(BLOCK) * pitch / layout.range_step).ceil() as usize;
        let half_mm: Vec<f64> = (0..layout.rows)
            .map(|r| {
                let rows = r.saturating_sub(near)..(r + near + 1).min(layout.rows);
                THICK * sigma[rows].iter().copied().fold(0.0, f64::max)
            })
            .collect();
        let widest = (0..layout.rows).map(|r| scanner.lateral_sigma_mm(layout.range(r).max(0.0))).fold(0.0, f64::max);
        Self {
            key: hash::key(scanner.seed, 1),
            texture: Texture::new(hash::key(scanner.seed, 5)),
            pitch,
            levels,
            sharpness: sigma.iter().map(|s| (0.5 / (s * s)) as f32).collect(),
            most_half_mm: half_mm.iter().copied().fold(0.0, f64::max),
            half_mm,
            beside: REACH * widest.max(scanner.axial_sigma_mm()),
        }
    }

    /// Returns the blocks that may overlap the slice, as ranges along each axis of the body.
    fn blocks(&self, layout: &Layout, body_from_face: &DAffine3) -> [[i32; 2]; 3] {
        let [wide, high] = layout.transducer.extent_mm(layout.range(layout.rows));
        let rise = high - layout.range(layout.rows);
        let low = DVec3::new(-0.5 * wide - self.beside, -rise - self.beside, -self.most_half_mm);
        let high = DVec3::new(0.5 * wide + self.beside, high - rise + self.beside, self.most_half_mm);
        let (mut first, mut last) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for corner in 0..8 {
            let pick = |axis: usize| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] };
            let p = body_from_face.transform_point3(DVec3::new(pick(0), pick(1), pick(2)));
            (first, last) = (first.min(p), last.max(p));
        }
        let block = f64::from(BLOCK) * self.pitch;
        let [first, last] = [first, last].map(|p| (p / block).floor().to_array().map(|x| x as i32));
        [0, 1, 2].map(|axis| [first[axis], last[axis]])
    }
}

/// Returns the amplitude of a level.
pub(super) fn amplitude(db: f64) -> f64 {
    exp(db * (std::f64::consts::LN_10 / 20.0))
}

/// Adds all scatterers of a slice to a raster.
pub(super) struct Add<'a> {
    pub(super) scatter: &'a Scatter,
    pub(super) layout: &'a Layout,
    pub(super) spread: &'a Spread,
    pub(super) body: &'a Body,
    pub(super) body_from_face: &'a DAffine3,
    pub(super) raster: &'a mut Raster,
    pub(super) batch: &'a mut Batch,
    pub(super) nearby: &'a mut Nearby,
}

impl Fused for Add<'_> {
    type Output = u64;

    /// Returns the number of scatterers added.
    #[inline(always)]
    fn run(mut self) -> u64 {
        let face_from_body = self.body_from_face.inverse();
        let [xs, ys, zs] = self.scatter.blocks(self.layout, self.body_from_face);
        let edge = f64::from(BLOCK) * self.scatter.pitch;
        let reach = 0.5 * 3.0_f64.sqrt() * edge;
        let mut put = 0;
        for z in zs[0]..=zs[1] {
            for y in ys[0]..=ys[1] {
                for x in xs[0]..=xs[1] {
                    let centre = (DVec3::new(f64::from(x), f64::from(y), f64::from(z)) + 0.5) * edge;
                    let face = face_from_body.transform_point3(centre);
                    let Some(half) = self.half_thickness(face, reach) else { continue };
                    self.body.nearby(centre, reach, self.nearby);
                    if !self.nearby.is_silent(self.body) {
                        put += self.block([x, y, z], &face_from_body, half as f32);
                    }
                }
            }
        }
        put
    }
}

impl Add<'_> {
    /// Returns half of the slice's thickness at a block; `None` if the block lies outside the
    /// field.
    #[inline(always)]
    fn half_thickness(&self, face: DVec3, reach: f64) -> Option<f64> {
        if face.z.abs() > self.scatter.most_half_mm + reach {
            return None;
        }
        let beside = reach + self.scatter.beside;
        let (half, layout) = (self.layout.transducer.half_opening(), self.layout);
        let range = match layout.transducer {
            Transducer::Linear { .. } if face.x.abs() > half + beside => return None,
            Transducer::Linear { .. } => face.y,
            Transducer::Curvilinear { radius_mm, .. } => {
                let (_, direction) = layout.transducer.beam(half);
                let down = face.y + radius_mm;
                // Distance beyond the outermost beam on its side.
                if face.x.abs() * direction.y - down * direction.x > beside {
                    return None;
                }
                (face.x * face.x + down * down).sqrt() - radius_mm
            }
        };
        let row = range / layout.range_step + layout.above as f64;
        let rows = layout.rows as f64;
        let slack = reach / layout.range_step;
        if row < -slack || row > rows + slack {
            return None;
        }
        let half = self.scatter.half_mm[row.clamp(0.0, rows - 1.0) as usize];
        (face.z.abs() <= half + reach).then_some(half)
    }

    #[inline(always)]
    fn block(&mut self, block: [i32; 3], face_from_body: &DAffine3, half: f32) -> u64 {
        let pitch = self.scatter.pitch;
        let first = block.map(|b| b * BLOCK);
        let corner = DVec3::from_array(first.map(f64::from)) * pitch;
        let origin = face_from_body.transform_point3(corner).as_vec3();
        // One step along each axis of the body, in face coordinates, mm.
        let steps = face_from_body.matrix3 * pitch;
        let [ex, ey, ez] = [steps.x_axis, steps.y_axis, steps.z_axis].map(|v| v.as_vec3());
        let batch = &mut *self.batch;
        let mut n = 0;
        // Within a cell, the face's z has its extremes at the corners.
        let below = ex.z.min(0.0) + ey.z.min(0.0) + ez.z.min(0.0);
        let above = ex.z.max(0.0) + ey.z.max(0.0) + ez.z.max(0.0);
        for k in 0..BLOCK {
            for j in 0..BLOCK {
                let row = hash::row(first[1] + j, first[2] + k, self.scatter.key);
                let (j, k) = (j as f32, k as f32);
                let base = origin + ey * j + ez * k;
                // Cells of the row that may overlap the slice: −half ≤ base + i·step + [below,
                // above] ≤ half.
                let (low, high) = (-half - above - base.z, half - below - base.z);
                let (mut from, mut to) = (0, BLOCK);
                if ex.z.abs() > 1e-6 {
                    let ends = [low / ex.z, high / ex.z];
                    from = (ends[0].min(ends[1]).clamp(0.0, BLOCK as f32)).ceil() as i32;
                    to = (ends[0].max(ends[1]).clamp(-1.0, (BLOCK - 1) as f32)).floor() as i32 + 1;
                } else if low > 0.0 || high < 0.0 {
                    continue;
                }
                for i in from..to {
                    let [place, echo] = hash::in_row(row, first[0] + i);
                    const PART: f32 = 1.0 / 1024.0;
                    let u = i as f32 + (place & 1023) as f32 * PART;
                    let v = j + (place >> 10 & 1023) as f32 * PART;
                    let w = k + (place >> 20 & 1023) as f32 * PART;
                    batch.x[n] = origin.x + ex.x * u + ey.x * v + ez.x * w;
                    batch.y[n] = origin.y + ex.y * u + ey.y * v + ez.y * w;
                    batch.z[n] = origin.z + ex.z * u + ey.z * v + ez.z * w;
                    (batch.at[0][n], batch.at[1][n], batch.at[2][n]) = (u, v, w);
                    [batch.re[n], batch.im[n]] = hash::amplitudes(echo);
                    n += 1;
                }
            }
        }
        self.locate(n);
        self.put(n, corner)
    }

    /// Computes columns and rows of the batch's positions.
    #[inline(always)]
    fn locate(&mut self, n: usize) {
        let layout = self.layout;
        let per_row = (1.0 / layout.range_step) as f32;
        let above = layout.above as f32;
        let per_column = (1.0 / layout.lateral_step) as f32;
        let middle = layout.column(0.0) as f32;
        let Batch { x, y, .. } = &mut *self.batch;
        match layout.transducer {
            Transducer::Curvilinear { radius_mm, .. } => {
                let radius = radius_mm as f32;
                for (x, y) in x[..n].iter_mut().zip(&mut y[..n]) {
                    let down = *y + radius;
                    let length = (*x * *x + down * down).sqrt();
                    *x = atan(*x / down) * per_column + middle;
                    *y = (length - radius) * per_row + above;
                }
            }
            Transducer::Linear { .. } => {
                for (x, y) in x[..n].iter_mut().zip(&mut y[..n]) {
                    *x = *x * per_column + middle;
                    *y = *y * per_row + above;
                }
            }
        }
    }

    /// Adds the batch to the raster.
    #[inline(always)]
    fn put(&mut self, n: usize, corner: DVec3) -> u64 {
        let (scatter, body, batch) = (self.scatter, self.body, &*self.batch);
        let columns = self.layout.columns;
        let (corner, pitch) = (corner.as_vec3(), scatter.pitch as f32);
        let (last_column, last_row) = ((columns - 1) as f32, (self.layout.rows - 1) as f32);
        let only = self.nearby.only();
        let mut put = 0;
        for i in 0..n {
            let (x, y) = (batch.x[i], batch.y[i]);
            if !(x >= 0.0 && x < last_column && y >= 0.0 && y < last_row) {
                continue;
            }
            let (column, row) = (x as usize, y as usize);
            let off = batch.z[i] * batch.z[i] * scatter.sharpness[row];
            if off > (0.5 * THICK * THICK) as f32 {
                continue;
            }
            let place = corner + Vec3::new(batch.at[0][i], batch.at[1][i], batch.at[2][i]) * pitch;
            let material = usize::from(match only {
                Some(material) => material,
                None => self.nearby.material_at(body, place.as_dvec3()),
            });
            let mut level = scatter.levels[material];
            if level == 0.0 {
                continue;
            }
            if let Some(fibres) = &body.materials[material].fibres {
                level *= scatter.texture.layers(fibres, place);
            }
            let strength = level * exp_minus(off) * self.spread.of_scatterers[row];
            self.raster.put([column, row], [x - column as f32, y - row as f32], [batch.re[i], batch.im[i]], strength);
            put += 1;
        }
        put
    }
}

/// Modulation of the scatterers' strength by their position in the fibres' layers.
#[derive(Debug, Clone)]
struct Texture {
    /// Numbers of 0 to 1: a power of two of them, and the first again.
    noise: Vec<f32>,
}

impl Texture {
    const PERIOD: i32 = 1024;

    fn new(key: u32) -> Self {
        let number = |i: i32| (hash::mix(key ^ i as u32) >> 8) as f32 * (1.0 / 16_777_216.0);
        Self { noise: (0..=Self::PERIOD).map(|i| number(i % Self::PERIOD)).collect() }
    }

    /// Returns the largest integer not above x, which is small.
    #[inline(always)]
    fn floor(x: f32) -> i32 {
        // Truncation, corrected where it rounds up; `f32::floor` is a call without SSE 4.1.
        let toward_zero = x as i32;
        toward_zero - i32::from(toward_zero as f32 > x)
    }

    /// Returns the table's value at an integer, and linear interpolation between integers.
    #[inline(always)]
    fn at(&self, x: f32) -> f32 {
        let whole = Self::floor(x);
        let i = (whole & (Self::PERIOD - 1)) as usize;
        let (a, b) = (self.noise[i], self.noise[i + 1]);
        a + (b - a) * (x - whole as f32)
    }

    /// Returns the factor for a position in the body: about 0.7 to 1.3 between layers, and more
    /// within.
    #[inline(always)]
    fn layers(&self, fibres: &Fibres, p: Vec3) -> f32 {
        let layer = fibres.across.as_vec3() * (1.0 / fibres.spacing_mm) as f32;
        // Coordinates across the layers, and along them in two directions, not necessarily
        // perpendicular.
        let [across, e, f] = [p.dot(layer), p.dot(layer.yzx()), p.dot(layer.zxy())];
        // Layers bend, and their thickness varies over about ten times their distance.
        let bent = across + 0.8 * self.at(e * 0.09 + f * 0.05);
        let number = Self::floor(bent);
        let along = self.at(e * 0.11 - f * 0.07 + number as f32 * 17.3);
        let off = 2.0 * (bent - number as f32) - 1.0;
        let peak = 1.0 - off * off;
        let sharp = peak * peak * peak * peak;
        let slow = 0.7 + 0.6 * self.at(across * 0.13 + e * 0.031 - f * 0.043 + 511.0);
        slow + 2.0 * fibres.contrast as f32 * along * sharp * sharp
    }
}
