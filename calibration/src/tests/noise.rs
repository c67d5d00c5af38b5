//! Random numbers for tests: the same for the same seed, on every machine.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};

/// A stream of random numbers (Steele, Lea & Flood's SplitMix64).
#[derive(Debug, Clone)]
pub(crate) struct Noise(u64);

impl Noise {
    pub(crate) fn new(seed: u64) -> Self {
        // The generator itself scatters the seed. Otherwise the streams of neighbouring seeds
        // would be the same stream, shifted by one number.
        let mut scattered = Self(seed);
        Self(scattered.bits() ^ scattered.bits().rotate_left(32))
    }

    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Returns a uniform number from 0 to below 1.
    pub(crate) fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / 9_007_199_254_740_992.0
    }

    /// Returns a uniform number between two limits.
    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Returns a normal number of standard deviation 1.
    pub(crate) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (TAU * self.uniform()).cos()
    }

    /// Returns a normal vector with this standard deviation along each axis.
    pub(crate) fn vector(&mut self, sd: f64) -> DVec3 {
        DVec3::new(self.normal(), self.normal(), self.normal()) * sd
    }

    /// Returns a small rotation with this standard deviation (rad) about each axis.
    pub(crate) fn turn(&mut self, sd_rad: f64) -> DQuat {
        DQuat::from_scaled_axis(self.vector(sd_rad))
    }

    /// Returns a uniformly distributed rotation.
    pub(crate) fn rotation(&mut self) -> DQuat {
        DQuat::from_xyzw(self.normal(), self.normal(), self.normal(), self.normal()).normalize()
    }
}

/// Returns eᵀ·Σ⁻¹·e: about N on average if Σ is the covariance of e.
pub(crate) fn mahalanobis<const N: usize>(error: [f64; N], covariance: &[[f64; N]; N]) -> f64 {
    let matrix = nalgebra::DMatrix::from_fn(N, N, |i, j| covariance[i][j]);
    let error = nalgebra::DVector::from_column_slice(&error);
    let solved = matrix.cholesky().expect("a covariance").solve(&error);
    error.dot(&solved)
}
