//! Largest distance of slices without a gap between them, by the reconstruction kernel.
//!
//! A slice gives a voxel a weight that falls with the distance from its plane; a voxel is seen
//! if that weight exceeds [`SEEN`]. A slice's `reach` is the distance at which its kernel falls
//! to that weight. Between two parallel slices everything is seen by one of them up to a
//! distance of 2·reach. In the middle of a wider gap lies a band, as wide as the excess, in
//! which every voxel is unseen. A test inserts two slices near that distance and at 1.2 times
//! it.
//!
//! At the far end of its reach a slice has little weight, and the content there is the blur of a
//! single slice. If slices are no farther apart than the kernel's full width at half maximum,
//! the middle between two has the whole weight of one. The volume is then evenly dense, `even`.
//! Beyond that it has no gaps, but is thin.

use serde::Serialize;

use reconstruct::kernel::{AxisKernel, KernelError};
use reconstruct::settings::Settings;
use volume::brick_volume::SEEN;

/// Allowed distances between slices, mm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spacing {
    /// Larger distances leave a gap.
    pub gapless_mm: f64,
    /// Larger distances give thin data between slices.
    pub even_mm: f64,
}

impl Spacing {
    /// Computes the spacing for reconstruction settings and pixels of a size, mm.
    ///
    /// # Errors
    /// [`KernelError`], in the same cases as [`Settings::kernels`].
    pub fn of(settings: &Settings, pixel_mm: [f64; 2]) -> Result<Self, KernelError> {
        let [.., across] = settings.kernels(pixel_mm)?;
        let gapless_mm = 2.0 * reach(&across);
        Ok(Self { gapless_mm, even_mm: (2.0 * across.hwhm() * across.sigma_mm).min(gapless_mm) })
    }

    /// Returns a slice's reach to either side, mm.
    pub fn reach_mm(self) -> f64 {
        0.5 * self.gapless_mm
    }
}

/// Returns the largest distance from a plane at which a voxel is seen: the end of the support,
/// or the point where a continuous kernel has faded.
fn reach(kernel: &AxisKernel) -> f64 {
    let is_seen = |x: f64| kernel.weight(x) > f64::from(SEEN);
    if is_seen(kernel.support_mm) {
        return kernel.support_mm;
    }
    let (mut near, mut far) = (0.0, kernel.support_mm);
    // To a millionth of the support; kernels fall monotonically from the middle.
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

    use glam::{DAffine3, DMat3, DVec3};
    use sonoweave_core::frames::Transform;

    use mask::Mask;
    use reconstruct::kernel::{Method, Support};
    use reconstruct::{Compounding, Reconstructor};
    use sonoweave_core::slice::{Image, Pixels, Slice};
    use volume::Voxels;

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

    /// Returns the number of unseen voxels between two slices, well within the image.
    fn unseen_between(settings: &Settings, apart_mm: f64) -> usize {
        let mut reconstructor = Reconstructor::new(settings.clone(), Mask::full(SIZE[0], SIZE[1])).unwrap();
        // Off the lattice's planes.
        let first = 0.013;
        reconstructor.insert(&slice(first)).unwrap();
        reconstructor.insert(&slice(first + apart_mm)).unwrap();
        let spacing = settings.spacing_mm.x;
        let (low, high) = ((first / spacing).ceil() as i64, ((first + apart_mm) / spacing).floor() as i64);
        let middle = (10.0 / spacing) as i64;
        (low..=high)
            .flat_map(|z| (middle..middle + 5).map(move |x| [x, middle, z]))
            .filter(|voxel| reconstructor.volume().voxel(*voxel).1 <= SEEN)
            .count()
    }

    #[test]
    fn slices_beyond_gapless_distance_leave_gap() {
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
            // One percent less, for a voxel's rounding at the very edge.
            assert_eq!(unseen_between(&settings, 0.99 * spacing.gapless_mm), 0, "{named}: {spacing:?}");
            assert!(unseen_between(&settings, 1.2 * spacing.gapless_mm) > 0, "{named}: {spacing:?}");
            assert!(spacing.even_mm <= spacing.gapless_mm && spacing.even_mm > 0.3, "{named}: {spacing:?}");
        }
    }

    #[test]
    fn default_kernel_spacing_matches_closed_form() {
        let spacing = Spacing::of(&Settings::new(DVec3::splat(0.5)), [0.2; 2]).unwrap();
        // 2·2.5758 σ and 2·√(2 ln 2) σ, for σ = 1 mm.
        assert!((spacing.gapless_mm - 5.1517).abs() < 1e-3, "{spacing:?}");
        assert!((spacing.even_mm - 2.3548).abs() < 1e-3, "{spacing:?}");
        // Halfway between two slices at that distance, their weights add up to the whole weight
        // of one.
        let kernel = AxisKernel::new(Method::GaussianTruncated, 1.0, Support::Energy(0.01)).unwrap();
        assert!((2.0 * kernel.weight(0.5 * spacing.even_mm) - 1.0).abs() < 1e-9);
    }
}
