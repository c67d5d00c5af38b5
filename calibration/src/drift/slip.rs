//! The sweep before which the sensor slipped on the probe.
//!
//! Each sweep has a motion of its own. A slip before a sweep is one motion of this sweep and of all
//! later ones, and a calibration that never held one of all sweeps. The one that explains
//! the sweeps' motions best is taken.

use nalgebra::{DMatrix, DVector};

use super::fitted::{Fitted, Gram};
use super::knots::{Knots, NUMBERS};
use crate::crossings::Checked;
use crate::error::DriftError;
use crate::slices::Slices;

/// Displacement of the image beyond which the sensor has slipped, mm, and in its standard errors.
const SLIPPED_MM: f64 = 0.3;
const SLIPPED_ERRORS: f64 = 3.0;
/// Largest standard error of a displacement by which a sensor holds, mm.
const MOST_ERROR_MM: f64 = 0.3;

/// A slip between two sweeps.
///
/// A body that moved between them, as a whole, looks the same. Its displacement is then only
/// roughly that stated: sweeps of other directions see it from other sides.
#[derive(Debug, Clone, PartialEq)]
pub struct Slip {
    /// The first sweep of another calibration, from 0 on, in the order of time.
    pub sweep: usize,
    /// Last time of the sweep before, and first time of this sweep, s.
    pub between_s: [f64; 2],
    /// Displacement of the image, root mean square of nine points, mm.
    pub shift_mm: f64,
    /// Its standard error, mm.
    pub shift_se_mm: f64,
    /// Number of compared lines.
    pub lines: usize,
    /// Medians of the correlations along the lines, before and after each sweep's motion.
    pub correlations: [f64; 2],
}

impl Slip {
    /// Whether the slices agree better by the slip than by one calibration of all sweeps. A wrong
    /// latency or scale displaces sweeps of different directions differently, and looks like a
    /// slip by itself.
    pub fn is_likelier_than(&self, checked: &Checked) -> bool {
        self.correlations[1] > checked.correlations[1]
    }
}

impl std::fmt::Display for Slip {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { sweep, shift_mm, shift_se_mm, .. } = self;
        write!(
            f,
            "the sensor slipped or the body moved before sweep {}: the image is displaced by {shift_mm:.2} mm, with a \
            standard error of {shift_se_mm:.2} mm",
            sweep + 1
        )
    }
}

/// A motion of a sweep and of all later ones.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    /// The sweep's place among those that cross.
    rank: usize,
    pub(super) shift_mm: f64,
    pub(super) shift_se_mm: f64,
    /// Decrease of the differences' squares by the motion, in units of their variance.
    explained: f64,
}

impl Slip {
    /// Returns the slip, if there is one.
    pub(super) fn of(slices: &Slices, fitted: &Fitted) -> Result<Option<Self>, DriftError> {
        let steps = Step::all(slices, fitted);
        let Some(step) = Step::best(&steps).filter(Step::is_sure) else {
            let errors = steps.iter().filter(|step| step.rank > 0).map(|step| step.shift_se_mm);
            let (mm, most_mm) = (errors.fold(0.0, f64::max), MOST_ERROR_MM);
            let uncertain = DriftError::Uncertain { mm, most_mm, motion: fitted.crossed.motion() };
            return if mm <= most_mm { Ok(None) } else { Err(uncertain) };
        };
        let Step { rank, shift_mm, shift_se_mm, .. } = step;
        if rank == 0 {
            return Err(DriftError::Calibration { shift_mm, se_mm: shift_se_mm });
        }
        let sweep = fitted.crossed.sweeps[rank];
        let sweeps_s = &fitted.crossed.directions.sweeps_s;
        Ok(Some(Self {
            sweep,
            between_s: [sweeps_s[sweep - 1][1], sweeps_s[sweep][0]],
            shift_mm,
            shift_se_mm,
            lines: fitted.crossed.pairs.len(),
            correlations: fitted.correlations,
        }))
    }
}

impl Step {
    /// Returns the motions of the sweeps from each one on.
    pub(super) fn all(slices: &Slices, fitted: &Fitted) -> Vec<Self> {
        let every = Knots::of(slices, &fitted.crossed, 1, 0);
        let information = fitted.information(&every);
        // The held sweep is where it was, for certain.
        let count = every.count * NUMBERS;
        let numbers = fitted.numbers.clone().insert_rows(0, NUMBERS, 0.0);
        let mut covariance = DMatrix::zeros(count, count);
        covariance.view_mut((NUMBERS, NUMBERS), fitted.covariance.shape()).copy_from(&fitted.covariance);
        let gram = fitted.gram();
        let step = |rank: usize| {
            let spread = DMatrix::from_fn(count, NUMBERS, |row, column| {
                f64::from(u8::from(row / NUMBERS >= rank && row % NUMBERS == column))
            });
            let weighted = spread.transpose() * &information;
            let a = &weighted * &spread;
            // The weighted mean of the sweeps' motions; none if the lines determine none.
            let mean = a.clone().cholesky()?.solve(&weighted);
            let motion: DVector<f64> = &mean * &numbers;
            let covariance = Gram::from_column_slice((&mean * &covariance * mean.transpose()).as_slice());
            Some(Self {
                rank,
                shift_mm: motion.dot(&(gram * &motion)).sqrt(),
                shift_se_mm: (gram * covariance).trace().sqrt(),
                explained: motion.dot(&(a * &motion)),
            })
        };
        (0..every.count).filter_map(step).collect()
    }

    /// Returns the motion that explains most.
    pub(super) fn best(steps: &[Self]) -> Option<Self> {
        steps.iter().copied().max_by(|a, b| a.explained.total_cmp(&b.explained))
    }

    /// Whether the motion is more than chance explains.
    fn is_sure(&self) -> bool {
        self.shift_mm > SLIPPED_MM && self.shift_mm > SLIPPED_ERRORS * self.shift_se_mm
    }
}
