//! Frames of a frame grabber with known truth: a scanner's picture in a border with level and
//! noise, with letters, a logo, a ruler, a grey wedge, an ECG trace and a clock beside it.

use std::sync::{Arc, OnceLock};

use mask::Mask;
use rand::{Rng, RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use sonoweave_core::region::{ClipRect, Fan};
use sonoweave_core::slice::{Image, Pixels};

/// The true picture.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Truth {
    Rectangle(ClipRect),
    Fan(Fan),
    /// There is none.
    Nothing,
    /// The whole frame.
    Everything,
}

/// Things beside the picture.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Overlays {
    pub(crate) text: bool,
    pub(crate) logo: bool,
    pub(crate) ruler: bool,
    pub(crate) wedge: bool,
    pub(crate) ecg: bool,
    pub(crate) clock: bool,
}

/// A grabber's scene.
#[derive(Debug, Clone)]
pub(crate) struct Scene {
    pub(crate) size: [u32; 2],
    pub(crate) truth: Truth,
    pub(crate) level: f32,
    pub(crate) noise: f32,
    /// Mean level of bright tissue.
    pub(crate) gain: f32,
    /// Number of regions without echoes, some of them at the picture's edges.
    pub(crate) dark: usize,
    /// Whether the scanner is frozen: its picture does not change, the noise does.
    pub(crate) frozen: bool,
    /// Whether odd rows belong to a later time, and lie a pixel beside the even ones.
    pub(crate) interlaced: bool,
    /// Whether the line is too slow for sharp edges.
    pub(crate) blurred: bool,
    /// Columns of exact zeros at the left and right of each frame.
    pub(crate) blanking: u32,
    pub(crate) overlays: Overlays,
    pub(crate) seed: u64,
}

/// Edge of the tables, a power of two.
const TABLE: usize = 512;

/// Speckle with a mean of 1, and normal noise, as tables that repeat.
fn tables() -> &'static [Vec<f32>; 2] {
    static TABLES: OnceLock<[Vec<f32>; 2]> = OnceLock::new();
    TABLES.get_or_init(|| {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut normal = || -> Vec<f32> {
            let pair = |rng: &mut ChaCha8Rng| -> [f32; 2] {
                let (radius, angle) =
                    ((-2.0 * (1.0 - rng.random::<f32>()).ln()).sqrt(), std::f32::consts::TAU * rng.random::<f32>());
                [radius * angle.cos(), radius * angle.sin()]
            };
            (0..TABLE * TABLE / 2).flat_map(|_| pair(&mut rng)).collect()
        };
        let noise = normal();
        // Echoes of many scatterers: a complex normal field, smoothed along the beam and, more,
        // across it.
        let parts = [normal(), normal()].map(|part| smooth(&smooth(&part, 1, TABLE), 2, 1));
        let echo = |at: usize| parts[0][at].hypot(parts[1][at]);
        let mean = (0..TABLE * TABLE).map(echo).sum::<f32>() / (TABLE * TABLE) as f32;
        [(0..TABLE * TABLE).map(|at| (echo(at) / mean).powf(0.7)).collect(), noise]
    })
}

/// Sums over windows of 2·radius + 1 along one direction.
fn smooth(values: &[f32], radius: usize, stride: usize) -> Vec<f32> {
    let count = values.len();
    let window = |at: usize| -> f32 {
        (0..=2 * radius).map(|k| values[(at + count + k * stride - radius * stride) % count]).sum()
    };
    (0..count).map(window).collect()
}

impl Scene {
    /// Returns the true mask; that of the whole frame without a picture.
    pub(crate) fn mask(&self) -> Mask {
        let [width, height] = self.size;
        match self.truth {
            Truth::Rectangle(rect) => Mask::rect(width, height, rect),
            Truth::Fan(fan) => Mask::fan(width, height, &fan),
            Truth::Nothing | Truth::Everything => Mask::full(width, height),
        }
    }

    /// Paints the first frames.
    pub(crate) fn frames(&self, count: usize) -> Vec<Image> {
        let [width, height] = self.size.map(|n| n as usize);
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let tissue = self.tissue(&mut rng);
        let still: Vec<(usize, f32)> = self.static_overlays(&mut rng);
        let offset = |rng: &mut ChaCha8Rng| rng.random_range(0..TABLE * TABLE);
        let frozen = [offset(&mut rng), offset(&mut rng)];
        let [speckle, noise] = tables();
        let frame = |index: usize| {
            let offsets = if self.frozen { frozen } else { [offset(&mut rng), offset(&mut rng)] };
            let mut clean = vec![self.level; width * height];
            for (v, row) in clean.chunks_exact_mut(width).enumerate() {
                let field = if self.interlaced { v % 2 } else { 0 };
                for (u, pixel) in row.iter_mut().enumerate() {
                    // A field a pixel to the right: comb-like edges.
                    let amount = tissue[v * width + u.saturating_sub(field)];
                    if amount > 0.0 {
                        *pixel += amount * speckle[(offsets[field] + v * TABLE + u) % (TABLE * TABLE)];
                    }
                }
            }
            let moving = self.moving_overlays(index, &mut rng);
            for (at, value) in still.iter().chain(&moving) {
                clean[*at] = self.level + value;
            }
            if self.blurred {
                for row in clean.chunks_exact_mut(width) {
                    let sharp = row.to_vec();
                    for u in 1..width - 1 {
                        row[u] = 0.25 * (sharp[u - 1] + 2.0 * sharp[u] + sharp[u + 1]);
                    }
                }
            }
            let mut pixels = Vec::with_capacity(clean.len());
            for row in clean.chunks_exact(width) {
                let begin = offset(&mut rng);
                for (u, value) in row.iter().enumerate() {
                    let value = value + self.noise * noise[(begin + u) % (TABLE * TABLE)];
                    let blank = (u as u32) < self.blanking || u as u32 + self.blanking >= self.size[0];
                    pixels.push(if blank { 0 } else { value.round().clamp(0.0, 255.0) as u8 });
                }
            }
            Image::new(self.size[0], self.size[1], Pixels::U8(Arc::from(pixels)))
        };
        (0..count).map(frame).collect()
    }

    /// Returns the mean echo of each pixel; 0 outside of the picture.
    fn tissue(&self, rng: &mut impl Rng) -> Vec<f32> {
        let [width, height] = self.size.map(|n| n as usize);
        let mask = match self.truth {
            Truth::Nothing => return vec![0.0; width * height],
            _ => self.mask(),
        };
        let scale = height as f32 / 480.0;
        let waves: Vec<[f32; 3]> = (0..4)
            .map(|_| {
                let angle = std::f32::consts::TAU * rng.random::<f32>();
                let wave = rng.random_range(0.02..0.05) / scale;
                [wave * angle.cos(), wave * angle.sin(), std::f32::consts::TAU * rng.random::<f32>()]
            })
            .collect();
        let bounds = mask.bounds().unwrap();
        let dark: Vec<[f32; 3]> = (0..self.dark)
            .map(|_| {
                let u = bounds.x as f32 + rng.random::<f32>() * bounds.width as f32;
                let v = bounds.y as f32 + rng.random::<f32>() * bounds.height as f32;
                [u, v, scale * rng.random_range(12.0..45.0)]
            })
            .collect();
        // A transducer's face is never black: its reverberations are the brightest part.
        let face = match self.truth {
            Truth::Fan(fan) => Some((fan.origin_px().map(|at| at as f32), fan.radii_px()[0] as f32 + 24.0 * scale)),
            _ => None,
        };
        let mut tissue = vec![0.0; width * height];
        for v in 0..self.size[1] {
            for span in mask.row(v) {
                for u in span.start..span.end {
                    let (x, y) = (u as f32, v as f32);
                    let sum: f32 = waves.iter().map(|[a, b, c]| (a * x + b * y + c).sin()).sum();
                    let is_dark = dark.iter().any(|[du, dv, radius]| (x - du).hypot(y - dv) < *radius);
                    let is_near = face.is_some_and(|([au, av], radius)| (x - au).hypot(y - av) < radius);
                    // Tissue is never wholly black, cysts are.
                    let amount = if is_dark && !is_near { 0.02 } else { 0.6 + 0.1 * sum };
                    tissue[v as usize * width + u as usize] = self.gain * amount;
                }
            }
        }
        tissue
    }

    /// Returns the box of a picture, or the middle of the frame without one.
    fn bounds(&self) -> ClipRect {
        let [width, height] = self.size;
        match self.truth {
            Truth::Nothing => ClipRect { x: width / 4, y: height / 4, width: width / 2, height: height / 2 },
            _ => self.mask().bounds().unwrap(),
        }
    }

    /// Pixels and levels of things that do not move. They lie on the border alone.
    fn static_overlays(&self, rng: &mut impl Rng) -> Vec<(usize, f32)> {
        let (mut ink, picture) = (Vec::new(), self.bounds());
        let scale = (self.size[1] / 480).max(1);
        let Overlays { text, logo, ruler, wedge, .. } = self.overlays;
        if text {
            for line in 0..5 {
                self.letters(8 * scale, (12 + 16 * line) * scale, rng.random_range(4..12), rng, &mut ink);
            }
            let right = (picture.x + picture.width + 6).min(self.size[0]);
            for line in 0..3 {
                self.letters(right, picture.y + (40 + 20 * line) * scale, 6, rng, &mut ink);
            }
        }
        if logo {
            self.block([self.size[0] - 60 * scale, 6 * scale, 48 * scale, 28 * scale], 150.0, &mut ink);
        }
        if wedge {
            let height = self.size[1] / 3;
            self.block([4 * scale, self.size[1] / 2, 12 * scale, height], 180.0, &mut ink);
        }
        if ruler {
            // Ticks three pixels beside the picture's box, and every second one longer.
            let u = picture.x + picture.width + 3;
            for tick in 0..picture.height / (20 * scale) {
                let length = if tick % 2 == 0 { 10 } else { 5 };
                self.block([u, picture.y + tick * 20 * scale, length * scale, scale.max(2)], 200.0, &mut ink);
            }
        }
        let mask = self.mask();
        let whole = matches!(self.truth, Truth::Nothing | Truth::Everything);
        ink.retain(|(at, _)| {
            let (u, v) = (*at as u32 % self.size[0], *at as u32 / self.size[0]);
            whole || !mask.contains(u, v)
        });
        ink
    }

    /// Pixels and levels of the ECG trace and the clock.
    fn moving_overlays(&self, frame: usize, rng: &mut impl Rng) -> Vec<(usize, f32)> {
        let (mut ink, picture) = (Vec::new(), self.bounds());
        let scale = (self.size[1] / 480).max(1);
        if self.overlays.clock {
            self.letters(self.size[0] / 2, 3 * scale, 8, rng, &mut ink);
        }
        if self.overlays.ecg {
            let base = (picture.y + picture.height + 12 * scale).min(self.size[1] - 4);
            for u in picture.x..picture.x + picture.width {
                let beat = (u as usize + 7 * frame) % 90;
                let rise = if beat < 8 { 8 - beat.abs_diff(4) as u32 * 2 } else { 0 } * scale;
                self.block([u, base - rise.min(base), 1, 2], 170.0, &mut ink);
            }
        }
        let mask = self.mask();
        ink.retain(|(at, _)| !mask.contains(*at as u32 % self.size[0], *at as u32 / self.size[0]) || mask.is_full());
        ink
    }

    /// Writes random letters: strokes of two pixels in cells of 8×12.
    fn letters(&self, u: u32, v: u32, count: u32, rng: &mut impl Rng, ink: &mut Vec<(usize, f32)>) {
        let scale = (self.size[1] / 480).max(1);
        for letter in 0..count {
            let left = u + letter * 9 * scale;
            for _ in 0..3 {
                let (x, y) = (rng.random_range(0..5) * scale, rng.random_range(0..9) * scale);
                let size = if rng.random() { [2 * scale, 10 * scale - y] } else { [7 * scale - x, 2 * scale] };
                self.block([left + x, v + y, size[0], size[1]], 210.0, ink);
            }
        }
    }

    fn block(&self, [u, v, width, height]: [u32; 4], value: f32, ink: &mut Vec<(usize, f32)>) {
        for row in v..(v + height).min(self.size[1]) {
            ink.extend(
                (u..(u + width).min(self.size[0])).map(|u| (row as usize * self.size[0] as usize + u as usize, value)),
            );
        }
    }
}
