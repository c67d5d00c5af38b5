//! The kernel of one axis: how much a sample at distance x counts, and where that ends.
//!
//! Ohbuchi, Chen & Fuchs (1992) weight samples by a Gaussian that is cut off where it has become small. Their three criteria of "small" are here
//! in closed form, with the roots that exist and an error where none does, besides a fourth that depends on no unit. The paper's
//! relation σ = h/√(ln 4) between resolution (half width at half maximum) and σ holds with the natural logarithm.

use std::f64::consts::{PI, SQRT_2};

/// σ of the Gaussian whose half width at half maximum is `hwhm`.
pub fn sigma_from_hwhm(hwhm: f64) -> f64 {
    hwhm / (2.0 * std::f64::consts::LN_2).sqrt()
}

/// Where the kernel ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Support {
    /// The energy outside is this fraction of the whole: E = erfc(d / (√2 σ)).
    Energy(f64),
    /// The normalised Gaussian has fallen to this value, in 1/mm. Not linear in σ.
    Amplitude(f64),
    /// The normalised Gaussian's slope has fallen to this value, in 1/mm². Not linear in σ, and without solution for wide kernels.
    Gradient(f64),
    /// The Gaussian has fallen to this fraction of its peak.
    Peak(f64),
}

/// Why a kernel cannot be made.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum KernelError {
    /// σ is zero, negative or no number.
    #[error("the kernel's σ must be a positive number of mm, not {0}")]
    Sigma(f64),
    /// The criterion's value is out of range.
    #[error("the kernel's support criterion must lie between 0 and 1, not {0}")]
    Criterion(f64),
    /// The criterion is met nowhere.
    #[error(
        "a kernel of σ {sigma_mm} mm never exceeds the {criterion} of {value}: choose a smaller value, or energy= or peak=, which every kernel meets"
    )]
    NoRoot {
        /// σ, mm.
        sigma_mm: f64,
        /// The criterion's name.
        criterion: &'static str,
        /// Its value.
        value: f64,
    },
}

impl Support {
    /// Half width d of the support in mm for a Gaussian of `sigma_mm`.
    ///
    /// # Errors
    /// [`KernelError`] when σ or the criterion is out of range or the criterion has no solution.
    pub fn half_width_mm(self, sigma_mm: f64) -> Result<f64, KernelError> {
        if !(sigma_mm > 0.0 && sigma_mm.is_finite()) {
            return Err(KernelError::Sigma(sigma_mm));
        }
        let (Self::Energy(value) | Self::Amplitude(value) | Self::Gradient(value) | Self::Peak(value)) = self;
        let bounded = matches!(self, Self::Energy(_) | Self::Peak(_));
        if !(value > 0.0 && value.is_finite() && (value < 1.0 || !bounded)) {
            return Err(KernelError::Criterion(value));
        }
        let no_root = |criterion| KernelError::NoRoot { sigma_mm, criterion, value };
        match self {
            Self::Energy(e) => Ok(sigma_mm * SQRT_2 * inverse_erfc(e)),
            Self::Peak(p) => Ok(sigma_mm * (-2.0 * p.ln()).sqrt()),
            Self::Amplitude(a) => {
                let fall = -(a * sigma_mm * (2.0 * PI).sqrt()).ln();
                if fall > 0.0 { Ok(sigma_mm * (2.0 * fall).sqrt()) } else { Err(no_root("amplitude")) }
            }
            Self::Gradient(g) => {
                // x e^{−x²/2} = g σ² √2π with x = d/σ; the outer root, beyond the steepest point x = 1.
                let height = (g * sigma_mm * sigma_mm * (2.0 * PI).sqrt()).ln();
                let excess = |x: f64| x.ln() - 0.5 * x * x - height;
                if excess(1.0) < 0.0 {
                    return Err(no_root("gradient"));
                }
                Ok(sigma_mm * falling_root(excess, 1.0))
            }
        }
    }
}

/// The root above `low` of a function that falls from there on and is not negative at `low`.
fn falling_root(f: impl Fn(f64) -> f64, low: f64) -> f64 {
    let (mut low, mut high) = (low, low + 1.0);
    while f(high) > 0.0 {
        high *= 2.0;
    }
    // To the last bit: each step halves the interval until it holds no further number.
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return middle;
        }
        if f(middle) > 0.0 { low = middle } else { high = middle }
    }
}

/// x with erfc(x) = e. Through erfc and not erf, which cancels for small e.
fn inverse_erfc(e: f64) -> f64 {
    falling_root(|x| libm::erfc(x) - e, 0.0)
}

/// Shape of the kernel within its support.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Gaussian less its value at the end of the support: no step there, at the cost of one subtraction.
    #[default]
    Gaussian,
    /// Gaussian, cut (the paper's): at 1 % energy it ends with a step of 3.6 % of its peak.
    GaussianTruncated,
}

impl Method {
    /// The name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Gaussian => "gaussian",
            Self::GaussianTruncated => "gaussian-truncated",
        }
    }
}

/// The kernel along one image axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisKernel {
    /// Nominal σ, mm.
    pub sigma_mm: f64,
    /// Half width of the support, mm.
    pub support_mm: f64,
    /// Subtracted from the Gaussian of peak 1.
    pub pedestal: f64,
}

impl AxisKernel {
    /// # Errors
    /// [`KernelError`] as [`Support::half_width_mm`].
    pub fn new(method: Method, sigma_mm: f64, support: Support) -> Result<Self, KernelError> {
        let support_mm = support.half_width_mm(sigma_mm)?;
        let z = support_mm / sigma_mm;
        let pedestal = match method {
            Method::Gaussian => (-0.5 * z * z).exp(),
            Method::GaussianTruncated => 0.0,
        };
        Ok(Self { sigma_mm, support_mm, pedestal })
    }

    /// Weight of a sample at distance `x_mm`; [`Self::peak`] at 0, 0 beyond the support.
    pub fn weight(&self, x_mm: f64) -> f64 {
        let z = x_mm / self.sigma_mm;
        if x_mm.abs() <= self.support_mm { (-0.5 * z * z).exp() - self.pedestal } else { 0.0 }
    }

    /// Weight at distance 0.
    pub fn peak(&self) -> f64 {
        1.0 - self.pedestal
    }

    /// Standard deviation of the kernel as it is, cut and lowered, in mm: with z = d/σ and φ the normal density, σ² times
    /// (erf(z/√2) − 2zφ(z) − ⅔z³p) / (erf(z/√2) − 2zp), p = φ(z) with pedestal and 0 without.
    pub fn sigma_effective_mm(&self) -> f64 {
        let z = self.support_mm / self.sigma_mm;
        let density = 1.0 / (2.0 * PI).sqrt();
        let end = density * (-0.5 * z * z).exp();
        let lowered = density * self.pedestal;
        let mass = libm::erf(z / SQRT_2);
        let second_moment = mass - 2.0 * z * end - 2.0 / 3.0 * z.powi(3) * lowered;
        self.sigma_mm * (second_moment / (mass - 2.0 * z * lowered)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hwhm_relation_uses_the_natural_logarithm() {
        assert!((sigma_from_hwhm(1.0) - 0.849_321_800_288_02).abs() < 1e-12);
        let sigma = sigma_from_hwhm(1.7);
        let kernel = AxisKernel::new(Method::GaussianTruncated, sigma, Support::Energy(0.01)).unwrap();
        assert!((kernel.weight(1.7) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn criteria_have_their_tabulated_roots() {
        // σ, d_a(.01), d_e(.01), d_g(.01)
        let table = [
            (0.5, 1.4798, 1.2879, Some(1.7808)),
            (1.0, 2.7152, 2.5758, Some(3.1045)),
            (2.0, 4.8933, 5.1517, Some(5.0859)),
            (4.0, 8.5789, 10.3033, Some(6.7974)),
            (5.0, 10.1902, 12.8791, None),
        ];
        for (sigma, amplitude, energy, gradient) in table {
            let close = |support: Support, d: f64| (support.half_width_mm(sigma).unwrap() - d).abs() < 6e-5;
            assert!(close(Support::Amplitude(0.01), amplitude), "amplitude at {sigma}");
            assert!(close(Support::Energy(0.01), energy), "energy at {sigma}");
            match gradient {
                Some(d) => assert!(close(Support::Gradient(0.01), d), "gradient at {sigma}"),
                None => assert!(matches!(
                    Support::Gradient(0.01).half_width_mm(sigma),
                    Err(KernelError::NoRoot { criterion: "gradient", .. })
                )),
            }
        }
        for (energy, z) in [(0.1, 1.644854), (0.01, 2.575829), (0.001, 3.290527), (1e-4, 3.890592)] {
            assert!((Support::Energy(energy).half_width_mm(1.0).unwrap() - z).abs() < 1e-6);
        }
        let peak = Support::Peak(0.0362).half_width_mm(2.0).unwrap();
        assert!(((-0.5 * (peak / 2.0).powi(2)).exp() - 0.0362).abs() < 1e-12);
    }

    #[test]
    fn the_energy_criterion_alone_is_linear_in_sigma_and_holds_at_extremes() {
        for sigma in [1e-6, 1.0, 1e6] {
            let d = Support::Energy(1e-12).half_width_mm(sigma).unwrap();
            assert!((d / sigma - 7.130_506_3).abs() < 1e-5, "{}", d / sigma);
        }
    }

    #[test]
    fn values_without_meaning_are_refused_by_name() {
        assert!(matches!(Support::Energy(0.01).half_width_mm(0.0), Err(KernelError::Sigma(_))));
        assert!(matches!(Support::Energy(0.01).half_width_mm(f64::NAN), Err(KernelError::Sigma(_))));
        for bad in [0.0, 1.0, -0.5, f64::NAN] {
            assert!(matches!(Support::Energy(bad).half_width_mm(1.0), Err(KernelError::Criterion(_))), "{bad}");
        }
        let error = Support::Amplitude(0.5).half_width_mm(1.0).unwrap_err();
        assert!(error.to_string().contains("amplitude of 0.5"), "{error}");
    }

    #[test]
    fn effective_widths_match_the_brief_and_brute_force() {
        for (method, expected) in [(Method::GaussianTruncated, 0.9617), (Method::Gaussian, 0.9056)] {
            let kernel = AxisKernel::new(method, 1.0, Support::Energy(0.01)).unwrap();
            assert!((kernel.sigma_effective_mm() - expected).abs() < 6e-5, "{method:?}");
            let (mut mass, mut moment) = (0.0, 0.0);
            for i in -300_000..=300_000 {
                let x = f64::from(i) * 1e-5;
                mass += kernel.weight(x);
                moment += kernel.weight(x) * x * x;
            }
            assert!(((moment / mass).sqrt() - kernel.sigma_effective_mm()).abs() < 1e-5);
        }
    }

    #[test]
    fn one_percent_energy_ends_in_the_step_that_the_pedestal_removes() {
        let cut = AxisKernel::new(Method::GaussianTruncated, 1.0, Support::Energy(0.01)).unwrap();
        assert!((cut.weight(cut.support_mm) - 0.0362).abs() < 1e-4);
        let lowered = AxisKernel::new(Method::Gaussian, 1.0, Support::Energy(0.01)).unwrap();
        assert!(lowered.weight(lowered.support_mm).abs() < 1e-15);
        assert_eq!(lowered.weight(lowered.support_mm * 1.0001), 0.0);
    }
}
