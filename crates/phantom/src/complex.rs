//! Complex numbers for oscillating scenes: only IEEE 754 operations and this module's own
//! elementary functions.

use std::ops::{Add, Mul, Sub};

use super::elementary::{exp, sin_cos_of_any};

/// `re + i·im`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Complex {
    /// Real part.
    pub(super) re: f64,
    /// Imaginary part.
    pub(super) im: f64,
}

impl Complex {
    pub(super) fn new(re: f64, im: f64) -> Self {
        Self { re, im }
    }

    pub(super) fn recip(self) -> Self {
        let squared = self.re * self.re + self.im * self.im;
        Self { re: self.re / squared, im: -self.im / squared }
    }

    /// Returns the root with positive real part, of a number with positive real part.
    pub(super) fn sqrt(self) -> Self {
        let length = (self.re * self.re + self.im * self.im).sqrt();
        let re = (0.5 * (length + self.re)).sqrt();
        Self { re, im: 0.5 * self.im / re }
    }

    /// Returns e to this power.
    pub(super) fn exp(self) -> Self {
        let (sin, cos) = sin_cos_of_any(self.im);
        let length = exp(self.re);
        Self { re: length * cos, im: length * sin }
    }

    pub(super) fn scaled(self, factor: f64) -> Self {
        Self { re: factor * self.re, im: factor * self.im }
    }
}

impl Add for Complex {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { re: self.re + other.re, im: self.im + other.im }
    }
}

impl Sub for Complex {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self { re: self.re - other.re, im: self.im - other.im }
    }
}

impl Mul for Complex {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self { re: self.re * other.re - self.im * other.im, im: self.re * other.im + self.im * other.re }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: Complex, b: Complex) -> bool {
        (a.re - b.re).abs() < 1e-14 && (a.im - b.im).abs() < 1e-14
    }

    #[test]
    fn roots_reciprocals_and_powers_are_consistent() {
        for (re, im) in [(1.0, 0.0), (0.3, -2.0), (2.0, 7.0), (1e-3, 0.5)] {
            let z = Complex::new(re, im);
            assert!(close(z * z.recip(), Complex::new(1.0, 0.0)));
            assert!(close(z.sqrt() * z.sqrt(), z) && z.sqrt().re > 0.0);
            assert!(close((z - z).exp(), Complex::new(1.0, 0.0)));
        }
        // e^{iπ} = −1.
        assert!(close(Complex::new(0.0, std::f64::consts::PI).exp(), Complex::new(-1.0, 0.0)));
        assert!(close(Complex::new(0.5, 1.0).exp() * Complex::new(0.5, 1.0).exp(), Complex::new(1.0, 2.0).exp()));
    }
}
