//! Reasons why a phantom cannot be registered.

use crate::least_squares::Unsolved;

/// Reasons why a phantom cannot be registered.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LandmarksError {
    /// There are too few landmarks to fix a rigid body.
    #[error(
        "the phantom has {landmarks} landmarks; three that are on no line are needed at least, and six or more are good"
    )]
    TooFew {
        /// Number of landmarks.
        landmarks: usize,
    },
    /// All landmarks are on one line.
    #[error("the phantom's landmarks are all on one line, about which it could be turned; name another beside it")]
    OnALine,
    /// There are no usable readings.
    #[error("{readings} usable readings of the stylus hold no rest; record the stylus while landmarks are touched")]
    NoReadings {
        /// Number of usable readings.
        readings: usize,
    },
    /// The distances of the rests match no landmarks.
    #[error(
        "{matched} of {landmarks} landmarks are where the tip rested, and {wanted} are needed: it rested {rests} times for long enough, within {radius_mm:.1} mm. Touch each landmark \
         for two seconds; if that was done, the phantom's file is of another phantom, or the stylus's tip is of another stylus"
    )]
    NoMatch {
        /// Number of rests found.
        rests: usize,
        /// Number of landmarks matched.
        matched: usize,
        /// Landmarks of the phantom.
        landmarks: usize,
        /// Number of landmarks required.
        wanted: usize,
        /// Radius within which a rest stays, mm.
        radius_mm: f64,
    },
    /// A frame is left-handed.
    #[error(
        "the mirror image of the phantom fits ({matched} of {landmarks} landmarks) and the phantom does not: an axis of its file, or of the tracker, has the wrong sign"
    )]
    Mirrored {
        /// Landmarks that the mirror image matches.
        matched: usize,
        /// Landmarks of the phantom.
        landmarks: usize,
    },
    /// A factor between units fits.
    #[error("{what} fit once they are divided by {factor:.4}: {}", unit(*.factor))]
    Units {
        /// The quantity: the tracker's positions or the phantom's landmarks.
        what: &'static str,
        /// Factor by which it is too large.
        factor: f64,
    },
    /// Two poses fit equally well.
    #[error(
        "the landmarks that were touched fit the phantom in two ways that are equally good: touch more of them, or touch them in the file's order"
    )]
    Symmetric,
    /// The residuals exceed the limit.
    #[error(
        "landmarks are {rms_mm:.2} mm from where the tip rested (root mean square), more than the limit of {limit_mm} mm: is the stylus's tip its own, and does the phantom's file \
         fit it?"
    )]
    Limit {
        /// The residuals, root mean square, mm.
        rms_mm: f64,
        /// The limit, mm.
        limit_mm: f64,
    },
    /// The touched landmarks are too few, or too near to each other.
    #[error(
        "{touched} of {landmarks} landmarks say where the phantom is to {sd_mm:.2} mm only (one standard deviation at the landmark that is known worst), and {limit_mm} mm is the \
         limit: touch more of them, and those that are far apart; if that was done, the stylus's tip is not where it is said to be"
    )]
    Uncertain {
        /// Touched landmarks.
        touched: usize,
        /// Landmarks of the phantom.
        landmarks: usize,
        /// Standard deviation of the worst landmark, mm.
        sd_mm: f64,
        /// The limit, mm.
        limit_mm: f64,
    },
    /// The solver's error, if none of the above is the reason.
    #[error(transparent)]
    Unsolved(#[from] Unsolved),
}

/// Explains a factor.
fn unit(factor: f64) -> &'static str {
    match factor {
        f if f > 20.0 => "they are in mm where inches are meant, or inches were converted twice",
        f if f > 1.0 => "they were converted from cm to mm twice",
        f if f > 0.05 => "they are in cm; mm are wanted",
        _ => "they are in inches; mm are wanted",
    }
}
