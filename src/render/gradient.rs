//! How the intensity rises along an axis, also where coverage ends.

use super::real::Number;

/// Gradients below this count as none, in grey levels per mm.
///
/// An evenly grey region comes out of a reconstruction with the rounding of sums in single precision: where ten slices overlap up to 4·2⁻²³ of 255 grey
/// levels, from voxel to voxel both ways, over a pitch of a quarter mm. Its direction is nobody's surface.
pub const FLAT_PER_MM: f64 = 2e-3;

/// The gradient along one axis in grey levels per mm, from a voxel and its neighbours one pitch before and behind it.
///
/// Voxels are (intensity, weight); weight 0 means unseen, and the intensity then counts for nothing, whatever it holds. With the weights w∓ of the
/// neighbours the differences to both sides are averaged:
///
/// [w₊ (i₊ − i₀) + w₋ (i₀ − i₋)] / (w₊ + w₋) / pitch.
///
/// That is the central difference where the weights agree and the one-sided one at the end of coverage, so that the end of coverage is no
/// surface. Where both neighbours or the voxel itself are unseen, it is 0.
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
    fn a_ramp_has_its_slope_whatever_the_weights_and_at_either_end_of_coverage() {
        let value = |x: f64| 64.0 + 3.0 * x;
        let h = 0.7;
        for (minus, plus) in [(1.0, 1.0), (0.2, 5.0), (0.0, 2.0), (2.0, 0.0)] {
            // Unseen voxels hold 0: taken as a value it would make a wall of −46 grey levels per mm.
            let at = |x: f64, w: f64| (if w > 0.0 { value(x) } else { 0.0 }, w);
            let got = gradient(at(0.0, 0.4), [at(-h, minus), at(h, plus)], h);
            assert!((got - 3.0).abs() < 1e-13, "weights {minus} and {plus}: {got}");
        }
    }

    #[test]
    fn weights_say_which_side_is_believed() {
        // 6 before and 2 behind, 1 : 3.
        assert!((gradient((0.0, 1.0), [(-6.0, 1.0), (2.0, 3.0)], 1.0) - 3.0_f64).abs() < 1e-15);
    }

    #[test]
    fn nothing_seen_is_flat_and_what_is_unseen_may_hold_anything() {
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
