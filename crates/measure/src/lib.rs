//! Lengths, angles, areas and volumes between world positions, each with its uncertainty; and
//! the slices that contributed to a place.
//!
//! The uncertainty of a picked place has several parts: the calibration error, the position
//! within a voxel and within a screen pixel, and the kernel's blur. A place picked in the view
//! of the volume also has a depth uncertainty: it lies anywhere within a width dᵢ along the
//! direction aᵢ of its ray. The errors of different places are treated as independent. Errors
//! that neighbouring places share make lengths between them more accurate than reported, never
//! less. Errors are propagated to first order, σ² = Σ |∂f/∂pᵢ|² σᵢ² + (∂f/∂pᵢ · aᵢ)² dᵢ² / 12.
//! The reported error is twice that σ, which covers about 95 of 100 cases.

mod error;
mod figure;
mod place;
pub mod sources;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};

pub use error::MeasureError;
pub use figure::{Figure, Kind};
use place::MOST_WIDE_MM;
pub use place::Place;
pub use sources::{Slices, Source};

/// Largest number of points of a figure.
const MOST_POINTS: usize = 2000;
/// Standard deviations of the reported error.
const SIGMAS: f64 = 2.0;

/// Uncertainty of places.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Uncertainty {
    /// Standard deviation of a place due to the calibration, at the image's worst corner, mm;
    /// `None` if unknown.
    pub calibration_mm: Option<f64>,
    /// The longest distance between neighbouring voxels, mm.
    pub voxel_mm: f64,
    /// Half width at half maximum of the kernel where it is widest, mm.
    pub hwhm_mm: f64,
}

impl Uncertainty {
    /// Returns standard deviations of a place along each axis, due to the calibration and to
    /// sampling, for a screen pixel of this width, mm. A uniform distribution over a width has a
    /// twelfth of its square as variance.
    fn of_place(&self, pixel_mm: f64) -> [f64; 2] {
        let within = [self.voxel_mm, self.hwhm_mm, pixel_mm].map(|width| width * width / 12.0);
        // The calibration error is that of a place in space; each axis has a third of its
        // variance.
        [self.calibration_mm.unwrap_or(0.0) / 3.0_f64.sqrt(), within.iter().sum::<f64>().sqrt()]
    }
}

/// A requested measurement.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Request {
    /// Kind of figure.
    pub kind: Kind,
    /// Its places: two of a distance, three of an angle (vertex in the middle), three or more
    /// around an area, the ends of three diameters of an ellipsoid. None for a stack.
    #[serde(default)]
    pub points: Vec<Place>,
    /// Areas one above the other, of a stack.
    #[serde(default)]
    pub contours: Vec<Vec<Place>>,
    /// Width of a screen pixel for places that do not give their own, mm.
    #[serde(default)]
    pub pixel_mm: f64,
}

/// Result of a measurement.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Measured {
    /// Kind of figure.
    pub kind: Kind,
    /// Its size.
    pub value: f64,
    /// Unit of the size.
    pub unit: &'static str,
    /// Error bound, not exceeded in 95 of 100 cases.
    pub error: f64,
    /// The part due to the calibration; `None` if its accuracy is unknown.
    pub of_calibration: Option<f64>,
    /// The part due to voxels, kernel and screen, and to the depth of places picked in a view.
    pub of_sampling: f64,
    /// Notes for the user.
    pub notes: Vec<String>,
}

/// Measures a figure.
///
/// # Errors
/// [`MeasureError`] for an invalid figure.
pub fn measure(request: &Request, uncertainty: &Uncertainty) -> Result<Measured, MeasureError> {
    let Request { kind, points, contours, pixel_mm } = request;
    let count = points.len() + contours.iter().map(Vec::len).sum::<usize>();
    if count > MOST_POINTS {
        return Err(MeasureError::TooMany { count, most: MOST_POINTS });
    }
    points.iter().chain(contours.iter().flatten()).try_for_each(Place::check)?;
    if !(0.0..=MOST_WIDE_MM).contains(pixel_mm) {
        return Err(MeasureError::Width { what: "pixel_mm", most_mm: MOST_WIDE_MM });
    }
    if (*kind == Kind::Stack) != points.is_empty() || (*kind == Kind::Stack) == contours.is_empty() {
        return Err(MeasureError::Kind);
    }
    let figure = match kind {
        Kind::Stack => Figure::stack(contours.clone())?,
        kind => Figure::new(*kind, points)?,
    };
    let value = figure.value();
    // Variances.
    let mut sums = [0.0; 2];
    for (place, slope) in figure.slopes() {
        let parts = uncertainty
            .of_place(place.pixel_mm.unwrap_or(*pixel_mm))
            .map(|sigma| sigma * sigma * slope.length_squared());
        let depth = slope.dot(place.along()) * place.depth_mm;
        sums = [sums[0] + parts[0], sums[1] + parts[1] + depth * depth / 12.0];
    }
    let [calibration, sampling] = sums.map(|sum: f64| SIGMAS * sum.sqrt());
    let unsampled = SIGMAS * figure.unsampled();
    let of_sampling = sampling.hypot(unsampled);
    let mut notes = figure.notes();
    if uncertainty.calibration_mm.is_none() {
        notes.push("the calibration's accuracy is unknown: the error is that of sampling alone".into());
    }
    Ok(Measured {
        kind: *kind,
        value,
        unit: figure.unit(),
        error: calibration.hypot(of_sampling),
        of_calibration: uncertainty.calibration_mm.map(|_| calibration),
        of_sampling,
        notes,
    })
}
