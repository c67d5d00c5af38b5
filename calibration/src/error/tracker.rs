//! Errors of a tracker's measurement on site.

/// Reasons why there is no noise estimate, or no map of the field.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrackerError {
    /// There are too few poses.
    #[error("{poses} poses are too few to estimate noise; keep the sensor still until there are {least}")]
    FewPoses {
        /// Number of poses.
        poses: usize,
        /// Number required.
        least: usize,
    },
    /// The recording is too short.
    #[error(
        "the sensor lay still for {seconds:.1} s only, too short to exclude motion; leave it for {least_s} s or more"
    )]
    Short {
        /// Time from the first pose to the last, s.
        seconds: f64,
        /// Time required, s.
        least_s: f64,
    },
    /// The sensor was moved.
    #[error(
        "the sensor has moved by {farthest_mm:.2} mm and {degrees:.2}°, but its noise is {fast_mm:.3} mm; lay it down, \
        let go of it, and keep people and metal away"
    )]
    Moved {
        /// Largest distance of a pose from the mean, mm.
        farthest_mm: f64,
        /// Largest rotation from the mean, degrees.
        degrees: f64,
        /// Root mean square of the noise from one pose to the next, mm.
        fast_mm: f64,
    },
    /// Too few pairs.
    #[error("{pairs} moments with both sensors are too few for a map; move the piece on until there are {least}")]
    FewPairs {
        /// Number of pairs.
        pairs: usize,
        /// Number required.
        least: usize,
    },
    /// All pairs are in one place.
    #[error(
        "the piece has moved by {mm:.0} mm only, less than a cell of the map ({cell_mm:.0} mm); move it through the \
        whole scanning area"
    )]
    Still {
        /// Extent of the pairs, mm.
        mm: f64,
        /// Edge of a cell, mm.
        cell_mm: f64,
    },
    /// The piece is not rigid.
    #[error("the sensors are {nearest_mm:.0} to {farthest_mm:.0} mm apart; fix both to one rigid piece")]
    Loose {
        /// Tenth percentile of the distance, mm.
        nearest_mm: f64,
        /// Ninetieth percentile, mm.
        farthest_mm: f64,
    },
}
