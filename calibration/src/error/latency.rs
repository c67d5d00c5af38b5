//! Errors of the latency's calibration.

/// Reasons why there is no lag.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LatencyError {
    /// A pose or sample contains NaN or infinity.
    #[error("sample {index} contains NaN or infinity; remove it")]
    NotFinite {
        /// Its index among the samples.
        index: usize,
    },
    /// Too few frames show a floor.
    #[error(
        "{lines} of {frames} frames show the line of a floor, but {least} are needed ({nothing} frames without motion, \
        {scattered} with motion off a line); hold the probe above the floor of a water tank, and move it up and down"
    )]
    NoFloor {
        /// Number of frames.
        frames: usize,
        /// Number of frames with a line.
        lines: usize,
        /// Number of lines required.
        least: usize,
        /// Number of frames in which nothing moves.
        nothing: usize,
        /// Number of frames in which the moving pixels form no line.
        scattered: usize,
    },
    /// The stamps cannot be seconds.
    #[error("the frames' time stamps are {period_s:e} s apart, which is implausible; give them in seconds")]
    Seconds {
        /// Period of the frames, s.
        period_s: f64,
    },
    /// The line is static.
    #[error(
        "the floor's line moves by {extent_px:.1} px, but scatters by {scatter_px:.1} px; move the probe up and down \
        by a third of the image"
    )]
    PictureStill {
        /// Extent of its motion, px.
        extent_px: f64,
        /// Its scatter, px.
        scatter_px: f64,
    },
    /// There are no poses in the video's time.
    #[error(
        "none of {poses} poses is from the frames' time, {:.3} to {:.3} s; check that all time stamps are in seconds \
        and of one clock",
        frames_s[0], frames_s[1]
    )]
    NoPoses {
        /// Number of poses.
        poses: usize,
        /// First and last frame with a line, s.
        frames_s: [f64; 2],
    },
    /// The tracker is static.
    #[error(
        "the tracker moves by {extent_mm:.2} mm, but its noise is {noise_mm:.2} mm; check that the sensor is on this \
        probe, and move the probe"
    )]
    TrackerStill {
        /// Extent of its motion, mm.
        extent_mm: f64,
        /// Its noise, mm.
        noise_mm: f64,
    },
    /// The probe does not move up and down.
    #[error("the probe reverses {turns} times, but {least} are needed; move it up and down five times or more")]
    OneWay {
        /// Number of its turns.
        turns: usize,
        /// Number of turns required.
        least: usize,
    },
    /// The units differ.
    #[error(
        "the tracker's motion gives {mm_per_px:.4} mm a pixel, but {}; check that the tracker's positions are in \
        mm{hint}",
        match .pixel_mm {
            Some(mm) => format!("the calibration has {mm:.4} mm"),
            None => "0.01 to 2 mm are possible".to_owned(),
        }
    )]
    Units {
        /// Pixel size by the tracker, mm.
        mm_per_px: f64,
        /// Pixel size by the probe's calibration, mm.
        pixel_mm: Option<f64>,
        /// Suggested unit.
        hint: &'static str,
    },
    /// At no lag do enough frames lie between poses.
    #[error(
        "at most {most} of {all} frames lie between poses, but {least} are needed (frames from {:.3} to {:.3} s, poses \
        from {:.3} to {:.3} s); check that all time stamps are in seconds and of one clock",
        frames_s[0], frames_s[1], poses_s[0], poses_s[1]
    )]
    NoOverlap {
        /// Number of frames.
        all: usize,
        /// Number of frames between poses at the best lag.
        most: usize,
        /// Number of frames required.
        least: usize,
        /// First and last frame, s.
        frames_s: [f64; 2],
        /// First and last pose, s; NaN if there are none.
        poses_s: [f64; 2],
    },
    /// The values are constant.
    #[error("nothing moves in the frames; move the probe")]
    Constant,
    /// The values do not follow these motions.
    #[error(
        "at no lag do the poses explain the frames' motion: {:.0} % of it remains; check that both are of one session, \
        and that nothing else moves",
        100.0 * left
    )]
    Unrelated {
        /// Share of the values' deviation that remains.
        left: f64,
    },
    /// Two lags fit equally well.
    #[error(
        "lags of {:.1} ms and {:.1} ms fit equally well (residuals {:.3} and {:.3}), because the motion is too \
        regular; move unevenly, or narrow the range of lags",
        1e3 * lags_s[0], 1e3 * lags_s[1], residuals[0], residuals[1]
    )]
    Ambiguous {
        /// The lags, the better one first, s.
        lags_s: [f64; 2],
        /// Their residuals.
        residuals: [f64; 2],
    },
    /// The best lag is at an end of the range, or beyond.
    #[error("the lag of {:.1} ms is at the end of the range of ±{:.0} ms; widen the range", 1e3 * lag_s, 1e3 * range_s)]
    AtEdge {
        /// The lag, s.
        lag_s: f64,
        /// The range, s.
        range_s: f64,
    },
    /// The lag is too inaccurate to be useful.
    #[error("the lag of {:.1} ± {:.1} ms is too uncertain; move farther, faster and longer", 1e3 * lag_s, 1e3 * se_s)]
    Unsure {
        /// The lag, s.
        lag_s: f64,
        /// Its standard error, s.
        se_s: f64,
    },
    /// Hardly any planes cross within the data.
    #[error(
        "{crossings} pairs of {slices} slices cross within the image, but {least} are needed; sweep the same place \
        twice, in crossing directions"
    )]
    FewCrossings {
        /// Number of slices.
        slices: usize,
        /// Crossings found.
        crossings: usize,
        /// Crossings needed.
        least: usize,
    },
    /// The crossing slices were acquired at the same motion.
    #[error(
        "the probe moved by {mm:.2} mm within ±{:.0} ms between crossing slices, but {least_mm:.2} mm are needed; \
        sweep faster, or in other directions",
        1e3 * range_s
    )]
    TooSlow {
        /// Median displacement between crossing slices, mm.
        mm: f64,
        /// Smallest detectable displacement, mm.
        least_mm: f64,
        /// The range of lags, s.
        range_s: f64,
    },
    /// The slices agree at no lag.
    #[error(
        "crossing slices agree at no lag better than at others; check that the calibration is of this probe, and that \
        nothing moves in the body"
    )]
    SlicesUnrelated,
    /// The slices agree equally well at two lags.
    #[error(
        "crossing slices agree equally well at {:.1} ms and {:.1} ms; narrow the range of lags",
        1e3 * lags_s[0], 1e3 * lags_s[1]
    )]
    SlicesAmbiguous {
        /// The lags, the better one first, s.
        lags_s: [f64; 2],
    },
}
