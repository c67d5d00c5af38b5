//! The kernel of one axis: the weight of a sample at distance x, and the support.
//!
//! Ohbuchi, Chen & Fuchs (1992) weight samples by a Gaussian that is cut off where it has
//! become small. Their three criteria of "small" are implemented here in closed form, with an
//! error if there is no root, besides a fourth that depends on no unit. The paper's relation σ
//! = h/√(ln 4) between resolution (half width at half maximum) and σ holds with the natural
//! logarithm.

use std::f64::consts::{PI, SQRT_2};

use serde::{Deserialize, Serialize};

/// Returns σ of the Gaussian whose half width at half maximum is `hwhm`.
pub fn sigma_from_hwhm(hwhm: f64) -> f64 {
    hwhm / (2.0 * std::f64::consts::LN_2).sqrt()
}

/// σ of a kernel of fourth order, as a multiple of that of a Gaussian that lets as much noise
/// through. At an equal σ the variance along each axis is 27/16 of the Gaussian's (Wand & Schucany
/// 1990); with this, noise in the plane grows by 5 %.
const EQUAL_NOISE: f64 = 1.6;
/// Support of such a kernel, as a multiple of a Gaussian's that is as wide: its lobes reach
/// farther.
const LOBES: f64 = 1.35;

/// Criterion that ends the kernel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Support {
    /// The energy outside is this fraction of the whole: E = erfc(d / (√2 σ)).
    Energy(f64),
    /// The normalised Gaussian has fallen to this value, in 1/mm. Not linear in σ.
    Amplitude(f64),
    /// The normalised Gaussian's slope has fallen to this value, in 1/mm². Not linear in σ, and
    /// without solution for wide kernels.
    Gradient(f64),
    /// The Gaussian has fallen to this fraction of its peak.
    Peak(f64),
}

/// Reason why a kernel cannot be created.
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
    /// Returns the half width d of the support for a Gaussian of `sigma_mm`, mm.
    ///
    /// # Errors
    /// [`KernelError`] when σ or the criterion is out of range or the criterion has no
    /// solution.
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
                // x e^{−x²/2} = g σ² √2π with x = d/σ; the outer root, beyond the steepest
                // point x = 1.
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

/// Returns the root above `low` of a function that falls from there on and is not negative at
/// `low`.
fn falling_root(f: impl Fn(f64) -> f64, low: f64) -> f64 {
    let (mut low, mut high) = (low, low + 1.0);
    while f(high) > 0.0 {
        high *= 2.0;
    }
    // To the last bit: each step halves the interval until no number lies inside it.
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return middle;
        }
        if f(middle) > 0.0 { low = middle } else { high = middle }
    }
}

/// Returns x with erfc(x) = e. It uses erfc and not erf, which cancels for small e.
fn inverse_erfc(e: f64) -> f64 {
    falling_root(|x| libm::erfc(x) - e, 0.0)
}

/// Kernel in the plane and across it: the contribution of one slice to points beside its
/// pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Gaussian minus its value at the end of the support, so that it ends without a step. For
    /// rendering from slopes over less than half a σ, and for slices more than 3 σ apart.
    Gaussian,
    /// Gaussian, cut across the plane (the paper's for 3 degrees of freedom): at 1 % energy it
    /// ends with a step of 3.6 % of its peak. For its support it is closest to a full Gaussian.
    /// In the plane it is lowered like [`Method::Gaussian`], and ends beyond 3 σ.
    #[default]
    GaussianTruncated,
    /// In the plane a kernel of fourth order along u and v, (1 − z²/3)·exp(−z²/2), of 1.6 σ: it
    /// takes no curvature away, and lets as much noise through as a Gaussian of σ. It has negative
    /// lobes, so that a hard edge overshoots. Across the plane like [`Method::GaussianTruncated`].
    Gaussian4,
    /// Cubic B-spline of the same σ, along all axes: twice differentiable up to its end at 3.46
    /// σ.
    BSpline3,
    /// Bilinear between pixels, and [`Method::Gaussian`] across the plane (the paper's for 6
    /// degrees of freedom).
    Linear,
    /// The nearest pixel, with constant weight up to √3 σ across the plane.
    Nearest,
}

impl Method {
    /// All methods.
    pub const ALL: [Self; 6] =
        [Self::Gaussian, Self::GaussianTruncated, Self::Gaussian4, Self::BSpline3, Self::Linear, Self::Nearest];

    /// The name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Gaussian => "gaussian",
            Self::GaussianTruncated => "gaussian-truncated",
            Self::Gaussian4 => "gaussian4",
            Self::BSpline3 => "bspline3",
            Self::Linear => "linear",
            Self::Nearest => "nearest",
        }
    }

    /// Whether the in-plane kernel follows the pixels, regardless of σ.
    pub fn interpolates(self) -> bool {
        matches!(self, Self::Linear | Self::Nearest)
    }

    /// Whether a [`Support`] ends the kernel; the others have a fixed end.
    pub fn takes_support(self) -> bool {
        matches!(self, Self::Gaussian | Self::GaussianTruncated | Self::Gaussian4 | Self::Linear)
    }

    /// Returns the kernel along u or v for pixels `pixel_mm` apart.
    ///
    /// # Errors
    /// Those of [`AxisKernel::new`].
    pub fn in_plane(self, sigma_mm: f64, support: Support, pixel_mm: f64) -> Result<AxisKernel, KernelError> {
        match self {
            Self::Linear => AxisKernel::of_shape(Shape::Tent, pixel_mm / Shape::Tent.half_width(), support),
            Self::Nearest => AxisKernel::of_shape(Shape::Box, 0.5 * pixel_mm / Shape::Box.half_width(), support),
            // A spline cannot follow a step.
            Self::GaussianTruncated => AxisKernel::new(Self::Gaussian, sigma_mm, support),
            Self::Gaussian4 => {
                let kernel = AxisKernel::of_shape(Shape::Gaussian4, EQUAL_NOISE * sigma_mm, support)?;
                Ok(AxisKernel { pedestal: kernel.shape.at(kernel.support_mm / kernel.sigma_mm), ..kernel })
            }
            Self::Gaussian | Self::BSpline3 => AxisKernel::new(self, sigma_mm, support),
        }
    }
}

/// Shape of a kernel within its support.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// exp(−x²/2σ²), minus a pedestal.
    Gaussian,
    /// (1 − z²/3)·exp(−z²/2), minus a pedestal.
    Gaussian4,
    /// B₃ with knots √3 σ apart.
    CubicBSpline,
    /// Falls linearly to 0 at √6 σ.
    Tent,
    /// 1 up to √3 σ.
    Box,
}

impl Shape {
    /// Half width of the support in σ; infinite for the Gaussians, which a [`Support`] ends. For
    /// all shapes σ is the standard deviation, except for [`Shape::Gaussian4`], which has none.
    fn half_width(self) -> f64 {
        match self {
            Self::Gaussian | Self::Gaussian4 => f64::INFINITY,
            Self::CubicBSpline => 2.0 * 3.0_f64.sqrt(),
            Self::Tent => 6.0_f64.sqrt(),
            Self::Box => 3.0_f64.sqrt(),
        }
    }

    /// Value at `z` ≥ 0 σ from the middle, 1 in the middle. The caller applies the end of the
    /// support.
    fn at(self, z: f64) -> f64 {
        match self {
            Self::Gaussian => (-0.5 * z * z).exp(),
            Self::Gaussian4 => (1.0 - z * z / 3.0) * (-0.5 * z * z).exp(),
            Self::CubicBSpline => 1.5 * cubic_b_spline(z / 3.0_f64.sqrt()),
            Self::Tent => (1.0 - z / self.half_width()).max(0.0),
            Self::Box => 1.0,
        }
    }
}

/// B₃(x): cubic B-spline on unit knots, support [−2, 2].
pub(crate) fn cubic_b_spline(x: f64) -> f64 {
    let x = x.abs();
    if x < 1.0 {
        2.0 / 3.0 - x * x + 0.5 * x * x * x
    } else if x < 2.0 {
        (2.0 - x).powi(3) / 6.0
    } else {
        0.0
    }
}

/// The kernel along one image axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisKernel {
    /// Its shape.
    pub shape: Shape,
    /// Nominal σ, mm.
    pub sigma_mm: f64,
    /// Half width of the support, mm.
    pub support_mm: f64,
    /// Subtracted from the shape, whose peak is 1.
    pub pedestal: f64,
}

impl AxisKernel {
    /// Creates a method's kernel across the plane, and in it unless the method follows the
    /// pixels ([`Method::in_plane`]). `support` ends a Gaussian; other shapes have a fixed end.
    ///
    /// # Errors
    /// [`KernelError`] as [`Support::half_width_mm`].
    pub fn new(method: Method, sigma_mm: f64, support: Support) -> Result<Self, KernelError> {
        let kernel = match method {
            Method::BSpline3 => Self::of_shape(Shape::CubicBSpline, sigma_mm, support)?,
            Method::Nearest => Self::of_shape(Shape::Box, sigma_mm, support)?,
            Method::Gaussian | Method::GaussianTruncated | Method::Gaussian4 | Method::Linear => {
                Self::of_shape(Shape::Gaussian, sigma_mm, support)?
            }
        };
        let pedestal = match method {
            Method::Gaussian | Method::Linear => kernel.shape.at(kernel.support_mm / sigma_mm),
            _ => 0.0,
        };
        Ok(Self { pedestal, ..kernel })
    }

    fn of_shape(shape: Shape, sigma_mm: f64, support: Support) -> Result<Self, KernelError> {
        let support_mm = match shape {
            Shape::Gaussian => support.half_width_mm(sigma_mm)?,
            Shape::Gaussian4 => LOBES * support.half_width_mm(sigma_mm)?,
            _ if sigma_mm > 0.0 && sigma_mm.is_finite() => sigma_mm * shape.half_width(),
            _ => return Err(KernelError::Sigma(sigma_mm)),
        };
        Ok(Self { shape, sigma_mm, support_mm, pedestal: 0.0 })
    }

    /// Weight of a sample at distance `x_mm`; [`Self::peak`] at 0, 0 beyond the support.
    pub fn weight(&self, x_mm: f64) -> f64 {
        let x = x_mm.abs();
        if x <= self.support_mm { self.shape.at(x / self.sigma_mm) - self.pedestal } else { 0.0 }
    }

    /// Weight at distance 0.
    pub fn peak(&self) -> f64 {
        1.0 - self.pedestal
    }

    /// Half width at half maximum of the shape, in σ.
    pub fn hwhm(&self) -> f64 {
        match self.shape {
            Shape::Gaussian => (2.0 * std::f64::consts::LN_2).sqrt(),
            Shape::Gaussian4 => falling_root(|z| Shape::Gaussian4.at(z) - 0.5, 0.0),
            Shape::CubicBSpline => 3.0_f64.sqrt() * falling_root(|x| cubic_b_spline(x) - 1.0 / 3.0, 0.0),
            Shape::Tent => 0.5 * self.shape.half_width(),
            Shape::Box => self.shape.half_width(),
        }
    }

    /// Standard deviation of the actual kernel, mm. For a Gaussian cut at z = d/σ and lowered
    /// by its pedestal, with φ the normal density: σ² times (erf(z/√2) − 2zφ(z) − ⅔z³p) /
    /// (erf(z/√2) − 2zp), p = φ(z) with pedestal and 0 without. That of [`Shape::Gaussian4`] is
    /// what its end leaves of 0: the moment is ⅔z³(φ(z) − p), the mass ⅔(erf(z/√2) + zφ(z)) − 2zp.
    pub fn sigma_effective_mm(&self) -> f64 {
        match self.shape {
            Shape::Gaussian | Shape::Gaussian4 => {}
            // The width of a box may differ from that of its σ.
            Shape::Box => return self.support_mm / self.shape.half_width(),
            Shape::CubicBSpline | Shape::Tent => return self.sigma_mm,
        }
        let z = self.support_mm / self.sigma_mm;
        let density = 1.0 / (2.0 * PI).sqrt();
        let end = density * (-0.5 * z * z).exp();
        let lowered = density * self.pedestal;
        let (mass, cube) = (libm::erf(z / SQRT_2), 2.0 / 3.0 * z.powi(3));
        let [second_moment, mass] = match self.shape {
            Shape::Gaussian4 => [cube * (end - lowered), 2.0 / 3.0 * (mass + z * end)],
            _ => [mass - 2.0 * z * end - cube * lowered, mass],
        };
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
    fn criteria_match_tabulated_roots() {
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
    fn only_energy_criterion_is_linear_in_sigma() {
        for sigma in [1e-6, 1.0, 1e6] {
            let d = Support::Energy(1e-12).half_width_mm(sigma).unwrap();
            assert!((d / sigma - 7.130_506_3).abs() < 1e-5, "{}", d / sigma);
        }
    }

    #[test]
    fn invalid_values_refused_by_name() {
        assert!(matches!(Support::Energy(0.01).half_width_mm(0.0), Err(KernelError::Sigma(_))));
        assert!(matches!(Support::Energy(0.01).half_width_mm(f64::NAN), Err(KernelError::Sigma(_))));
        for bad in [0.0, 1.0, -0.5, f64::NAN] {
            assert!(matches!(Support::Energy(bad).half_width_mm(1.0), Err(KernelError::Criterion(_))), "{bad}");
        }
        let error = Support::Amplitude(0.5).half_width_mm(1.0).unwrap_err();
        assert!(error.to_string().contains("amplitude of 0.5"), "{error}");
    }

    #[test]
    fn effective_widths_match_table_and_brute_force() {
        let expected = [
            (Method::GaussianTruncated, 0.9617),
            (Method::Gaussian, 0.9056),
            (Method::Gaussian4, 0.9617),
            (Method::Linear, 0.9056),
            (Method::BSpline3, 1.0),
            (Method::Nearest, 1.0),
        ];
        for (method, expected) in expected {
            let kernel = AxisKernel::new(method, 1.0, Support::Energy(0.01)).unwrap();
            assert!((kernel.sigma_effective_mm() - expected).abs() < 6e-5, "{method:?}");
            let (mut mass, mut moment) = (0.0, 0.0);
            for i in -350_000..=350_000 {
                let x = f64::from(i) * 1e-5;
                mass += kernel.weight(x);
                moment += kernel.weight(x) * x * x;
            }
            assert!(((moment / mass).sqrt() - kernel.sigma_effective_mm()).abs() < 1e-5);
        }
    }

    #[test]
    fn fourth_order_has_no_variance_and_overshoots_an_edge() {
        let sigma = 0.5;
        let kernel = Method::Gaussian4.in_plane(sigma, Support::Energy(1e-3), 0.1).unwrap();
        assert!((kernel.sigma_mm - 1.6 * sigma).abs() < 1e-12 && kernel.weight(kernel.support_mm).abs() < 1e-15);
        let (step, mut moments, mut squares, mut edge, mut most) = (1e-4, [0.0; 3], 0.0, 0.0, 0.0_f64);
        for i in -100_000..=100_000 {
            let x = f64::from(i) * step;
            let weight = kernel.weight(x) * step;
            (0..3).for_each(|order| moments[order] += weight * x.powi(2 * order as i32));
            squares += weight * weight / step;
            edge += weight;
            most = most.max(edge);
        }
        let [mass, second, fourth] = moments;
        let variance = second / mass / kernel.sigma_mm.powi(2);
        assert!((variance.sqrt() * kernel.sigma_mm - kernel.sigma_effective_mm()).abs() < 1e-3, "{variance}");
        assert!(variance < 0.02, "{variance}");
        // The moment of the whole kernel is −3σ⁴.
        assert!((fourth / mass / kernel.sigma_mm.powi(4) + 3.0).abs() < 0.3, "{}", fourth / mass);
        assert!((most / mass - 1.0355).abs() < 2e-3, "{}", most / mass);
        // Noise through both axes, against a Gaussian of σ.
        let noise = squares / (mass * mass) * 2.0 * PI.sqrt() * sigma;
        assert!((noise - 1.054).abs() < 5e-3, "{noise}");
    }

    #[test]
    fn pedestal_removes_step_at_one_percent_energy() {
        let cut = AxisKernel::new(Method::GaussianTruncated, 1.0, Support::Energy(0.01)).unwrap();
        assert!((cut.weight(cut.support_mm) - 0.0362).abs() < 1e-4);
        let lowered = AxisKernel::new(Method::Gaussian, 1.0, Support::Energy(0.01)).unwrap();
        assert!(lowered.weight(lowered.support_mm).abs() < 1e-15);
        assert_eq!(lowered.weight(lowered.support_mm * 1.0001), 0.0);
    }

    #[test]
    fn shapes_have_stated_half_maximum_and_end() {
        for method in Method::ALL {
            for kernel in [
                AxisKernel::new(method, 0.8, Support::Energy(0.01)).unwrap(),
                method.in_plane(0.8, Support::Energy(0.01), 0.3).unwrap(),
            ] {
                // Half maximum of the shape; the pedestal is subtracted afterwards.
                let half = kernel.weight(kernel.hwhm() * kernel.sigma_mm * (1.0 - 1e-12)) + kernel.pedestal;
                let expected = if kernel.shape == Shape::Box { 1.0 } else { 0.5 };
                assert!((half - expected).abs() < 1e-9, "{method:?}: {half}");
                assert!((kernel.weight(0.0) - kernel.peak()).abs() < 1e-15);
                assert_eq!(kernel.weight(kernel.support_mm * 1.0001), 0.0);
            }
        }
    }

    #[test]
    fn interpolating_methods_follow_the_pixels() {
        for sigma in [0.1, 5.0] {
            let tent = Method::Linear.in_plane(sigma, Support::Energy(0.01), 0.3).unwrap();
            assert!((tent.weight(0.1) - 2.0 / 3.0).abs() < 1e-12 && (tent.support_mm - 0.3).abs() < 1e-12);
            let cell = Method::Nearest.in_plane(sigma, Support::Energy(0.01), 0.3).unwrap();
            assert!((cell.support_mm - 0.15).abs() < 1e-12);
        }
    }
}
