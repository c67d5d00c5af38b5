//! Value and derivatives of a volume between its voxels, smoothed by a Gaussian.
//!
//! Sums of seen voxels are divided by the sum of their weights in the Gaussian (normalised
//! convolution, Knutsson & Westin 1993). Unseen voxels do not count. The derivatives are those of
//! the quotient.

use glam::{DMat3, DVec3};

use crate::block::Block;
use crate::error::SurfaceError;

/// Reach of the Gaussian, in its standard deviations. With 3, a sphere of 10 mm has an error of
/// 0.05 % of its volume.
const REACH: f64 = 4.0;
/// Most voxels within the reach.
const MOST_VOXELS: u64 = 32;
/// Least share of the Gaussian's weight that must lie on seen voxels.
const LEAST_SEEN: f64 = 0.25;

/// A Gaussian on the lattice.
pub(crate) struct Smoothing {
    /// Standard deviation along each axis, voxels.
    sigma: DVec3,
    reach: usize,
}

/// A smoothed value, with its derivatives by the place in voxels.
#[derive(Clone, Copy)]
pub(crate) struct Derivatives {
    /// Value; the sum of weights if these are summed.
    pub(crate) value: f64,
    /// First derivatives.
    pub(crate) gradient: DVec3,
    /// Second derivatives.
    pub(crate) second: DMat3,
}

/// Weights of the voxels along an axis: the Gaussian, its first and its second derivative.
struct Taps([Vec<f64>; 3]);

impl Taps {
    /// Sums of values along the axis, with each kind of weights.
    fn sums(&self, values: impl Iterator<Item = f64> + Clone) -> [f64; 3] {
        self.0.each_ref().map(|taps| taps.iter().zip(values.clone()).map(|(tap, value)| tap * value).sum())
    }

    fn at(&self, voxel: usize) -> [f64; 3] {
        self.0.each_ref().map(|taps| taps[voxel])
    }
}

impl Smoothing {
    /// Returns a Gaussian of standard deviation `sigma_mm` on voxels of these edges, mm.
    ///
    /// # Errors
    /// [`SurfaceError::WideBlur`] if it reaches over too many voxels.
    pub(crate) fn new(sigma_mm: f64, spacing: DVec3) -> Result<Self, SurfaceError> {
        let voxels = (REACH * sigma_mm / spacing.min_element()).ceil();
        if voxels > MOST_VOXELS as f64 {
            return Err(SurfaceError::WideBlur { sigma_mm, voxels: voxels as u64, most: MOST_VOXELS });
        }
        Ok(Self { sigma: DVec3::splat(sigma_mm) / spacing, reach: voxels as usize })
    }

    /// Voxels below the one that a place lies in.
    pub(crate) fn reach(&self) -> usize {
        self.reach
    }

    /// Voxels along each axis.
    pub(crate) fn taps(&self) -> usize {
        2 * self.reach + 1
    }

    /// Returns value and derivatives at a place, voxels, from a block whose lowest voxel is `low`.
    /// `None` if too little around it was seen.
    pub(crate) fn at(&self, block: &Block, place: DVec3, low: [i64; 3]) -> Option<Derivatives> {
        let first = [0, 1, 2].map(|a| (place[a].floor() as i64 - low[a]) as usize - self.reach);
        let taps = [0, 1, 2].map(|a| self.weights(a, place[a] - (low[a] + first[a] as i64) as f64));
        let whole = taps.each_ref().map(|taps| taps.sums(std::iter::repeat(1.0)));
        let (mut values, mut seen) = (Derivatives::ZERO, Derivatives::ZERO);
        for z in 0..self.taps() {
            for y in 0..self.taps() {
                let start = ((first[2] + z) * block.edge() + first[1] + y) * block.edge() + first[0];
                let row = block.values[start..][..self.taps()].iter().map(|value| f64::from(*value));
                let (along_y, along_z) = (taps[1].at(y), taps[2].at(z));
                if block.is_whole() {
                    values.add(taps[0].sums(row), along_y, along_z);
                } else {
                    let is_seen = |value: f64| if value.is_nan() { 0.0 } else { 1.0 };
                    values.add(
                        taps[0].sums(row.clone().map(|value| if value.is_nan() { 0.0 } else { value })),
                        along_y,
                        along_z,
                    );
                    seen.add(taps[0].sums(row.map(is_seen)), along_y, along_z);
                }
            }
        }
        if block.is_whole() {
            seen.add(whole[0], whole[1], whole[2]);
        }
        let least = LEAST_SEEN * whole.iter().map(|sums| sums[0]).product::<f64>();
        (seen.value >= least).then(|| values.divided_by(&seen))
    }

    /// Returns the weights along an axis, and their derivatives by `place`, which counts from the
    /// first voxel.
    fn weights(&self, axis: usize, place: f64) -> Taps {
        let variance = self.sigma[axis].powi(2);
        let distances = || (0..self.taps()).map(move |voxel| place - voxel as f64);
        let gauss: Vec<f64> = distances().map(|d| libm::exp(-d * d / (2.0 * variance))).collect();
        let first = distances().zip(&gauss).map(|(d, g)| -d / variance * g).collect();
        let second = distances().zip(&gauss).map(|(d, g)| (d * d / variance - 1.0) / variance * g).collect();
        Taps([gauss, first, second])
    }
}

impl Derivatives {
    const ZERO: Self = Self { value: 0.0, gradient: DVec3::ZERO, second: DMat3::ZERO };

    /// Adds sums along x, times the weights along y and z.
    fn add(&mut self, x: [f64; 3], y: [f64; 3], z: [f64; 3]) {
        self.value += x[0] * y[0] * z[0];
        self.gradient += DVec3::new(x[1] * y[0] * z[0], x[0] * y[1] * z[0], x[0] * y[0] * z[1]);
        let (xy, xz, yz) = (x[1] * y[1] * z[0], x[1] * y[0] * z[1], x[0] * y[1] * z[1]);
        self.second += DMat3::from_cols(
            DVec3::new(x[2] * y[0] * z[0], xy, xz),
            DVec3::new(xy, x[0] * y[2] * z[0], yz),
            DVec3::new(xz, yz, x[0] * y[0] * z[2]),
        );
    }

    /// Returns the quotient and its derivatives.
    fn divided_by(&self, by: &Self) -> Self {
        let value = self.value / by.value;
        let gradient = (self.gradient - by.gradient * value) / by.value;
        let outer = |a: DVec3, b: DVec3| DMat3::from_cols(a * b.x, a * b.y, a * b.z);
        let mixed = outer(gradient, by.gradient) + outer(by.gradient, gradient);
        Self { value, gradient, second: (self.second - by.second * value - mixed) * by.value.recip() }
    }
}
