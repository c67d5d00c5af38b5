//! Why readings do not say where a phantom is held.

use crate::least_squares::Unsolved;

/// Why readings do not say where a phantom is held.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LandmarksError {
    /// Fewer than fix a rigid body.
    #[error(
        "the phantom has {landmarks} landmarks; three that are on no line are needed at least, and six or more are good"
    )]
    TooFew {
        /// As many as it has.
        landmarks: usize,
    },
    /// All in a row.
    #[error("the phantom's landmarks are all on one line, about which it could be turned; name another beside it")]
    OnALine,
    /// Nothing to look at.
    #[error("{readings} usable readings of the stylus hold no rest; record the stylus while landmarks are touched")]
    NoReadings {
        /// As many as there are.
        readings: usize,
    },
    /// Rests that lie to each other in another way.
    #[error(
        "{matched} of {landmarks} landmarks are where the tip rested, and {wanted} are needed: it rested {rests} times for long enough, within {radius_mm:.1} mm. Touch each landmark \
         for two seconds; if that was done, the phantom's file is of another phantom, or the stylus's tip is of another stylus"
    )]
    NoMatch {
        /// Rests that were found.
        rests: usize,
        /// Landmarks that could be among them.
        matched: usize,
        /// Landmarks of the phantom.
        landmarks: usize,
        /// As many as are needed.
        wanted: usize,
        /// Within what a rest stays.
        radius_mm: f64,
    },
    /// A left-handed frame.
    #[error(
        "the mirror image of the phantom fits ({matched} of {landmarks} landmarks) and the phantom does not: an axis of its file, or of the tracker, has the wrong sign"
    )]
    Mirrored {
        /// Landmarks that the mirror image brings to rests.
        matched: usize,
        /// Landmarks of the phantom.
        landmarks: usize,
    },
    /// Factors between units.
    #[error("{what} fit once they are divided by {factor:.4}: {}", unit(*.factor))]
    Units {
        /// The tracker's or the phantom's.
        what: &'static str,
        /// By how much they are too large.
        factor: f64,
    },
    /// More than one way to lie there.
    #[error(
        "the landmarks that were touched fit the phantom in two ways that are equally good: touch more of them, or touch them in the file's order"
    )]
    Symmetric,
    /// Worse than is accepted.
    #[error(
        "landmarks are {rms_mm:.2} mm from where the tip rested (root mean square), more than the limit of {limit_mm} mm: is the stylus's tip its own, and does the phantom's file \
         fit it?"
    )]
    Limit {
        /// How far they are.
        rms_mm: f64,
        /// As much as is accepted.
        limit_mm: f64,
    },
    /// Too few of them, or too near to each other.
    #[error(
        "{touched} of {landmarks} landmarks say where the phantom is to {sd_mm:.2} mm only (one standard deviation at the landmark that is known worst), and {limit_mm} mm is the \
         limit: touch more of them, and those that are far apart; if that was done, the stylus's tip is not where it is said to be"
    )]
    Uncertain {
        /// Landmarks that were touched.
        touched: usize,
        /// Landmarks of the phantom.
        landmarks: usize,
        /// How sure the worst of them is.
        sd_mm: f64,
        /// As much as is accepted.
        limit_mm: f64,
    },
    /// The core's refusal, where none of the above is the reason.
    #[error(transparent)]
    Unsolved(#[from] Unsolved),
}

/// What a factor tells.
fn unit(factor: f64) -> &'static str {
    match factor {
        f if f > 20.0 => "they are in mm where inches are meant, or inches were converted twice",
        f if f > 1.0 => "they were converted from cm to mm twice",
        f if f > 0.05 => "they are in cm; mm are wanted",
        _ => "they are in inches; mm are wanted",
    }
}
