//! Errors of a volume against the truth.

/// Errors of a volume against a reference, grey levels, over selected voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Errors {
    /// Voxels compared: selected, and with a value.
    pub voxels: u64,
    /// Selected voxels without a value; two results are comparable only if these agree.
    pub unseen: u64,
    /// Root of the mean squared error.
    pub rmse: f64,
    /// Largest absolute error.
    pub max: f64,
    /// Mean error, value minus reference.
    pub bias: f64,
}

impl Errors {
    /// Compares voxel by voxel, in the order of `reference` (x fastest).
    ///
    /// `value` returns a voxel's grey level, or `None` if it is unseen; `selected` says which
    /// voxels count. If no voxel is compared, the errors are NaN: an empty comparison must not
    /// look perfect.
    pub fn over(reference: &[f32], value: impl Fn(usize) -> Option<f32>, selected: impl Fn(usize) -> bool) -> Self {
        let (mut voxels, mut unseen) = (0_u64, 0_u64);
        let (mut sum, mut squares, mut max) = (0.0, 0.0, 0.0_f64);
        for (index, reference) in reference.iter().enumerate().filter(|(index, _)| selected(*index)) {
            let Some(value) = value(index) else {
                unseen += 1;
                continue;
            };
            let error = f64::from(value) - f64::from(*reference);
            voxels += 1;
            sum += error;
            squares += error * error;
            // `f64::max` would ignore a NaN.
            max = if error.is_nan() { f64::NAN } else { max.max(error.abs()) };
        }
        if voxels == 0 {
            return Self { voxels, unseen, rmse: f64::NAN, max: f64::NAN, bias: f64::NAN };
        }
        let n = voxels as f64;
        // A later value replaces a NaN in `max`, but the sums keep it.
        let max = if sum.is_nan() { f64::NAN } else { max };
        Self { voxels, unseen, rmse: (squares / n).sqrt(), max, bias: sum / n }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_match_known_numbers() {
        let truth = [10.0, 20.0, 30.0, 40.0, 50.0];
        let values = [Some(11.0), Some(17.0), None, Some(1000.0), Some(50.0)];
        let errors = Errors::over(&truth, |i| values[i], |i| i != 3);
        assert_eq!((errors.voxels, errors.unseen), (3, 1));
        assert!((errors.rmse - (10.0_f64 / 3.0).sqrt()).abs() < 1e-12);
        assert_eq!(errors.max, 3.0);
        assert!((errors.bias + 2.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn empty_comparison_and_nan_yield_nan() {
        let none = Errors::over(&[1.0], |_| None, |_| true);
        assert!(none.rmse.is_nan() && none.max.is_nan() && none.bias.is_nan() && none.unseen == 1);
        let values = [f32::NAN, 1.0];
        let poisoned = Errors::over(&[1.0, 1.0], |i| Some(values[i]), |_| true);
        assert!(poisoned.rmse.is_nan() && poisoned.max.is_nan());
    }
}
