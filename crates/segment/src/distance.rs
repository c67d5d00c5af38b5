//! Distances between the voxels of a box, and the opening of a set of voxels by a ball.

use glam::DVec3;
use rayon::prelude::*;

use crate::error::SegmentError;

/// Most voxels that a ball reaches along an axis.
const MOST_VOXELS: u64 = 32;
/// Least lines that one thread takes at once.
const LINES: usize = 1 << 12;

/// Edges of a box of voxels: their number and their length along each axis.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Edges {
    pub(crate) size: [usize; 3],
    /// mm.
    pub(crate) spacing: DVec3,
}

impl Edges {
    /// Returns the squared distance from each voxel's centre to that of the nearest one in `to`,
    /// mm²; infinite where none is nearer than `reach_mm`. Voxels outside of the box do not count.
    pub(crate) fn squared(&self, to: impl Fn(usize) -> bool, reach_mm: f64) -> Vec<f32> {
        let start: Vec<f32> =
            (0..self.size.iter().product()).map(|at| if to(at) { 0.0 } else { f32::INFINITY }).collect();
        (0..3).fold(start, |squared, axis| self.squared_along(&squared, axis, reach_mm))
    }

    /// Adds the distances along one axis.
    fn squared_along(&self, from: &[f32], axis: usize, reach_mm: f64) -> Vec<f32> {
        let step: usize = self.size[..axis].iter().product();
        let (length, edge) = (self.size[axis], self.spacing[axis]);
        let reach = (reach_mm / edge).floor() as usize;
        let mut squared = vec![f32::INFINITY; from.len()];
        let line = |(number, line): (usize, &mut [f32])| {
            let (outer, at) = (number / length, number % length);
            for other in at.saturating_sub(reach)..(at + reach + 1).min(length) {
                let mm = at.abs_diff(other) as f64 * edge;
                let added = (mm * mm) as f32;
                let other = &from[(outer * length + other) * step..][..step];
                line.iter_mut().zip(other).for_each(|(least, other)| *least = least.min(other + added));
            }
        };
        squared.par_chunks_mut(step).enumerate().with_min_len(LINES / step.min(LINES)).for_each(line);
        squared
    }

    /// Opens a set of voxels by a ball: keeps what balls of this radius within the set cover.
    /// The box must have a border of one voxel without any of the set.
    ///
    /// # Errors
    /// [`SegmentError::Setting`], [`SegmentError::Wide`].
    pub(crate) fn open(&self, inside: &[bool], radius_mm: f64) -> Result<Vec<bool>, SegmentError> {
        let setting = "an opening";
        if !(radius_mm >= 0.0 && radius_mm.is_finite()) {
            return Err(SegmentError::Setting { setting, value: radius_mm, needs: "0 mm or more" });
        }
        let voxels = (radius_mm / self.spacing.min_element()) as u64;
        if voxels > MOST_VOXELS {
            return Err(SegmentError::Wide { setting, mm: radius_mm, voxels, most: MOST_VOXELS });
        }
        let most = (radius_mm * radius_mm) as f32;
        let outside = self.squared(|at| !inside[at], radius_mm);
        let centres = self.squared(|at| outside[at] > most, radius_mm);
        Ok(centres.iter().zip(inside).map(|(squared, inside)| *squared <= most && *inside).collect())
    }
}
