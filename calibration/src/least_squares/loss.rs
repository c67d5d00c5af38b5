//! Loss functions: the cost of a residual by its length in standard deviations.
//!
//! The constants give an estimate from Gaussian residuals of one component 95 % of the
//! efficiency of least squares (Huber, *Robust Statistics*, 1981; Holland & Welsch, Commun.
//! Stat. A 6, 1977). A residual of d components is judged by its length. Its constant is the
//! length exceeded as rarely as the constant is by one component (Wilson & Hilferty's cube root
//! of χ², Proc. Natl. Acad. Sci. 17, 1931).

/// A loss function.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Loss {
    /// Half the square of the residual.
    #[default]
    Quadratic,
    /// Linear beyond 1.345 standard deviations. Convex: a linear problem has one minimum,
    /// reached from any start.
    Huber,
    /// Logarithmic, with a constant of 2.385 standard deviations.
    Cauchy,
    /// Constant beyond 4.685 standard deviations: residuals farther away have no influence.
    /// Needs a good start.
    Tukey,
}

impl Loss {
    /// Returns its constant for one component, standard deviations.
    fn constant(self) -> f64 {
        match self {
            Self::Quadratic => f64::INFINITY,
            Self::Huber => 1.345,
            Self::Cauchy => 2.3849,
            Self::Tukey => 4.6851,
        }
    }

    /// Returns the loss for residuals of this many components.
    pub fn of(self, components: usize) -> RobustLoss {
        let reach = if self == Self::Quadratic { f64::INFINITY } else { as_rare(self.constant(), components) };
        RobustLoss { loss: self, reach }
    }
}

/// A loss for residuals of a fixed number of components.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RobustLoss {
    loss: Loss,
    reach: f64,
}

impl RobustLoss {
    /// Returns the cost ρ of a residual of this length.
    pub fn cost(&self, length: f64) -> f64 {
        let (r, k) = (length, self.reach);
        match self.loss {
            Loss::Quadratic => 0.5 * r * r,
            Loss::Huber if r <= k => 0.5 * r * r,
            Loss::Huber => k * (r - 0.5 * k),
            Loss::Cauchy => 0.5 * k * k * (r / k).powi(2).ln_1p(),
            Loss::Tukey if r <= k => k * k / 6.0 * (1.0 - (1.0 - (r / k).powi(2)).powi(3)),
            Loss::Tukey => k * k / 6.0,
        }
    }

    /// Returns the weight ρ′/r: 1 for a residual of length 0.
    pub fn weight(&self, length: f64) -> f64 {
        let (r, k) = (length, self.reach);
        match self.loss {
            Loss::Quadratic => 1.0,
            Loss::Huber => (k / r).min(1.0),
            Loss::Cauchy => 1.0 / (1.0 + (r / k).powi(2)),
            Loss::Tukey => biweight(r / k),
        }
    }

    /// Returns the second derivative ρ″ along the residual.
    pub fn curvature(&self, length: f64) -> f64 {
        let (r, k) = (length, self.reach);
        let u = (r / k).powi(2);
        match self.loss {
            Loss::Quadratic => 1.0,
            Loss::Huber if r <= k => 1.0,
            Loss::Huber => 0.0,
            Loss::Cauchy => (1.0 - u) / (1.0 + u).powi(2),
            Loss::Tukey if r <= k => (1.0 - u) * (1.0 - 5.0 * u),
            Loss::Tukey => 0.0,
        }
    }
}

/// Returns Tukey's weight of a residual in units of the distance beyond which it is 0.
pub fn biweight(residual: f64) -> f64 {
    (1.0 - residual * residual).max(0.0).powi(2)
}

/// Estimates the standard deviation of residuals' components from the blocks' (number of
/// components, length). Takes the median of each length over its median at a standard deviation
/// of 1. Up to half of the blocks may be outliers.
pub fn spread(lengths: &[(usize, f64)]) -> f64 {
    let mut units: Vec<f64> = lengths.iter().map(|(components, length)| length / median(*components)).collect();
    units.sort_by(f64::total_cmp);
    let n = units.len();
    match n {
        0 => 0.0,
        _ => 0.5 * (units[(n - 1) / 2] + units[n / 2]),
    }
}

/// Returns the median length of d independent numbers of standard deviation 1.
fn median(components: usize) -> f64 {
    match components {
        1 => 0.674_489_750_196_081_7,
        2 => 1.177_410_022_515_474_7,
        3 => 1.538_172_254_455_090_5,
        d => quantile(0.0, d),
    }
}

/// Returns the length of d components that is exceeded as rarely as `constant` is by one.
pub fn as_rare(constant: f64, components: usize) -> f64 {
    if components == 1 {
        return constant;
    }
    let spread = 2.0_f64 / 9.0;
    let normal = ((constant * constant).cbrt() - (1.0 - spread)) / spread.sqrt();
    quantile(normal, components)
}

/// Returns the length of d components at the quantile of a standard normal number.
fn quantile(normal: f64, components: usize) -> f64 {
    let d = components as f64;
    let spread = 2.0 / (9.0 * d);
    (d * (1.0 - spread + normal * spread.sqrt()).powi(3)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weight_and_curvature_are_derivatives_of_cost() {
        for loss in [Loss::Quadratic, Loss::Huber, Loss::Cauchy, Loss::Tukey] {
            for components in 1..=4 {
                let robust = loss.of(components);
                for i in 1..80 {
                    let (r, h) = (0.1 * f64::from(i) + 0.003, 1e-4);
                    let slope = (robust.cost(r + h) - robust.cost(r - h)) / (2.0 * h);
                    assert!((slope - robust.weight(r) * r).abs() < 1e-5, "{loss:?} {components} {r}");
                    if (r - robust.reach).abs() > 2.0 * h {
                        let bend = (robust.cost(r + h) - 2.0 * robust.cost(r) + robust.cost(r - h)) / (h * h);
                        assert!((bend - robust.curvature(r)).abs() < 1e-5, "{loss:?} {components} {r}");
                    }
                }
                assert_eq!((robust.cost(0.0), robust.weight(0.0)), (0.0, 1.0));
            }
        }
    }

    /// χ² of 3 at 0.8214 and of 2 at 0.8214 are 4.906 and 3.446.
    #[test]
    fn constants_are_equally_rare_for_more_components() {
        assert!((as_rare(1.345, 3).powi(2) - 4.906).abs() < 0.06, "{}", as_rare(1.345, 3).powi(2));
        assert!((as_rare(1.345, 2).powi(2) - 3.446).abs() < 0.06, "{}", as_rare(1.345, 2).powi(2));
        for components in 1..=3 {
            assert!((quantile(0.0, components) / median(components) - 1.0).abs() < 0.02);
        }
    }

    #[test]
    fn spread_ignores_outliers() {
        let mut lengths = vec![(3, 2.0 * median(3)); 60];
        lengths.extend(vec![(3, 1e6); 40]);
        assert!((spread(&lengths) - 2.0).abs() < 1e-12);
        assert_eq!(spread(&[]), 0.0);
    }
}
