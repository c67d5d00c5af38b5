//! Errors of drift and slip by crossing sweeps.

use super::Motion;

/// Reasons why sweeps that cross correct no drift, or do not tell whether the sensor slipped.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DriftError {
    /// Hardly any planes of different sweeps cross within the data.
    #[error(
        "{lines} pairs of slices of two sweeps cross within the image, but {least} are needed (directions of their \
        planes: {directions}); sweep the same place {}", .motion.words()
    )]
    FewLines {
        /// Pairs found.
        lines: usize,
        /// Pairs needed.
        least: usize,
        /// Number of directions.
        directions: usize,
        /// The motion that helps.
        motion: Motion,
    },
    /// No two sweeps cross.
    #[error(
        "no two sweeps cross each other (sweeps: {sweeps}), and one alone shows no drift; sweep the same place {}",
        .motion.words()
    )]
    FewSweeps {
        /// Sweeps found.
        sweeps: usize,
        /// The motion that helps.
        motion: Motion,
    },
    /// A sweep's slices do not agree with others.
    #[error(
        "slices of sweep {} agree with others by no motion of a few millimetres (correlation {correlation:.2}, {least} \
        is needed); check the calibration, and that nothing moves in the body",
        sweep + 1
    )]
    Unrelated {
        /// The sweep, from 0 on.
        sweep: usize,
        /// Median correlation along its lines.
        correlation: f64,
        /// Correlation needed.
        least: f64,
    },
    /// The slices agree no better than before.
    #[error(
        "crossing slices agree no better than before (correlation {after:.4}, before {before:.4}); use the poses as \
        they are"
    )]
    NoBetter {
        /// Median correlation before.
        before: f64,
        /// And after.
        after: f64,
    },
    /// The correction is too large.
    #[error(
        "sweeps that cross disagree by {by:.1} {unit}, but drift of at most {most:.0} is corrected, as if the body had \
        moved; sweep again while it rests"
    )]
    Large {
        /// The correction.
        by: f64,
        /// The largest one.
        most: f64,
        /// Their unit.
        unit: &'static str,
    },
    /// There is nothing to correct.
    #[error(
        "the sweeps agree without a correction, which would displace the image by {shift_mm:.2} mm, with a standard error of \
        {se_mm:.2} mm; use the poses as they are"
    )]
    Nothing {
        /// Displacement of the image, mm.
        shift_mm: f64,
        /// Its standard error, mm.
        se_mm: f64,
    },
    /// The calibration is off in all sweeps.
    #[error(
        "the calibration is off by {shift_mm:.2} mm in all sweeps, with a standard error of {se_mm:.2} mm; check it by \
        sweeps in three directions"
    )]
    Calibration {
        /// Displacement of the image, mm.
        shift_mm: f64,
        /// Its standard error, mm.
        se_mm: f64,
    },
    /// Standard errors are large.
    #[error(
        "the image's displacement between sweeps is uncertain by {mm:.2} mm, but at most {most_mm} mm are of use; \
        sweep the same place {}", .motion.words()
    )]
    Uncertain {
        /// Standard error of the displacement, mm.
        mm: f64,
        /// Largest useful one, mm.
        most_mm: f64,
        /// The motion that helps.
        motion: Motion,
    },
}
