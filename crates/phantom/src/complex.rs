//! Functions of complex numbers for oscillating scenes, from this crate's own elementary
//! functions. Those of num-complex have other bits on other machines.

pub(super) use num_complex::Complex64 as Complex;

use super::elementary;

/// Returns the root with positive real part, of a number with positive real part.
pub(super) fn sqrt(z: Complex) -> Complex {
    let re = (0.5 * (z.norm_sqr().sqrt() + z.re)).sqrt();
    Complex::new(re, 0.5 * z.im / re)
}

/// Returns e to this power.
pub(super) fn exp(z: Complex) -> Complex {
    let (sin, cos) = elementary::sin_cos_of_any(z.im);
    Complex::new(cos, sin).scale(elementary::exp(z.re))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: Complex, b: Complex) -> bool {
        (a.re - b.re).abs() < 1e-14 && (a.im - b.im).abs() < 1e-14
    }

    #[test]
    fn roots_and_powers_are_consistent() {
        for (re, im) in [(1.0, 0.0), (0.3, -2.0), (2.0, 7.0), (1e-3, 0.5)] {
            let z = Complex::new(re, im);
            assert!(close(sqrt(z) * sqrt(z), z) && sqrt(z).re > 0.0);
            assert!(close(exp(z - z), Complex::new(1.0, 0.0)));
        }
        // e^{iπ} = −1.
        assert!(close(exp(Complex::new(0.0, std::f64::consts::PI)), Complex::new(-1.0, 0.0)));
        assert!(close(exp(Complex::new(0.5, 1.0)) * exp(Complex::new(0.5, 1.0)), exp(Complex::new(1.0, 2.0))));
    }
}
