//! Standard error of each voxel's mean, from the spread of the slices that reach it.
//!
//! A slice gives a voxel one sample: its in-plane filtered value, with the weight w of kernel and
//! certainty. The volume keeps Σ w of each voxel, and for each cell of 2×2×2 voxels the sums of
//! Σ w² and of S = Σ w·(value − mean)². Over the voxels of a cell:
//!
//! | quantity | formula |
//! |---|---|
//! | effective number of slices | n = Σ (Σ w)² / Σ w² (Kish 1965) |
//! | variance of a slice's value | s² = Σ S / Σ w · n / (n − 1) |
//! | the same with the volume's noise s₀² | s̃² = (10·s₀² + (n − 1)·s²) / (9 + n) |
//! | standard error | √((s̃² + g²·p² / 3) / n) |
//!
//! Few slices reach a cell, so that its own variance is uncertain: the noise of the whole volume
//! counts as ten degrees of freedom. s₀² is the median over cells of the variance about the slope
//! of what is seen along the slices' normals. g is the length of the gradient. p is the error of
//! the poses, mm: it moves a slice as a whole, so that few slices show it in their spread, and it
//! counts as a part of each slice's noise. Smoothing also makes the errors of neighbouring slices
//! alike, which is left out: the intervals hold the truth often enough without (measured).
//!
//! It is the error of sampling and of noise. The blur by kernel and beam, shadows, slow errors of
//! the tracker and those of the calibration are not part of it. Neighbouring voxels share slices
//! and pixels: the mean over a region has a larger error than that of independent voxels.

mod cell;
mod noise;
mod slopes;
#[cfg(test)]
mod tests;

use glam::{DMat3, DVec3};

use volume::brick::{BrickIndex, EDGE, VOXELS};
use volume::read::SEEN;
use volume::{BrickVolume, Voxels};

use cell::{Cell, cell_around, position};
pub use noise::Noise;
use slopes::Slopes;

use super::reconstructor::Reconstructor;
use super::sample::{quantile, sample};

/// Voxels from which figures of a whole volume are taken, at most.
const MOST: usize = 1 << 20;
/// Degrees of freedom of the volume's noise.
const PRIOR: f64 = 10.0;

/// Standard errors of a volume's voxels. As [`Voxels`], a seen voxel's value is its standard error,
/// with weight 1.
pub struct StandardErrors<'a> {
    volume: &'a BrickVolume,
    spacing_mm: [f64; 3],
    /// Directions of the lattice's axes in the world.
    axes: DMat3,
    noise: Noise,
    /// p²/3, mm².
    pose_variance: f64,
}

/// The error of a voxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelError {
    /// Standard error of its value, grey levels.
    pub standard_error: f64,
    /// Effective number of slices that reach it, 1 or more.
    pub slices: f64,
}

/// An edge between what is seen brighter and darker.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// Standard error of the value there, grey levels, without that of the poses.
    pub standard_error: f64,
    /// Gradient of the values, in the world, grey levels per mm.
    pub gradient: DVec3,
}

/// Usual errors of a volume's seen voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    /// Median of the standard errors, grey levels.
    pub median: f64,
    /// Their 95th percentile.
    pub p95: f64,
    /// Median of the effective numbers of slices.
    pub slices: f64,
}

impl VoxelError {
    /// Returns the number of further slices that would halve the error; `None` if more are needed
    /// than the volume's other voxels have.
    pub fn halved_by(&self, noise: &Noise) -> Option<f64> {
        // The error falls with the root of the slices.
        let further = 3.0 * self.slices;
        (further <= noise.slices).then_some(further)
    }

    /// Returns half the width of the interval that holds the true value in 95 of 100 cases, grey
    /// levels.
    pub fn half_width_95(&self) -> f64 {
        self.half_width(1.959_964)
    }

    /// Returns half the width of the interval that a normal error would have within `normal`
    /// standard deviations.
    pub fn half_width(&self, normal: f64) -> f64 {
        self.standard_error * student(normal, PRIOR + self.slices - 1.0)
    }
}

/// Returns the quantile of Student's distribution from that of the normal one, for ten or more
/// degrees of freedom, to 0.001 (Fisher & Cornish 1960).
fn student(z: f64, degrees: f64) -> f64 {
    let [z3, z5, z7] = [3, 5, 7].map(|power| z.powi(power));
    z + (z3 + z) / (4.0 * degrees)
        + (5.0 * z5 + 16.0 * z3 + 3.0 * z) / (96.0 * degrees.powi(2))
        + (3.0 * z7 + 19.0 * z5 + 17.0 * z3 - 15.0 * z) / (384.0 * degrees.powi(3))
}

impl<'a> StandardErrors<'a> {
    /// Returns the standard errors of the volume. `pose_mm` is the root mean square error of places
    /// in the image by the noise of poses, 0 if it is unknown.
    ///
    /// Returns `None` if the volume keeps no sums of squares, or if no voxel was reached by two
    /// slices, which says nothing about noise.
    pub fn new(reconstructor: &'a Reconstructor, pose_mm: f64) -> Option<Self> {
        Some(Self::with_noise(reconstructor, Self::noise_of(reconstructor, MOST)?, pose_mm))
    }

    /// The same with a known [noise](Self::noise_of), which costs nothing.
    pub fn with_noise(reconstructor: &'a Reconstructor, noise: Noise, pose_mm: f64) -> Self {
        let (volume, spacing_mm) = (reconstructor.volume(), reconstructor.settings().spacing_mm.to_array());
        let m = reconstructor.world_from_lattice().affine().matrix3;
        let axes = DMat3::from_cols(m.x_axis.normalize(), m.y_axis.normalize(), m.z_axis.normalize());
        Self { volume, spacing_mm, axes, noise, pose_variance: pose_mm * pose_mm / 3.0 }
    }

    /// Returns the noise from at most this many voxels; `None` as for [`Self::new`].
    pub fn noise_of(reconstructor: &Reconstructor, most: usize) -> Option<Noise> {
        // The mean square of distances along the normals.
        let across = reconstructor.normals().mean() * reconstructor.kernels()?[2].sigma_effective_mm().powi(2);
        let spacing_mm = reconstructor.settings().spacing_mm.to_array();
        noise::noise(reconstructor.volume(), spacing_mm, &across, most)
    }

    /// Returns the noise of one slice's in-plane filtered values, grey levels: the standard
    /// deviation for the whole volume.
    pub fn noise(&self) -> f64 {
        self.noise.grey
    }

    /// Returns the usual errors; `None` if no voxel was seen. Those of a large volume are from a
    /// million voxels.
    pub fn summary(&self) -> Option<Summary> {
        let found: Vec<VoxelError> =
            sample(self.volume, MOST).flat_map(|block| self.errors(block).into_iter().flatten()).collect();
        let mut errors: Vec<f64> = found.iter().map(|error| error.standard_error).collect();
        let mut slices: Vec<f64> = found.iter().map(|error| error.slices).collect();
        let (median, p95) = (quantile(&mut errors, 0.5)?, quantile(&mut errors, 0.95)?);
        Some(Summary { median, p95, slices: quantile(&mut slices, 0.5)? })
    }

    /// Returns the error of a voxel, if it was seen.
    pub fn at(&self, voxel: [i64; 3]) -> Option<VoxelError> {
        let edge = EDGE as i64;
        let [Ok(x), Ok(y), Ok(z)] = voxel.map(|v| i32::try_from(v.div_euclid(edge))) else { return None };
        let squares = self.volume.squares([x, y, z]).filter(|_| self.volume.voxel(voxel).1 > SEEN)?;
        let first = voxel.map(|v| v.div_euclid(2) * 2);
        let weights = (0..8).map(|i| self.volume.voxel([0, 1, 2].map(|a| first[a] + (i >> a & 1))).1);
        let cell = Cell::new(weights, squares.cell(voxel.map(|v| v.rem_euclid(edge) as usize / 2)))?;
        let slope = || Slopes::at(self.volume, voxel, self.spacing_mm).length_squared();
        Some(self.error(&cell, if self.pose_variance > 0.0 { slope() } else { 0.0 }))
    }

    /// Returns the edge at a voxel, if it was seen.
    pub fn edge(&self, voxel: [i64; 3]) -> Option<Edge> {
        let without_poses = Self { pose_variance: 0.0, ..*self };
        let VoxelError { standard_error, .. } = without_poses.at(voxel)?;
        let gradient = self.axes * Slopes::at(self.volume, voxel, self.spacing_mm);
        Some(Edge { standard_error, gradient })
    }

    /// Returns the error of a voxel of a cell, with this square of the gradient.
    fn error(&self, cell: &Cell, slope: f64) -> VoxelError {
        let slices = cell.slices;
        let own = slices - 1.0;
        let variance = (PRIOR * self.noise.grey.powi(2) + own * cell.variance) / (PRIOR + own);
        VoxelError { standard_error: ((variance + slope * self.pose_variance) / slices).sqrt(), slices }
    }

    /// Returns the errors of a block's seen voxels, x fastest.
    fn errors(&self, block: BrickIndex) -> Box<[Option<VoxelError>; VOXELS]> {
        let mut errors = Box::new([None; VOXELS]);
        let (mut r, mut w) = ([0.0; VOXELS], [0.0; VOXELS]);
        self.volume.block(block, &mut r, &mut w);
        let cells = Cell::of_block(self.volume, block, &w);
        let slopes = (self.pose_variance > 0.0).then(|| Slopes::new(self.volume, block, self.spacing_mm));
        for (i, error) in errors.iter_mut().enumerate().filter(|(i, _)| w[*i] > SEEN) {
            let at = position(i, EDGE);
            let slope = slopes.as_ref().map_or(0.0, |slopes| slopes.of(at).length_squared());
            *error = cells[cell_around(at)].map(|cell| self.error(&cell, slope));
        }
        errors
    }
}

impl Voxels for StandardErrors<'_> {
    fn voxel(&self, voxel: [i64; 3]) -> (f32, f32) {
        self.at(voxel).map_or((0.0, 0.0), |error| (error.standard_error as f32, 1.0))
    }

    fn row(&self, [x, y, z]: [i64; 3], r: &mut [f32], w: &mut [f32]) {
        assert_eq!(r.len(), w.len());
        for (x, (r, w)) in (x..).zip(r.iter_mut().zip(w)) {
            (*r, *w) = self.voxel([x, y, z]);
        }
    }

    fn block(&self, block: BrickIndex, r: &mut [f32; VOXELS], w: &mut [f32; VOXELS]) {
        for (error, (r, w)) in self.errors(block).iter().zip(r.iter_mut().zip(w)) {
            (*r, *w) = error.map_or((0.0, 0.0), |error| (error.standard_error as f32, 1.0));
        }
    }

    fn seen_bounds(&self) -> Option<([i64; 3], [i64; 3])> {
        self.volume.seen_bounds()
    }

    fn blocks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        self.volume.blocks()
    }

    fn bytes(&self) -> u64 {
        self.volume.bytes()
    }
}
