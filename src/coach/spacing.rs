//! How far apart slices may lie so that nothing between them is left out, by the kernel that weaves them.
//!
//! A slice gives a voxel a weight that falls with the distance from its plane, and a voxel is seen where that weight exceeds [`SEEN`]. Of two parallel slices each reaches as far
//! as its kernel weighs more than that, `reach`: all between them is seen by one of them while they lie no more than 2·reach apart, and in the middle of a wider gap is a band of
//! the excess that neither sees, in which every voxel is unseen. That it is no smaller is seen by weaving two slices at that distance and at 1.2 times it.
//!
//! At the far end of its reach a slice hardly counts, and what lies there is the smear of a single slice. Where slices lie no farther apart than the kernel's full width at half
//! maximum, the middle between two has the whole weight of one: the volume is evenly dense, `even`. Beyond that it is without gaps, but thin.

use serde::Serialize;

use crate::reconstruct::kernel::{AxisKernel, KernelError};
use crate::reconstruct::settings::Settings;
use crate::volume::sparse::SEEN;

/// How far apart slices may lie, mm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spacing {
    /// Farther apart they leave a gap.
    pub gapless_mm: f64,
    /// Farther apart what lies between them is thin.
    pub even_mm: f64,
}

impl Spacing {
    /// Of what a volume is woven with, for pixels of a size, mm.
    ///
    /// # Errors
    /// [`KernelError`] as [`Settings::kernels`].
    pub fn of(settings: &Settings, pixel_mm: [f64; 2]) -> Result<Self, KernelError> {
        let [.., across] = settings.kernels(pixel_mm)?;
        let gapless_mm = 2.0 * reach(&across);
        Ok(Self { gapless_mm, even_mm: (2.0 * across.hwhm() * across.sigma_mm).min(gapless_mm) })
    }

    /// How far a slice sees to either side, mm.
    pub fn reach_mm(self) -> f64 {
        0.5 * self.gapless_mm
    }
}

/// How far a voxel may lie from a plane and be seen: to the support's end, or to where a kernel that ends without a step has faded.
fn reach(kernel: &AxisKernel) -> f64 {
    let is_seen = |x: f64| kernel.weight(x) > f64::from(SEEN);
    if is_seen(kernel.support_mm) {
        return kernel.support_mm;
    }
    let (mut near, mut far) = (0.0, kernel.support_mm);
    // To a millionth of the support; kernels fall from the middle on.
    for _ in 0..20 {
        let middle = 0.5 * (near + far);
        if is_seen(middle) { near = middle } else { far = middle }
    }
    near
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    use calibration::frames::Transform;
    use glam::{DAffine3, DMat3, DVec3};

    use crate::mask::Mask;
    use crate::reconstruct::kernel::{Method, Support};
    use crate::reconstruct::{Compounding, Reconstructor};
    use crate::slice::{Image, Pixels, Slice};

    const SIZE: [u32; 2] = [40, 40];
    const PIXEL: f64 = 0.5;

    fn slice(z: f64) -> Slice {
        let pixels: Arc<[u8]> = vec![100; (SIZE[0] * SIZE[1]) as usize].into();
        let pose = DAffine3::from_mat3_translation(
            DMat3::from_diagonal(DVec3::new(PIXEL, PIXEL, 1.0)),
            DVec3::new(0.0, 0.0, z),
        );
        Slice {
            image: Image::new(SIZE[0], SIZE[1], Pixels::U8(pixels)),
            time_ns: (z * 1e6) as i64,
            world_from_image: Transform::from_affine(pose),
        }
    }

    /// Unseen voxels between two slices, well within the picture.
    fn unseen_between(settings: &Settings, apart_mm: f64) -> usize {
        let mut woven = Reconstructor::new(settings.clone(), Mask::full(SIZE[0], SIZE[1])).unwrap();
        // Off the lattice's planes.
        let first = 0.013;
        woven.insert(&slice(first)).unwrap();
        woven.insert(&slice(first + apart_mm)).unwrap();
        let spacing = settings.spacing_mm.x;
        let (low, high) = ((first / spacing).ceil() as i64, ((first + apart_mm) / spacing).floor() as i64);
        let middle = (10.0 / spacing) as i64;
        (low..=high)
            .flat_map(|z| (middle..middle + 5).map(move |x| [x, middle, z]))
            .filter(|voxel| woven.volume().voxel(*voxel).1 <= SEEN)
            .count()
    }

    #[test]
    fn two_slices_at_the_largest_distance_leave_no_gap_and_a_fifth_farther_apart_they_do() {
        let fine = Settings::new(DVec3::splat(0.1));
        let wide = Settings { sigma_mm: [None, None, Some(1.7)], ..fine.clone() };
        let few = Settings { support: [None, Some(Support::Energy(0.1))], ..fine.clone() };
        let mut ways = vec![wide, few];
        for method in Method::ALL {
            ways.push(Settings { method, ..fine.clone() });
        }
        ways.push(Settings { compounding: Compounding::Maximum, ..fine });
        for settings in ways {
            let named = format!("{:?} {:?} {:?}", settings.method, settings.compounding, settings.sigma_mm);
            let spacing = Spacing::of(&settings, [PIXEL; 2]).unwrap();
            // A hundredth less, for a voxel's rounding at the very edge.
            assert_eq!(unseen_between(&settings, 0.99 * spacing.gapless_mm), 0, "{named}: {spacing:?}");
            assert!(unseen_between(&settings, 1.2 * spacing.gapless_mm) > 0, "{named}: {spacing:?}");
            assert!(spacing.even_mm <= spacing.gapless_mm && spacing.even_mm > 0.3, "{named}: {spacing:?}");
        }
    }

    #[test]
    fn the_usual_kernel_s_distances_are_its_closed_form() {
        let spacing = Spacing::of(&Settings::new(DVec3::splat(0.5)), [0.2; 2]).unwrap();
        // 2·2.5758 σ and 2·√(2 ln 2) σ, of σ = 1 mm.
        assert!((spacing.gapless_mm - 5.1517).abs() < 1e-3, "{spacing:?}");
        assert!((spacing.even_mm - 2.3548).abs() < 1e-3, "{spacing:?}");
        // In the middle of two that are so far apart, their weights add up to the whole of one.
        let kernel = AxisKernel::new(Method::GaussianTruncated, 1.0, Support::Energy(0.01)).unwrap();
        assert!((2.0 * kernel.weight(0.5 * spacing.even_mm) - 1.0).abs() < 1e-9);
    }
}
