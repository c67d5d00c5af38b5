//! Lengths, angles, areas and volumes between world positions, each with its uncertainty; and
//! the slices that contributed to a place.
//!
//! - [`uncertainty`]: the model of errors.
//! - [`sources`]: positions of all slices, and those that reach a place.

mod error;
mod figure;
mod place;
mod positions;
pub mod sources;
#[cfg(test)]
mod tests;
pub mod uncertainty;

use serde::{Deserialize, Serialize};

pub use error::MeasureError;
pub use figure::{Figure, Kind};
use place::MOST_WIDE_MM;
pub use place::Place;
pub use reconstruct::standard_error::Edge;
pub use sources::{Slices, Source};
use uncertainty::Cause;
pub use uncertainty::Uncertainty;

/// Largest number of points of a figure.
const MOST_POINTS: usize = 2000;
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
    /// Error: the true size lies within this distance of the value in 95 of 100 cases. It is the
    /// root of the sum of squares of its parts.
    pub error: f64,
    /// The part due to the calibration; `None` if that is unknown.
    pub of_calibration: Option<f64>,
    /// The part due to the noise of the tracker's sensors; `None` if that is unknown.
    pub of_tracker: Option<f64>,
    /// The part due to kernel, distance of slices, voxels, and the depth of places picked in a
    /// view.
    pub of_sampling: f64,
    /// The part due to the hand's clicks and the screen's pixels.
    pub of_clicks: f64,
    /// The part due to noise of the volume, which displaces edges; `None` if the session keeps no
    /// standard errors, or if no place lies on an edge.
    pub of_noise: Option<f64>,
    /// Notes for the user.
    pub notes: Vec<String>,
}

impl Request {
    /// Returns all places.
    pub fn places(&self) -> impl Iterator<Item = &Place> {
        self.points.iter().chain(self.contours.iter().flatten())
    }

    /// Returns all places, in the same order.
    pub fn places_mut(&mut self) -> impl Iterator<Item = &mut Place> {
        self.points.iter_mut().chain(self.contours.iter_mut().flatten())
    }

    /// Checks the places, and that they are of the kind of figure.
    ///
    /// # Errors
    /// [`MeasureError`] for those that are not.
    pub fn check(&self) -> Result<(), MeasureError> {
        let Self { kind, points, contours, pixel_mm } = self;
        let count = self.places().count();
        if count > MOST_POINTS {
            return Err(MeasureError::TooMany { count, most: MOST_POINTS });
        }
        self.places().try_for_each(Place::check)?;
        if !(0.0..=MOST_WIDE_MM).contains(pixel_mm) {
            return Err(MeasureError::Width { what: "pixel_mm", most_mm: MOST_WIDE_MM });
        }
        if (*kind == Kind::Stack) != points.is_empty() || (*kind == Kind::Stack) == contours.is_empty() {
            return Err(MeasureError::Kind);
        }
        Ok(())
    }
}

/// Measures a figure among these slices.
///
/// # Errors
/// [`MeasureError`] for an invalid figure.
pub fn measure(request: &Request, uncertainty: &Uncertainty, slices: &Slices) -> Result<Measured, MeasureError> {
    request.check()?;
    let Request { kind, points, contours, pixel_mm } = request;
    let (figure, mut places) = match kind {
        Kind::Stack => Figure::stack(contours.clone())?,
        kind => (Figure::new(*kind, points)?, points.clone()),
    };
    places.iter_mut().for_each(|place| place.pixel_mm = place.pixel_mm.or(Some(*pixel_mm)));
    let errors = uncertainty.errors(&places, slices);
    let interval = errors.of(&figure);
    let mut notes = figure.notes();
    if interval.is_bent {
        notes.push("the figure is small against the errors of its points: the error is approximate".into());
    }
    notes.extend(errors.without_calibration.as_ref().map(|why| format!("calibration error unknown: {why}")));
    if errors.without_tracker {
        notes.push("noise of the tracker or arm unknown, and not included".into());
    }
    if errors.on_edges > 0 && errors.on_edges < places.len() {
        let (on, all) = (errors.on_edges, places.len());
        notes.push(format!("{on} of {all} points lie on edges; the volume's noise is included at these alone"));
    }
    let known = |is_known: bool, cause| is_known.then(|| interval.of(cause));
    Ok(Measured {
        kind: *kind,
        value: figure.value(),
        unit: figure.unit(),
        error: interval.error,
        of_calibration: known(errors.without_calibration.is_none(), Cause::Calibration),
        of_tracker: known(!errors.without_tracker, Cause::Tracker),
        of_sampling: interval.of(Cause::Sampling),
        of_clicks: interval.of(Cause::Clicks),
        of_noise: known(errors.on_edges > 0, Cause::Noise),
        notes,
    })
}
