//! Errors of the check by crossing slices.

use serde::Serialize;

/// Two sweeps, from 0 on.
pub type Sides = [usize; 2];

/// A motion of the probe that determines what is not determined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Motion {
    /// Another sweep, turned by 90° about the probe's axis.
    Turn,
    /// Another sweep, tilted by 30°.
    Tilt,
    /// Faster sweeps.
    Faster,
}

impl Motion {
    /// Returns the motion as an instruction.
    pub fn words(self) -> &'static str {
        match self {
            Self::Turn => "once more, with the probe turned by 90° about its axis",
            Self::Tilt => "once more, with the probe tilted by 30°",
            Self::Faster => "faster, and with changes of speed",
        }
    }
}

/// Reasons why there is no check, or why its calibration is not used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CrossingsError {
    /// Hardly any planes cross within the data.
    #[error(
        "{lines} pairs of slices cross within the image, but {least} are needed (directions of their planes: \
        {directions}); sweep the same place three times, upright, turned by 90° about the probe's axis, and tilted by \
        30°"
    )]
    FewLines {
        /// Pairs found.
        lines: usize,
        /// Pairs needed.
        least: usize,
        /// Number of directions.
        directions: usize,
    },
    /// The slices agree with another scale of the image.
    #[error(
        "crossing slices agree with an image {factor:.2} times as large; set the scanner to the depth of the calibration, \
        or use that depth's calibration"
    )]
    Scale {
        /// The factor.
        factor: f64,
    },
    /// The slices do not agree.
    #[error(
        "crossing slices agree by no calibration near this one (correlation {correlation:.2}, {least} is needed); \
        check that the calibration is of this probe, and that nothing moves in the body"
    )]
    Unrelated {
        /// Median correlation along the lines.
        correlation: f64,
        /// Correlation needed.
        least: f64,
    },
    /// Too few directions.
    #[error("the sweeps have {count} directions, but {least} determine a calibration; sweep again: {}", .motion.words())]
    Directions {
        /// Directions found.
        count: usize,
        /// Directions needed.
        least: usize,
        /// The motion that helps.
        motion: Motion,
    },
    /// The body has moved.
    #[error(
        "slices of sweeps {} and {} differ {ratio:.1} times as much as others, as if the body had moved between them; \
        sweep again while it rests",
        sides[0] + 1, sides[1] + 1
    )]
    Moved {
        /// The sweeps, from 0 on.
        sides: Sides,
        /// Their differences by those of others.
        ratio: f64,
    },
    /// Standard errors are large.
    #[error("the image's position is uncertain by {mm:.2} mm, but at most {most_mm} mm are of use; sweep again: {}", .motion.words())]
    Uncertain {
        /// Largest standard error of a point of the image, mm.
        mm: f64,
        /// Largest useful one, mm.
        most_mm: f64,
        /// The motion that helps.
        motion: Motion,
    },
    /// The change is too large for this method.
    #[error(
        "the calibration is off by {by:.1} {unit}, but crossings correct {most:.0} at most; calibrate by a phantom"
    )]
    Large {
        /// The change.
        by: f64,
        /// The largest one.
        most: f64,
        /// Their unit.
        unit: &'static str,
    },
    /// The calibration holds.
    #[error(
        "the calibration holds: another one would displace the image by {shift_mm:.2} mm, with a standard error of \
        {se_mm:.2} mm; use it as it is"
    )]
    Holds {
        /// Displacement of the image, mm.
        shift_mm: f64,
        /// Its standard error, mm.
        se_mm: f64,
    },
    /// The slices agree no better than before.
    #[error(
        "crossing slices agree no better than before (correlation {after:.3}, before {before:.3}); use the calibration \
        as it is"
    )]
    NoBetter {
        /// Median correlation before.
        before: f64,
        /// And after.
        after: f64,
    },
}
