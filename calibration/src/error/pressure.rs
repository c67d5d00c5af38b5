//! Errors of the correction of pressure.

/// Reasons why pressure is not corrected.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PressureError {
    /// There is no such sweep.
    #[error("the scan has {}; give the number of the one with light contact", named(.sweeps_s))]
    NoSweep {
        /// First and last time of each sweep, s from the beginning of the scan.
        sweeps_s: Vec<[f64; 2]>,
    },
    /// The limit of distances is no length.
    #[error("a distance of {near_mm} mm is no limit for planes; set one above 0, such as 0.8 of the beam's deviation")]
    Limit {
        /// The limit that was given, mm.
        near_mm: f64,
    },
    /// The images are too shallow.
    #[error(
        "images have data of {windows} windows over depth, but {least} are needed; set the scanner to a greater depth"
    )]
    Shallow {
        /// Windows of the image.
        windows: usize,
        /// Windows needed.
        least: usize,
    },
    /// Frames repeat.
    #[error("{frames} frames of {all} repeat the one before; record each of the scanner's images once")]
    Repeats {
        /// Frames that repeat.
        frames: usize,
        /// All frames.
        all: usize,
    },
    /// Hardly any slice lies near a light one.
    #[error(
        "{near} slices of {all} lie along those of sweep {light}, at most {near_mm} mm from one, but {least} are needed; \
        sweep the same place in the same direction with light contact, slowly"
    )]
    Few {
        /// Slices near light ones.
        near: usize,
        /// Slices of the sweeps beside the light one.
        all: usize,
        /// The light sweep, from 1.
        light: usize,
        /// The limit, mm.
        near_mm: f64,
        /// Slices needed.
        least: usize,
    },
    /// Frames resemble the ones before, however far away these are.
    #[error(
        "frames {far_mm:.2} mm apart are as alike as those {near_mm:.2} mm apart (correlations {far:.2} and {near:.2}), as \
        if the scanner averaged frames; set its persistence to 0, and sweep again"
    )]
    Persistence {
        /// Median distance of the nearest third of neighbours, mm.
        near_mm: f64,
        /// Their median correlation.
        near: f64,
        /// Median distance of the furthest third, mm.
        far_mm: f64,
        /// Their median correlation.
        far: f64,
    },
    /// Slices do not resemble the light ones.
    #[error(
        "{:.0} % of windows do not resemble the light sweep (correlation below {alike}); check the calibration, and sweep \
        the same place again while the body rests",
        100.0 * share
    )]
    Unrelated {
        /// Share of the windows.
        share: f64,
        /// Correlation needed.
        alike: f64,
    },
    /// Tissue is displaced beyond the search.
    #[error(
        "tissue is displaced by {most_mm} mm or more in {:.0} % of slices, beyond the search; press less, and sweep again",
        100.0 * share
    )]
    Far {
        /// Share of the slices.
        share: f64,
        /// Furthest displacement that is found, mm.
        most_mm: f64,
    },
    /// Tissue would fold.
    #[error(
        "tissue changes its order over depth in {:.0} % of slices, which no pressure does; check the calibration and the \
        light sweep",
        100.0 * share
    )]
    Folds {
        /// Share of the slices.
        share: f64,
    },
    /// Deep tissue tells nothing.
    #[error(
        "the deepest third of the image resembles the light sweep in {slices} slices of {all} only, which does not tell \
        pressure from wrong poses; set the scanner to a smaller depth or a higher gain, and sweep again"
    )]
    Deep {
        /// Slices that do.
        slices: usize,
        /// Slices near light ones.
        all: usize,
    },
    /// Deep tissue moves, too.
    #[error(
        "the deepest third of the image is displaced by {mm:.2} mm, but pressure moves it by {most_mm} mm at most: the \
        poses are off; calibrate latency and probe, and use smoothed poses"
    )]
    Rigid {
        /// Its displacement, root mean square, mm.
        mm: f64,
        /// Largest displacement, mm.
        most_mm: f64,
    },
    /// The light sweep presses more than the others.
    #[error("sweep {light} presses {mm:.1} mm further than the others; give the number of the one with light contact")]
    Heavier {
        /// The light sweep, from 1.
        light: usize,
        /// Displacement of the skin, median, mm.
        mm: f64,
    },
    /// Knots of a compression.
    #[error("the {knots} knots of a compression do not rise in depth, before and after it; use those of a result")]
    Knots {
        /// Number of knots.
        knots: usize,
    },
}

/// Names sweeps by their numbers and times.
fn named(sweeps_s: &[[f64; 2]]) -> String {
    if sweeps_s.is_empty() {
        return "no sweep along a steady direction".into();
    }
    let sweep = |(at, [from_s, to_s]): (usize, &[f64; 2])| format!("{} ({from_s:.1} to {to_s:.1} s)", at + 1);
    let all: Vec<String> = sweeps_s.iter().enumerate().map(sweep).collect();
    format!("{} sweep{}: {}", all.len(), if all.len() == 1 { "" } else { "s" }, all.join(", "))
}
