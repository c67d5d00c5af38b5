//! Errors of the correction of slices by their neighbours.

/// Reasons why slices are not corrected.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum JitterError {
    /// No noise of the poses is known.
    #[error(
        "the noise of a pose is {position_mm} mm and {rotation_deg}°, but slices move by more than 0 of each; measure \
        the tracker's noise with the probe at rest, and set both"
    )]
    Noise {
        /// Standard deviation of the position along an axis, mm.
        position_mm: f64,
        /// Standard deviation of the rotation about an axis, degrees.
        rotation_deg: f64,
    },
    /// Sweeps are short.
    #[error(
        "{slices} slices with a pose lie in sweeps of five or more, but {least} are needed; record a sweep without a \
        pause"
    )]
    FewSlices {
        /// Slices found.
        slices: usize,
        /// Slices needed.
        least: usize,
    },
    /// Slices lie apart, or at one place.
    #[error(
        "{percent:.0} % of the points have no neighbouring slices on both sides, but at most {most_percent:.0} % may \
        lack them; sweep evenly across the planes, with several slices in a millimetre"
    )]
    Unpredicted {
        /// Points without a prediction, %.
        percent: f64,
        /// The most that is allowed, %.
        most_percent: f64,
    },
    /// Images are uniform.
    #[error("{flat} of {slices} images are uniform, and show no displacement; record with the probe in contact")]
    Flat {
        /// Uniform images.
        flat: usize,
        /// Images.
        slices: usize,
    },
    /// Neighbours show different things.
    #[error(
        "neighbouring slices correlate by {correlation:.2}, but {least} is needed to compare them; sweep more slowly, \
        so that they lie closer together"
    )]
    Unrelated {
        /// Median correlation of successive slices.
        correlation: f64,
        /// Correlation needed.
        least: f64,
    },
    /// Displacements exceed the noise of the poses.
    #[error(
        "the images ask for displacements of {ratio:.1} times the variance of the poses' noise, but at most \
        {most_ratio} is likely; check that nothing moves in the body, and measure the tracker's noise again"
    )]
    Unlikely {
        /// Mean square of the displacements by the poses' noise.
        ratio: f64,
        /// The most that is likely.
        most_ratio: f64,
    },
    /// A slice is displaced too far.
    #[error(
        "the images ask for a displacement of {mm:.1} mm, but at most {most_mm} mm are noise of a pose; check the \
        recording for jumps of the tracker, and that nothing moves in the body"
    )]
    Large {
        /// Largest displacement of an image's corner, mm.
        mm: f64,
        /// The largest allowed, mm.
        most_mm: f64,
    },
    /// Slices agree hardly better than before.
    #[error(
        "slices differ from their neighbours by {percent:.0} % less after the correction, but {least_percent:.0} % are \
        needed to tell it from chance; use the poses as they are"
    )]
    NoBetter {
        /// Fall of the median difference at points outside of the fit, %.
        percent: f64,
        /// The least, %.
        least_percent: f64,
    },
}
