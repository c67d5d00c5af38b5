//! The weight of a voxel at a distance from the slice's plane, sixteen voxels at a time.
#![allow(unsafe_code, reason = "runs on `Lanes`")]

use simd::{Lanes, POWER_OF_TWO};

use super::kernel::{AxisKernel, Shape};

/// The kernel across the plane, in units of σ.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Falloff {
    shape: Shape,
    /// Half width of the support.
    pub(crate) reach: f32,
    /// Subtracted from the shape.
    pedestal: f32,
}

impl Falloff {
    pub(crate) fn new(normal: &AxisKernel) -> Self {
        Self {
            shape: normal.shape,
            reach: (normal.support_mm / normal.sigma_mm) as f32,
            pedestal: normal.pedestal as f32,
        }
    }

    /// Returns the weight at `q` σ from the plane, |q| ≤ [`Self::reach`]; never negative.
    ///
    /// # Safety
    /// The instruction set of `L` must be available.
    #[inline(always)]
    pub(crate) unsafe fn at<L: Lanes>(&self, q: L) -> L {
        // SAFETY: as for this function.
        unsafe {
            let zero = L::splat(0.0);
            match self.shape {
                // The fourth order is in the plane only: its lobes would be negative weights.
                Shape::Gaussian | Shape::Gaussian4 => {
                    let exponent = q.mul(q).mul(L::splat(-0.5 * std::f32::consts::LOG2_E));
                    // Rounding of the pedestal can leave −1e−9 at the end of the support.
                    power_of_two(exponent).sub(L::splat(self.pedestal)).max(zero)
                }
                Shape::CubicBSpline => {
                    // ¼(2−x)³ − (1−x)³ with only positive brackets, x = |q|/√3: 3/2 of B₃.
                    let x = q.max(zero.sub(q)).mul(L::splat(1.0 / SQRT_3));
                    let outer = L::splat(2.0).sub(x).max(zero);
                    let inner = L::splat(1.0).sub(x).max(zero);
                    let cube = inner.mul(inner).mul(inner);
                    outer.mul(outer).mul(outer.mul(L::splat(0.25))).sub(cube).max(zero)
                }
                Shape::Tent => {
                    let x = q.max(zero.sub(q)).mul(L::splat(1.0 / SQRT_6));
                    L::splat(1.0).sub(x).max(zero)
                }
                Shape::Box => L::splat(1.0),
            }
        }
    }
}

const SQRT_3: f32 = 1.732_050_8;
const SQRT_6: f32 = 2.449_489_7;

/// Returns 2ˣ for x ≤ 0, at least 2⁻¹²⁵, as 2ⁿ·2ᶠ with [`POWER_OF_TWO`] for 2ᶠ, |f| ≤ ½; only
/// rounding errors remain.
///
/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
pub(crate) unsafe fn power_of_two<L: Lanes>(exponent: L) -> L {
    // SAFETY: as for this function.
    unsafe {
        let exponent = exponent.max(L::splat(-125.0));
        let n = exponent.round_ties_even();
        let f = exponent.sub(n);
        let mut sum = L::splat(POWER_OF_TWO[0]);
        for c in &POWER_OF_TWO[1..] {
            sum = sum.mul_add(f, L::splat(*c));
        }
        sum.mul_add(f, L::splat(1.0)).scale_by_power_of_two(n)
    }
}

#[cfg(test)]
mod tests {
    use super::super::kernel::{Method, Support};
    use super::*;
    use simd::portable::Portable;

    #[test]
    fn weights_match_kernel() {
        for method in Method::ALL {
            for kernel in [
                AxisKernel::new(method, 0.7, Support::Energy(1e-4)).unwrap(),
                Method::Linear.in_plane(0.7, Support::Energy(0.1), 0.5).unwrap(),
            ] {
                let falloff = Falloff::new(&kernel);
                for step in 0..=1000_u16 {
                    let q = falloff.reach * (f32::from(step) / 500.0 - 1.0);
                    let mut weights = [0.0; 16];
                    // SAFETY: portable lanes need no instruction set; the array holds sixteen.
                    unsafe { falloff.at(Portable::splat(q)).store(weights.as_mut_ptr()) };
                    let expected = kernel.weight(f64::from(q) * kernel.sigma_mm * (1.0 - 1e-7));
                    assert!((f64::from(weights[3]) - expected).abs() < 1e-6, "{method:?} at {q}: {weights:?}");
                }
            }
        }
    }
}
