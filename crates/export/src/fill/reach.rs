//! Extent of a radius along each axis of a lattice.

use glam::DVec3;

use crate::error::ExportError;

/// Largest radius in voxels along any axis. Wider holes are not between slices, and their edges
/// do not predict their middle.
pub const FARTHEST: usize = 32;
/// The squared radius as a whole number. Unreachable distances are [`NEVER`], and sums of three
/// squares stay below 2³¹.
pub(super) const ONE: i32 = 1 << 28;
/// The squared distance if there is no seen voxel.
pub(super) const NEVER: i32 = 1 << 29;

/// A radius on a lattice.
pub(super) struct Reach {
    /// Voxels along x, y, z that lie within the radius.
    pub(super) steps: [usize; 3],
    /// Squared distance in parts of [`ONE`], by axis and number of voxels, up to `steps`.
    pub(super) squares: [Vec<i32>; 3],
}

/// A voxel within the radius, and its weight.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tap {
    /// Steps along x, y, z.
    pub(super) step: [i32; 3],
    /// 1 at distance 0.
    pub(super) weight: f32,
}

impl Reach {
    pub(super) fn new(radius_mm: f64, spacing: [f64; 3]) -> Result<Self, ExportError> {
        let nearest_mm = finest(spacing);
        // The comparison also rejects NaN.
        if !(radius_mm.is_finite() && radius_mm >= nearest_mm) {
            return Err(ExportError::RadiusTooSmall { radius_mm, nearest_mm });
        }
        if radius_mm > (FARTHEST as f64 + 0.5) * nearest_mm {
            return Err(ExportError::RadiusTooLarge { radius_mm, nearest_mm, most: FARTHEST });
        }
        let squares = spacing.map(|mm| {
            let square = |steps: usize| {
                let part = steps as f64 * mm / radius_mm;
                (part * part * f64::from(ONE)).round()
            };
            (0..=FARTHEST).map(square).take_while(|s| *s <= f64::from(ONE)).map(|s| s as i32).collect::<Vec<_>>()
        });
        Ok(Self { steps: squares.each_ref().map(|s| s.len() - 1), squares })
    }

    /// Returns all voxels within the radius, x fastest.
    pub(super) fn taps(&self) -> Vec<Tap> {
        let along = |axis: usize| -(self.steps[axis] as i32)..=self.steps[axis] as i32;
        let square = |axis: usize, step: i32| self.squares[axis][step.unsigned_abs() as usize];
        let mut taps = Vec::new();
        for z in along(2) {
            for y in along(1) {
                for x in along(0) {
                    let sum = square(0, x) + square(1, y) + square(2, z);
                    if sum <= ONE {
                        let weight = libm::exp(-2.0 * f64::from(sum) / f64::from(ONE)) as f32;
                        taps.push(Tap { step: [x, y, z], weight });
                    }
                }
            }
        }
        taps
    }
}

/// Returns the smallest of three lengths.
pub(super) fn finest(spacing: [f64; 3]) -> f64 {
    DVec3::from_array(spacing).min_element()
}
