//! Errors of an image plane's covariance.

/// Reasons why rows of numbers are not the covariance of an image plane.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CovarianceError {
    /// A name that is no number of the plane.
    #[error("\"{name}\" is no number of an image plane; {REMEDY}")]
    Unknown {
        /// The name.
        name: String,
    },
    /// A name that is listed twice.
    #[error("\"{name}\" is listed twice; {REMEDY}")]
    Repeated {
        /// The name.
        name: &'static str,
    },
    /// A rotation or a coordinate is not listed.
    #[error("\"{name}\" is not listed; {REMEDY}")]
    Missing {
        /// Its name.
        name: &'static str,
    },
    /// Another number of rows or columns.
    #[error("must hold {count} rows of {count} numbers, one a parameter; {REMEDY}")]
    Shape {
        /// Listed names.
        count: usize,
    },
    /// An entry is NaN or infinite.
    #[error("an entry is no finite number; {REMEDY}")]
    NotFinite,
    /// Two entries that must be equal differ.
    #[error("the entries of \"{row}\" with \"{column}\" differ from one another; {REMEDY}")]
    Asymmetric {
        /// Name of one.
        row: &'static str,
        /// Name of the other.
        column: &'static str,
    },
    /// A combination of the numbers has a negative variance.
    #[error("a combination of its numbers has a negative variance; {REMEDY}")]
    NotPositive,
    /// A standard deviation is so large that the plane is unknown.
    #[error("the standard deviation of \"{name}\" is {sd:.3}, more than {most}; {REMEDY}")]
    Large {
        /// Name of the number.
        name: &'static str,
        /// Its standard deviation, in its unit.
        sd: f64,
        /// The limit.
        most: f64,
    },
    /// The stated quality is not that of the covariance.
    #[error("says {stated_mm:.4} mm, but the covariance gives {found_mm:.4} mm; {REMEDY}")]
    Quality {
        /// Standard deviation by the quality.
        stated_mm: f64,
        /// Standard deviation by the covariance.
        found_mm: f64,
    },
}

/// Advice that all these errors have in common.
const REMEDY: &str = "calibrate anew, or delete this covariance: the calibration error is then unknown";
