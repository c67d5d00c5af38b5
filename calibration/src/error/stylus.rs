//! Errors of a stylus's tip, and of landmarks that it touched.

use glam::DVec3;

use crate::least_squares::Unsolved;

/// Reasons why poses do not determine the tip.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PivotError {
    /// There are too few poses.
    #[error("{poses} usable poses of the stylus are too few; record at least {least}, better some hundreds")]
    TooFew {
        /// Number of usable poses.
        poses: usize,
        /// Number required.
        least: usize,
    },
    /// A pose is no rotation.
    #[error("pose {index} (from 0) is not rigid: {problem}")]
    NotRigid {
        /// Its index.
        index: usize,
        /// The problem.
        problem: String,
    },
    /// All poses are equal.
    #[error(
        "all {poses} poses are equal: the stylus was not moved, or the tracker delivers one pose again and again; turn \
        the stylus while its tip rests"
    )]
    OnePose {
        /// Number of poses.
        poses: usize,
    },
    /// The stylus was hardly turned about any axis.
    #[error(
        "the stylus was hardly turned ({deg:.1}° root mean square, but {least:.0}° are needed); keep the tip in its \
        place, and tilt the stylus by 30° or more to all sides"
    )]
    HardlyTurned {
        /// Rotation about the most turned axis, degrees.
        deg: f64,
        /// Rotation required, degrees.
        least: f64,
    },
    /// The stylus was turned about one axis that itself did not turn.
    #[error(
        "the stylus was turned about one axis only, ({}) in its sensor's frame; the axis itself turned by {deg:.1}° \
        (root mean square), but {least:.0}° are needed; tilt the stylus along another axis, too",
        [axis.x, axis.y, axis.z].map(|x| format!("{x:.2}")).join(", ")
    )]
    OneAxis {
        /// The axis.
        axis: DVec3,
        /// Rotation of its direction, degrees.
        deg: f64,
        /// Rotation required, degrees.
        least: f64,
    },
    /// Most poses do not agree on one place.
    #[error(
        "{outliers} of {poses} poses contradict the others{}: the tip slipped, or the tracker jumped; keep the tip in \
        a divot, and metal away",
        within(.runs)
    )]
    Unsteady {
        /// Number of poses that disagree.
        outliers: usize,
        /// Number of all poses.
        poses: usize,
        /// Their longest runs: first and last index.
        runs: Vec<[usize; 2]>,
    },
    /// The tip's distance is implausible.
    #[error(
        "the tip is {mm:.1} mm from the sensor{}, but a stylus has {} to {} mm; check the tracker's units",
        meant(*.mm, *.plausible), plausible[0], plausible[1]
    )]
    Length {
        /// Distance of the tip from the sensor, mm.
        mm: f64,
        /// Plausible range, mm.
        plausible: [f64; 2],
    },
    /// The residuals exceed the limit.
    #[error(
        "the tip strays by {rms_mm:.2} mm (root mean square), more than the limit of {limit_mm} mm; keep the tip in \
        its place, metal away, and the stylus within the tracker's range"
    )]
    Stray {
        /// The residuals, root mean square, mm.
        rms_mm: f64,
        /// The limit, mm.
        limit_mm: f64,
    },
    /// The solver's error, if none of the above is the reason.
    #[error(transparent)]
    Unsolved(#[from] Unsolved),
}

fn within(runs: &[[usize; 2]]) -> String {
    let named: Vec<String> = runs.iter().map(|[first, last]| format!("{first} to {last}")).collect();
    if named.is_empty() { String::new() } else { format!(" (poses {})", named.join(", ")) }
}

/// Factors of commonly confused units, with their descriptions.
const MISTAKEN: [(f64, &str); 4] = [
    (10.0, "10 times too large"),
    (25.4, "25.4 times too large"),
    (0.1, "cm and not mm"),
    (1.0 / 25.4, "inches and not mm"),
];

/// Returns the plausible lengths in other units.
fn meant(mm: f64, plausible: [f64; 2]) -> String {
    let fits = |(factor, what): &(f64, &str)| {
        let right = mm / factor;
        (right >= plausible[0] && right <= plausible[1]).then(|| format!("{right:.1} mm if positions are {what}"))
    };
    let meant: Vec<String> = MISTAKEN.iter().filter_map(fits).collect();
    if meant.is_empty() { String::new() } else { format!(", or {}", meant.join(", ")) }
}

/// Reasons why a phantom cannot be registered.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LandmarksError {
    /// There are too few landmarks to fix a rigid body.
    #[error("the phantom has {landmarks} landmarks, which are too few; give at least three off one line, better six")]
    TooFew {
        /// Number of landmarks.
        landmarks: usize,
    },
    /// All landmarks are on one line.
    #[error("the phantom's landmarks are all on one line; add a landmark beside it")]
    OnALine,
    /// There are no usable readings.
    #[error("{readings} usable readings of the stylus contain no rest; record while the stylus touches landmarks")]
    NoReadings {
        /// Number of usable readings.
        readings: usize,
    },
    /// The distances of the rests match no landmarks.
    #[error(
        "{matched} of {landmarks} landmarks match the tip's {rests} rests within {radius_mm:.1} mm, but {least} are \
        needed; touch each landmark for two seconds, and check that phantom file and stylus tip are the right ones"
    )]
    NoMatch {
        /// Number of rests found.
        rests: usize,
        /// Number of landmarks matched.
        matched: usize,
        /// Landmarks of the phantom.
        landmarks: usize,
        /// Number of landmarks required.
        least: usize,
        /// Radius within which a rest stays, mm.
        radius_mm: f64,
    },
    /// A frame is left-handed.
    #[error(
        "only the mirror image of the phantom fits ({matched} of {landmarks} landmarks); correct the sign of one axis \
        of the phantom's file, or of the tracker"
    )]
    Mirrored {
        /// Landmarks that the mirror image matches.
        matched: usize,
        /// Landmarks of the phantom.
        landmarks: usize,
    },
    /// A factor between units fits.
    #[error("{what} fit if divided by {factor:.4}: {}; correct the numbers", unit(*.factor))]
    Units {
        /// The quantity: the tracker's positions or the phantom's landmarks.
        what: &'static str,
        /// Factor by which it is too large.
        factor: f64,
    },
    /// Two poses fit equally well.
    #[error(
        "the touched landmarks fit in two ways equally well; touch more of them, or touch them in the file's order"
    )]
    Symmetric,
    /// The residuals exceed the limit.
    #[error(
        "the landmarks are {rms_mm:.2} mm off the tip's rests (root mean square), more than the limit of {limit_mm} \
        mm; check that the stylus tip and the phantom's file are the right ones"
    )]
    Limit {
        /// The residuals, root mean square, mm.
        rms_mm: f64,
        /// The limit, mm.
        limit_mm: f64,
    },
    /// The touched landmarks are too few, or too near to each other.
    #[error(
        "{touched} of {landmarks} landmarks determine the phantom's pose to {sd_mm:.2} mm only (one standard deviation \
        at the worst landmark), and the limit is {limit_mm} mm; touch more landmarks that are far apart, and check the \
        position of the stylus's tip"
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
        f if f > 20.0 => "they are in mm instead of inches, or were converted twice from inches",
        f if f > 1.0 => "they were converted from cm to mm twice",
        f if f > 0.05 => "they are in cm instead of mm",
        _ => "they are in inches instead of mm",
    }
}
