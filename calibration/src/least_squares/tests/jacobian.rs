//! Checks derivatives against finite differences.

use crate::least_squares::{Blocks, Parameters, State};

/// Step in units of the typical sizes: near the cube root of rounding, where truncation and
/// rounding errors are equal.
const STEP: f64 = 1e-5;

/// The largest difference of analytic derivatives and central differences.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct JacobianCheck {
    /// The difference over the largest derivative of that block of residuals, both by a typical
    /// size of the parameter.
    pub(crate) largest: f64,
    /// Index of the block of residuals, from 0.
    pub(crate) block: usize,
    /// Name of the parameter's component.
    pub(crate) parameter: String,
    /// The given derivative, whitened, by the parameter's typical size.
    pub(crate) analytic: f64,
    /// The central difference.
    pub(crate) difference: f64,
}

/// Compares the derivatives from `evaluate` at a state with central differences of its
/// residuals. Correct ones agree to some 1e-8; for every problem's tests.
///
/// # Panics
/// Panics if `evaluate` adds a different number of residuals beside the state than at it.
pub(crate) fn check_jacobian<F>(parameters: &Parameters, state: &State, evaluate: F) -> JacobianCheck
where
    F: Fn(&State, &mut Blocks<'_>),
{
    let (columns, typical) = (parameters.columns(), parameters.typical());
    let given = Blocks::of(parameters, &columns, true, |blocks| evaluate(state, blocks));
    let at =
        |state: &State| Blocks::of(parameters, &columns, false, |blocks| evaluate(state, blocks)).residuals().to_vec();
    let names: Vec<&str> = parameters.components().map(|(name, _)| name).collect();
    let width = names.len();

    let mut found = vec![0.0; given.jacobian().len()];
    for (column, typical) in typical.iter().enumerate() {
        let beside = |sign: f64| {
            let mut step = vec![0.0; width];
            step[column] = sign * STEP * typical;
            at(&parameters.moved(state, &step))
        };
        let (after, before) = (beside(1.0), beside(-1.0));
        assert!(after.len() == given.residuals().len() && before.len() == after.len(), "residuals come and go");
        for (row, (after, before)) in after.iter().zip(&before).enumerate() {
            found[row * width + column] = (after - before) / (2.0 * STEP);
        }
    }
    let mut worst = JacobianCheck { largest: 0.0, block: 0, parameter: String::new(), analytic: 0.0, difference: 0.0 };
    for (block, range) in given.ranges().enumerate() {
        let entries = || range.clone().flat_map(|row| (0..width).map(move |column| (row * width + column, column)));
        let analytic = |(at, column): (usize, usize)| given.jacobian()[at] * typical[column];
        let size = entries().map(|entry| analytic(entry).abs().max(found[entry.0].abs())).fold(0.0, f64::max);
        for entry in entries() {
            let apart = (analytic(entry) - found[entry.0]).abs() / size.max(f64::MIN_POSITIVE);
            // NaN is worse than any number.
            if apart > worst.largest || apart.is_nan() {
                let parameter = names[entry.1].to_owned();
                worst = JacobianCheck {
                    largest: apart,
                    block,
                    parameter,
                    analytic: analytic(entry),
                    difference: found[entry.0],
                };
            }
        }
    }
    worst
}
