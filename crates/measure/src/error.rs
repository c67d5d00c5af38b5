//! Errors of measurements.

/// Reasons why something cannot be measured.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MeasureError {
    /// Too many points.
    #[error("{count} points are too many; give {most} at most")]
    TooMany {
        /// Given points.
        count: usize,
        /// The limit.
        most: usize,
    },
    /// A figure with another number of points than it takes.
    #[error("the figure must have {takes}, not {count}")]
    Points {
        /// The points that it takes.
        takes: &'static str,
        /// Given points.
        count: usize,
    },
    /// Contours of a figure other than a stack, or points of a stack.
    #[error("a stack takes contours, and any other figure takes points; give these")]
    Kind,
    /// A point far from the world's origin, or without finite coordinates.
    #[error("a point is not within {most_mm} mm of the world's origin; give three finite numbers of mm")]
    Outside {
        /// The limit, mm.
        most_mm: f64,
    },
    /// A width of a pixel or depth that is negative or too large.
    #[error("{what} must be 0 to {most_mm} mm")]
    Width {
        /// Its name.
        what: &'static str,
        /// The limit, mm.
        most_mm: f64,
    },
    /// A depth without a direction.
    #[error("a point with a depth_mm has no direction; give along")]
    Direction,
    /// Points that span no figure.
    #[error("points are at one place, or all on one line; move them apart")]
    Degenerate,
    /// A stack with fewer than two contours.
    #[error("a stack takes two contours or more; draw another")]
    FewContours,
    /// A contour that spans no area.
    #[error("a contour takes three points or more that are not on one line; draw it again")]
    Contour,
    /// Contours at an angle to each other.
    #[error("the contours are not parallel to {degrees:.0}°; draw all of them on parallel planes")]
    NotParallel {
        /// The limit, degrees.
        degrees: f64,
    },
    /// Contours at one height.
    #[error("two contours are at one height; draw each on a plane of its own")]
    SameHeight,
    /// The kernel's extent across slices is unknown.
    #[error("the reach of slices is unknown, as the calibration has no pixel size; calibrate the probe")]
    UnknownReach,
}
