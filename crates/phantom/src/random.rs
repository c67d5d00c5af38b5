//! Random draws with the same bits on every machine.
//!
//! Each purpose and index has its own stream of ChaCha8. More draws for one purpose never
//! change another, and frames can be painted in any order.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::elementary::normal_quantile;

/// Purpose of the numbers. Each purpose has its own key, so that one seed serves them all
/// without correlation.
#[derive(Debug, Clone, Copy)]
pub(super) enum Purpose {
    /// Blobs and spheres.
    Scene = 1,
    /// The probe's random walk.
    Trajectory = 2,
    /// Grey noise; the stream is the frame's index.
    Noise = 3,
    /// Errors of the tracker; the stream is the frame's index.
    Tracker = 4,
    /// Scatterers of the speckle.
    Speckle = 5,
    /// Corrections and tremor of the probe's motion.
    Tremor = 6,
}

/// A stream of draws.
#[derive(Debug, Clone)]
pub(super) struct Draws(ChaCha8Rng);

impl Draws {
    /// Returns stream number `stream` for a purpose and a seed.
    pub(super) fn new(seed: u64, purpose: Purpose, stream: u64) -> Self {
        let mut key = [0; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        key[8] = purpose as u8;
        let mut generator = ChaCha8Rng::from_seed(key);
        generator.set_stream(stream);
        Self(generator)
    }

    /// Uniform in [low, high), in steps of 2⁻⁵³ of the width.
    pub(super) fn uniform(&mut self, low: f64, high: f64) -> f64 {
        // 53 bits: exact in a double.
        let unit = (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
        low + unit * (high - low)
    }

    /// Standard normal by inversion of 32 random bits: within ±6.3, mean 0 by symmetry, one
    /// word per draw.
    pub(super) fn normal(&mut self) -> f64 {
        let unit = (f64::from(self.0.next_u32()) + 0.5) / 4_294_967_296.0;
        normal_quantile(unit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_draws_have_normal_moments() {
        let mut draws = Draws::new(7, Purpose::Noise, 0);
        let n = 1_000_000;
        let mut sums = [0.0; 4];
        for _ in 0..n {
            let x = draws.normal();
            for (power, sum) in (1..).zip(&mut sums) {
                *sum += x.powi(power);
            }
        }
        let [m1, m2, m3, m4] = sums.map(|s| s / f64::from(n));
        // Five standard errors of each moment: √(1, 2, 15, 96) / 1000.
        assert!(m1.abs() < 5e-3 && (m2 - 1.0).abs() < 7.1e-3, "{m1} {m2}");
        assert!(m3.abs() < 1.94e-2 && (m4 - 3.0).abs() < 4.9e-2, "{m3} {m4}");
    }

    #[test]
    fn draws_depend_on_seed_purpose_and_stream_only() {
        let draw = |seed, purpose, stream| Draws::new(seed, purpose, stream).normal();
        assert_eq!(draw(1, Purpose::Scene, 0), draw(1, Purpose::Scene, 0));
        assert_ne!(draw(1, Purpose::Scene, 0), draw(2, Purpose::Scene, 0));
        assert_ne!(draw(1, Purpose::Scene, 0), draw(1, Purpose::Noise, 0));
        assert_ne!(draw(1, Purpose::Noise, 0), draw(1, Purpose::Noise, 1));
    }

    #[test]
    fn uniform_draws_cover_interval() {
        let mut draws = Draws::new(3, Purpose::Scene, 0);
        let all: Vec<f64> = (0..10_000).map(|_| draws.uniform(-2.0, 6.0)).collect();
        assert!(all.iter().all(|x| (-2.0..6.0).contains(x)));
        assert!(all.iter().any(|x| *x < -1.99) && all.iter().any(|x| *x > 5.99));
        assert!((all.iter().sum::<f64>() / 1e4 - 2.0).abs() < 0.12);
    }
}
