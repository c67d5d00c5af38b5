//! Fully developed speckle: the amplitude of the sum of many scatterers' echoes.

use std::fmt;
use std::sync::Arc;

use glam::DVec3;

use crate::random::{Draws, Purpose};

/// Lattice points along each axis after which the field repeats; a power of two.
const PERIOD: usize = 128;

/// Grey level floor + scale · |a + ib|, with a and b independent Gaussian random fields of mean
/// 0 and variance 1 everywhere.
///
/// Each field is white noise on a lattice fixed in the world, filtered with a cubic B-spline.
/// It is divided by the standard deviation that the spline's taps give at that place. The
/// amplitude therefore has Rayleigh's distribution exactly at every point: mean √(π/2),
/// variance 2 − π/2, and a ratio of mean to standard deviation of 1.91. The field's correlation
/// falls to a half at one pitch. It repeats after 128 pitches, 76.8 mm in the standard scene,
/// which is longer than a sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct Speckle {
    /// Distance of lattice points, and the distance at which the fields' correlation has fallen
    /// to a half, mm.
    pub pitch_mm: f64,
    /// Grey level at which the echoes cancel.
    pub floor: f64,
    /// Grey levels for an amplitude of 1.
    pub scale: f64,
    scatterers: Arc<Scatterers>,
}

/// Real and imaginary part at each lattice point, x fastest.
#[derive(PartialEq)]
struct Scatterers(Vec<[f32; 2]>);

impl fmt::Debug for Scatterers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Scatterers({PERIOD}³)")
    }
}

impl Speckle {
    /// Draws speckle of the given pitch (mm, more than 0), of mean 20 + 38 √(π/2) = 67.6; one
    /// point in ten million exceeds 235.
    pub fn draw(seed: u64, pitch_mm: f64) -> Self {
        let mut draws = Draws::new(seed, Purpose::Speckle, 0);
        let scatterers = (0..PERIOD.pow(3)).map(|_| [draws.normal() as f32, draws.normal() as f32]).collect();
        Self { pitch_mm, floor: 20.0, scale: 38.0, scatterers: Arc::new(Scatterers(scatterers)) }
    }

    /// Pitch of the standard scene, mm.
    pub const STANDARD_PITCH_MM: f64 = 0.6;

    pub(crate) fn value(&self, world: DVec3) -> f64 {
        let [x, y, z] = (world / self.pitch_mm).to_array().map(Taps::at);
        let (mut a, mut b) = (0.0, 0.0);
        for (k, wz) in z.index.into_iter().zip(z.weight) {
            for (j, wy) in y.index.into_iter().zip(y.weight) {
                let row = &self.scatterers.0[(k * PERIOD + j) * PERIOD..][..PERIOD];
                let (mut row_a, mut row_b) = (0.0, 0.0);
                for (i, wx) in x.index.into_iter().zip(x.weight) {
                    let [sa, sb] = row[i];
                    row_a += wx * f64::from(sa);
                    row_b += wx * f64::from(sb);
                }
                a += wy * wz * row_a;
                b += wy * wz * row_b;
            }
        }
        self.floor + self.scale * (a * a + b * b).sqrt()
    }
}

/// The four lattice points under a cubic B-spline along one axis, and their weights with a sum
/// of squares of 1.
struct Taps {
    index: [usize; 4],
    weight: [f64; 4],
}

impl Taps {
    fn at(x: f64) -> Self {
        let base = x.floor();
        let t = x - base;
        let s = 1.0 - t;
        let (t2, s2) = (t * t, s * s);
        let weight = [s2 * s, (3.0 * t - 6.0) * t2 + 4.0, (3.0 * s - 6.0) * s2 + 4.0, t2 * t];
        let norm = weight.iter().map(|w| w * w).sum::<f64>().sqrt();
        // Far beyond any scan the cast saturates, and the field is wrong but still defined.
        let first = base as i64 - 1;
        let index = [0, 1, 2, 3].map(|k| (first.wrapping_add(k) & (PERIOD as i64 - 1)) as usize);
        Self { index, weight: weight.map(|w| w / norm) }
    }
}
