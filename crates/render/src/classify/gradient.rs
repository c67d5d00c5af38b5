//! The intensity gradient along an axis, also at the end of coverage.

use crate::real::Number;

/// Gradients below this count as none, grey levels per mm.
///
/// An evenly grey area leaves the reconstruction with single-precision rounding errors. If ten
/// slices overlap, the error is up to 4·2⁻²³ of 255 grey levels, from voxel to voxel both ways,
/// over a pitch of a quarter mm. Its direction does not belong to any surface.
pub const FLAT_PER_MM: f64 = 2e-3;

/// Returns the gradient along one axis in grey levels per mm, from a voxel and its neighbours
/// one pitch before and behind it.
///
/// Voxels are (intensity, weight). Weight 0 means unseen, and the intensity is then ignored,
/// whatever it holds. The differences to both sides are averaged using the neighbours' weights
/// w∓:
///
/// [w₊ (i₊ − i₀) + w₋ (i₀ − i₋)] / (w₊ + w₋) / pitch.
///
/// For equal weights this is the central difference. At the end of coverage it is the one-sided
/// difference, so the end of coverage is no surface. If both neighbours or the voxel itself are
/// unseen, the gradient is 0.
#[inline(always)]
pub fn gradient<T: Number>(centre: (T, T), [minus, plus]: [(T, T); 2], pitch_mm: T::Scalar) -> T {
    let none = T::zero();
    let (before, behind) = (none.lt(minus.1), none.lt(plus.1));
    let (left, right) = (T::select(before, minus.1, none), T::select(behind, plus.1, none));
    let rise = T::select(behind, plus.1 * (plus.0 - centre.0), none);
    let approach = T::select(before, minus.1 * (centre.0 - minus.0), none);
    let weight = right + left;
    let known = T::both(none.lt(centre.1), none.lt(weight));
    T::select(known, (rise + approach) / (weight * T::splat(pitch_mm)), none)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_weights_give_the_central_difference() {
        for weight in [1e-3, 0.5, 7.0] {
            let got = gradient((10.0, 2.0), [(4.0, weight), (19.0, weight)], 0.5);
            assert!((got - 15.0_f64).abs() < 1e-13, "{weight}: {got}");
        }
    }

    #[test]
    fn ramp_slope_is_exact_for_any_weights() {
        let value = |x: f64| 64.0 + 3.0 * x;
        let h = 0.7;
        for (minus, plus) in [(1.0, 1.0), (0.2, 5.0), (0.0, 2.0), (2.0, 0.0)] {
            // Unseen voxels hold 0; using it as a value would give an edge of −46 grey levels
            // per mm.
            let at = |x: f64, w: f64| (if w > 0.0 { value(x) } else { 0.0 }, w);
            let got = gradient(at(0.0, 0.4), [at(-h, minus), at(h, plus)], h);
            assert!((got - 3.0).abs() < 1e-13, "weights {minus} and {plus}: {got}");
        }
    }

    #[test]
    fn neighbour_differences_are_averaged_by_weight() {
        // 6 before and 2 behind, 1 : 3.
        assert!((gradient((0.0, 1.0), [(-6.0, 1.0), (2.0, 3.0)], 1.0) - 3.0_f64).abs() < 1e-15);
    }

    #[test]
    fn unseen_neighbours_are_ignored() {
        let nan = (f32::NAN, 0.0);
        assert_eq!(gradient((5.0, 1.0), [nan, nan], 1.0_f32), 0.0);
        assert_eq!(gradient(nan, [(1.0, 1.0), (2.0, 1.0)], 1.0_f32), 0.0);
        assert_eq!(gradient((5.0, 1.0), [nan, (7.0, 2.0)], 0.5_f32), 4.0);
    }

    #[test]
    fn single_precision_stays_within_rounding() {
        let mut worst = 0.0_f64;
        for i in 0..1000_u16 {
            let f = |k: f32, m: f32| (f32::from(i) * k).rem_euclid(m);
            let voxels = [(f(3.7, 255.0), f(0.01, 3.0)), (f(17.3, 255.0), f(0.07, 9.0)), (f(5.9, 255.0), f(1.3, 2.0))];
            let [c, m, p] = voxels;
            let [cd, md, pd] = voxels.map(|(v, w)| (f64::from(v), f64::from(w)));
            let error = f64::from(gradient(c, [m, p], 0.5_f32)) - gradient(cd, [md, pd], 0.5);
            worst = worst.max(error.abs());
        }
        // Four roundings of differences of up to 255 grey levels over half a mm.
        assert!(worst < 2.0 * 255.0 * 4.0 * 6e-8, "{worst}");
    }
}
