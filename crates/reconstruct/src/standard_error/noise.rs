//! Noise of one slice's values for a whole volume.

use glam::DMat3;

use volume::brick::{EDGE, VOXELS};
use volume::{BrickVolume, Voxels};

use super::cell::{ACROSS, Cell, position, voxels_of};
use super::slopes::Slopes;
use crate::sample::{quantile, sample};

/// Effective number of slices from which a cell says much about noise.
const MANY: f64 = 3.0;
/// Cells with as many slices that suffice.
const ENOUGH: usize = 200;
/// Independent values of a cell's eight voxels, which share slices and pixels: from 4 for a kernel
/// of σ = 0.6 voxel to 2 for one voxel. It matters little.
const INDEPENDENT: f64 = 3.0;
/// Effective number of slices below which a cell says nothing.
const FEW: f64 = 1.3;

/// Noise of a volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Standard deviation of one slice's in-plane filtered values, grey levels.
    pub grey: f64,
    /// Median over the seen cells of the effective number of slices.
    pub slices: f64,
}

/// Returns the noise of a volume; `None` if it keeps no sums of squares or no voxel was reached by
/// two slices. Its variance is that of a slice's value about the slope of what is seen, as the
/// median over cells.
///
/// Slices at distances q from a voxel have different values where the volume has a slope along
/// their normal. `across` gives the mean square of slope times distance: gᵀ·across·g for a gradient
/// g.
///
/// It is that of cells with more than three slices. If these are few, it is that of all with more
/// than 1.3, of which each says less. At most `most` voxels are read.
pub(super) fn noise(volume: &BrickVolume, spacing_mm: [f64; 3], across: &DMat3, most: usize) -> Option<Noise> {
    let (mut many, mut all, mut slices) = (Vec::new(), Vec::new(), Vec::new());
    for block in sample(volume, most) {
        let (mut r, mut w) = ([0.0; VOXELS], [0.0; VOXELS]);
        volume.block(block, &mut r, &mut w);
        let cells = Cell::of_block(volume, block, &w);
        slices.extend(cells.iter().flatten().map(|cell| cell.slices));
        if cells.iter().flatten().all(|cell| cell.slices <= FEW) {
            continue;
        }
        let slopes = Slopes::new(volume, block, spacing_mm);
        for (number, cell) in cells.iter().enumerate() {
            let Some(cell) = cell.filter(|cell| cell.slices > FEW) else { continue };
            let gradients = voxels_of(position(number, ACROSS)).map(|voxel| slopes.of(position(voxel, EDGE)));
            let by_slope: f64 = gradients.map(|g| g.dot(*across * g)).sum::<f64>() / 8.0;
            let variance = about_slope(&cell, by_slope);
            all.push(variance);
            if cell.slices > MANY {
                many.push(variance);
            }
        }
    }
    let variance = quantile(if many.len() < ENOUGH { &mut all } else { &mut many }, 0.5)?;
    Some(Noise { grey: variance.sqrt(), slices: quantile(&mut slices, 0.5)? })
}

/// Returns a cell's variance about the slope, scaled so that the median of many is the mean.
/// `by_slope` is the mean square of slope times distance.
fn about_slope(cell: &Cell, by_slope: f64) -> f64 {
    let degrees = cell.slices - 1.0;
    let variance = (cell.variance - by_slope * cell.slices / degrees).max(0.0);
    // The median of χ² over its degrees of freedom (Wilson & Hilferty 1931).
    let per_degree = 2.0 / (9.0 * (INDEPENDENT * degrees).max(1.0));
    variance / (1.0 - per_degree).powi(3)
}
