//! Checks timed results against the equations in f64 at a sample of voxels.

use std::error::Error;

use glam::DVec3;

use mask::Mask;
use reconstruct::reference::Reference;
use reconstruct::{Reconstructor, Settings};
use sonoweave_core::frames::{Transform, Volume, World};
use sonoweave_core::slice::Slice;
use volume::brick::{BrickIndex, EDGE, VOXELS};
use volume::brick_volume::SEEN;
use volume::{Grid, Voxels};

use crate::report::Report;

/// Number of compared cubes of voxels, and their edge in voxels.
const CUBES: usize = 40;
const CUBE: i64 = 4;
/// Voxels with less weight lie at the end of the support or of the data, where rounding decides
/// whether they are seen.
const FIRM: f64 = 0.05;
/// Relative difference above which two weights, beyond the filter's error bound, cannot come from
/// the same slices.
const SAME_WEIGHT: f64 = 0.02;
/// Maximum share of compared voxels that only one of the two sees, or that have other weights.
const ONE_SIDED: f64 = 0.02;

/// Deviation of values from the expected ones, grey values.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Deviation {
    pub(crate) voxels: u64,
    pub(crate) one_sided: u64,
    pub(crate) rms: f64,
    pub(crate) max: f64,
    /// Maximum permitted deviation, root mean square and of any one voxel.
    pub(crate) bounds: [f64; 2],
}

impl Deviation {
    /// Calculates the deviation over pairs of a value and its expected value.
    pub(crate) fn over(pairs: impl Iterator<Item = (Option<f64>, Option<f64>)>, bounds: [f64; 2]) -> Self {
        let mut deviation = Self { bounds, ..Self::default() };
        let mut squares = 0.0;
        for pair in pairs {
            match pair {
                (Some(value), Some(expected)) => {
                    let error = (value - expected).abs();
                    deviation.voxels += 1;
                    squares += error * error;
                    // `f64::max` would drop a NaN.
                    deviation.max = if error <= deviation.max { deviation.max } else { error };
                }
                (None, None) => {}
                _ => deviation.one_sided += 1,
            }
        }
        deviation.rms = (squares / deviation.voxels as f64).sqrt();
        deviation
    }

    fn is_right(&self) -> bool {
        // False if no voxel was compared, and for NaN.
        self.rms <= self.bounds[0]
            && self.max <= self.bounds[1]
            && self.one_sided as f64 <= ONE_SIDED * self.voxels as f64
    }

    /// Notes a wrong result in the report.
    pub(crate) fn note(&self, what: &str, report: &mut Report) {
        if !self.is_right() {
            report.wrong(format!("{what}: {self:?}"));
        }
    }
}

/// Compares a volume with the equations on cubes spread evenly over its bricks.
///
/// The bound at any one voxel is ten times the in-plane filter's error bound for its samples, for
/// a frame of 8 bits. Numerator and weight may both deviate. If only a fifth of the kernel lies
/// on data (less does not count as seen), the quotient deviates five times as far. Such a bound
/// alone would permit an error of a tenth of a pixel. But deviations are rarely near the bound
/// and have both signs, so their root mean square stays below a tenth of it.
///
/// # Errors
/// If nothing was inserted.
pub(crate) fn against_equations(
    reconstructor: &Reconstructor,
    slices: &[Slice],
    mask: &Mask,
) -> Result<Deviation, Box<dyn Error>> {
    let nothing = "nothing was inserted";
    let kernels = reconstructor.kernels().ok_or(nothing)?;
    let (_, promised) = reconstructor.decimation().ok_or(nothing)?;
    let settings = reconstructor.settings();
    let lattice = reconstructor.world_from_lattice();
    let pairs = against_sums(reconstructor.volume(), settings, lattice, promised, |reference| {
        slices.iter().for_each(|slice| reference.insert(slice, mask, kernels));
    });
    Ok(Deviation::over(pairs, [0.1, 10.0].map(|part| part * promised * 255.0)))
}

/// Returns the values of a volume on cubes spread evenly over its blocks, with those that `insert`
/// inserts into a reference there. Weights may deviate by the relative error `promised`.
pub(crate) fn against_sums(
    volume: &dyn Voxels,
    settings: &Settings,
    world_from_lattice: Transform<World, Volume>,
    promised: f64,
    insert: impl Fn(&mut Reference),
) -> impl Iterator<Item = (Option<f64>, Option<f64>)> {
    let mut pairs = Vec::new();
    // Blocks come in the order of the sweep. A regular stride may select only blocks at its
    // sides, where no weight is firm; so these are excluded.
    let middle = |place: BrickIndex| place.map(|b| i64::from(b) * EDGE as i64 + EDGE as i64 / 2);
    let inner: Vec<BrickIndex> =
        volume.blocks().filter(|place| f64::from(volume.voxel(middle(*place)).1) > FIRM).collect();
    for place in inner.iter().step_by((inner.len() / CUBES).max(1)) {
        let first = place.map(|b| i64::from(b) * EDGE as i64 + (EDGE as i64 - CUBE) / 2);
        let grid = Grid {
            origin: world_from_lattice.point(DVec3::from_array(first.map(|x| x as f64))),
            spacing: settings.spacing_mm,
            direction: settings.lattice_direction,
            size: [CUBE as u64; 3],
        };
        let mut reference = Reference::new(grid);
        insert(&mut reference);
        for (i, expected) in reference.w.iter().enumerate() {
            let at = i as i64;
            let (x, y, z) = (at % CUBE, at / CUBE % CUBE, at / (CUBE * CUBE));
            let (r, w) = volume.voxel([first[0] + x, first[1] + y, first[2] + z]);
            let value = (w > SEEN).then(|| f64::from(r) / f64::from(w));
            // At the border of the data, rounding decides whether a slice counts. If the sums
            // come from different slices, values are not compared.
            let alike = (f64::from(w) - expected).abs() <= SAME_WEIGHT.max(promised) * expected;
            // Voxels are compared if either weight is firm.
            if f64::from(w).max(*expected) > FIRM {
                pairs.push((value, reference.value(i).filter(|_| alike)));
            }
        }
    }
    pairs.into_iter()
}

/// Returns whether both have the same bricks with the same bits.
pub(crate) fn same_bits(a: &Reconstructor, b: &Reconstructor) -> bool {
    let bits = |x: &[f32; VOXELS], y: &[f32; VOXELS]| x.iter().zip(y).all(|(x, y)| x.to_bits() == y.to_bits());
    a.volume().len() == b.volume().len()
        && a.volume()
            .iter()
            .zip(b.volume().iter())
            .all(|((p, x), (q, y))| p == q && bits(&x.r, &y.r) && bits(&x.w, &y.w))
}
