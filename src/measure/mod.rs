//! Lengths, angles, areas and volumes between places of the world, each with how far it may be off; and which slices a place was made of.
//!
//! A place that somebody points at is off by what the calibration is off, by where within a voxel and a pixel of the screen it was meant, and by how wide the kernel blurs
//! what is there; one that was pointed at in the view of the volume, too, by how deep along its ray it is seen, anywhere within a width dᵢ along the direction aᵢ. Of each
//! place these are taken as independent of the others': errors that neighbouring places share make lengths between them better than is said, never worse. An error is
//! carried on to first order, σ² = Σ |∂f/∂pᵢ|² σᵢ² + (∂f/∂pᵢ · aᵢ)² dᵢ² / 12, and told as twice that σ, within which about 95 of 100 lie.

mod figure;
mod place;
pub mod sources;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};

pub use figure::Figure;
pub use place::Place;
pub use sources::{Slices, Source};

/// Points of a figure.
const MOST_POINTS: usize = 2000;
/// Places are within this of the world's origin, mm.
const MOST_MM: f64 = 1e5;
/// Pixels and depths are no wider than this, mm.
const MOST_WIDE_MM: f64 = 100.0;
/// Standard deviations of the error that is told.
const SIGMAS: f64 = 2.0;

/// How far places may be off.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Doubt {
    /// Standard deviation of a place by the calibration, at the picture's worst corner, mm; `None` where nobody knows.
    pub calibration_mm: Option<f64>,
    /// The longest distance between neighbouring voxels, mm.
    pub voxel_mm: f64,
    /// Half width at half maximum of the kernel where it is widest, mm.
    pub hwhm_mm: f64,
}

impl Doubt {
    /// Standard deviations of a place along each axis, by the calibration and by sampling, where a pixel of the screen is so wide, mm. What may be anywhere within a width has
    /// its twelfth, squared, for variance.
    fn of_place(&self, pixel_mm: f64) -> [f64; 2] {
        let within = [self.voxel_mm, self.hwhm_mm, pixel_mm].map(|width| width * width / 12.0);
        // The calibration's is of a place in space, of which each axis has a third.
        [self.calibration_mm.unwrap_or(0.0) / 3.0_f64.sqrt(), within.iter().sum::<f64>().sqrt()]
    }
}

/// What is to be measured.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Asked {
    /// What kind of figure it is.
    pub kind: Kind,
    /// Its places: two of a distance, three of an angle with the vertex in the middle, three or more around an area; of an ellipsoid the ends of its three
    /// diameters. None of a stack.
    #[serde(default)]
    pub points: Vec<Place>,
    /// Areas one above the other, of a stack.
    #[serde(default)]
    pub contours: Vec<Vec<Place>>,
    /// Width of a pixel where those were pointed at that do not say it themselves, mm.
    #[serde(default)]
    pub pixel_mm: f64,
}

/// Kinds of figures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Between two points, mm.
    Distance,
    /// At the middle one of three points, degrees.
    Angle,
    /// Within a line through points that ends where it begins, mm².
    Area,
    /// Of a body with three diameters at right angles, π/6·a·b·c, mm³.
    Ellipsoid,
    /// Of a body cut into slabs, the sum of area times thickness, mm³.
    Stack,
}

/// What was measured.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Measured {
    /// What kind of figure it is.
    pub kind: Kind,
    /// How large it is.
    pub value: f64,
    /// In which unit.
    pub unit: &'static str,
    /// How far it may be off: in 95 of 100 cases less.
    pub error: f64,
    /// What of that is the calibration's; `None` where nobody knows how good that is.
    pub of_calibration: Option<f64>,
    /// What of it is due to voxels, kernel and screen, and to how deep in a view places are seen.
    pub of_sampling: f64,
    /// What whoever measures should know.
    pub notes: Vec<String>,
}

/// Measures.
///
/// # Errors
/// A sentence for what is no such figure.
pub fn measure(asked: &Asked, doubt: &Doubt) -> Result<Measured, String> {
    let Asked { kind, points, contours, pixel_mm } = asked;
    let count = points.len() + contours.iter().map(Vec::len).sum::<usize>();
    if count > MOST_POINTS {
        return Err(format!("{count} points are too many; {MOST_POINTS} are measured at most"));
    }
    points.iter().chain(contours.iter().flatten()).try_for_each(Place::check)?;
    if !(0.0..=MOST_WIDE_MM).contains(pixel_mm) {
        return Err(format!("pixel_mm is 0 to {MOST_WIDE_MM}"));
    }
    if (*kind == Kind::Stack) != points.is_empty() || (*kind == Kind::Stack) == contours.is_empty() {
        return Err("a stack has contours, and every other figure has points".into());
    }
    let figure = match kind {
        Kind::Stack => Figure::stack(contours.clone())?,
        kind => Figure::new(*kind, points)?,
    };
    let value = figure.value();
    // Variances.
    let mut sums = [0.0; 2];
    for (place, slope) in figure.slopes() {
        let parts =
            doubt.of_place(place.pixel_mm.unwrap_or(*pixel_mm)).map(|sigma| sigma * sigma * slope.length_squared());
        let depth = slope.dot(place.along()) * place.depth_mm;
        sums = [sums[0] + parts[0], sums[1] + parts[1] + depth * depth / 12.0];
    }
    let [calibration, sampling] = sums.map(|sum: f64| SIGMAS * sum.sqrt());
    let unsampled = SIGMAS * figure.unsampled();
    let of_sampling = sampling.hypot(unsampled);
    let mut notes = figure.notes();
    if doubt.calibration_mm.is_none() {
        notes.push("how good the calibration is, is not known: the error is that of sampling alone".into());
    }
    Ok(Measured {
        kind: *kind,
        value,
        unit: figure.unit(),
        error: calibration.hypot(of_sampling),
        of_calibration: doubt.calibration_mm.map(|_| calibration),
        of_sampling,
        notes,
    })
}
