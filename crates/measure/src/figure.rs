//! Geometric figures: their size, and its sensitivity to their points.

use std::f64::consts::PI;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::error::MeasureError;
use crate::place::Place;

/// Distance from a plane, as a share of an area's size, above which a note is given.
const FLAT: f64 = 0.02;
/// Largest angle between contours of a stack that count as parallel, radians.
const PARALLEL: f64 = 0.09;
/// Deviation of diameters from right angles above which a note is given, radians.
const SQUARE: f64 = 0.18;
/// Points closer than this are identical, mm.
const SAME_MM: f64 = 1e-6;
/// Step of a point for numerical derivatives, mm.
const STEP_MM: f64 = 1e-4;

/// Kinds of figures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Distance between two points, mm.
    Distance,
    /// Angle at the middle one of three points, degrees.
    Angle,
    /// Area within a closed line through points, mm².
    Area,
    /// Volume of a body with three orthogonal diameters, π/6·a·b·c, mm³.
    Ellipsoid,
    /// Volume of a body cut into slabs, the sum of area times thickness, mm³.
    Stack,
}

/// A valid figure.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    kind: Kind,
    /// For a stack, the points of all contours, in the order of their heights.
    points: Vec<DVec3>,
    /// End index of each contour of a stack.
    ends: Vec<usize>,
}

impl Figure {
    /// Creates a figure from places.
    ///
    /// # Errors
    /// [`MeasureError`] for points that do not form such a figure.
    pub(super) fn new(kind: Kind, places: &[Place]) -> Result<Self, MeasureError> {
        let count = places.len();
        let (is_fine, takes) = match kind {
            Kind::Distance => (count == 2, "two points"),
            Kind::Angle => (count == 3, "three points, the vertex in the middle"),
            Kind::Area => (count >= 3, "three points or more"),
            Kind::Ellipsoid => (count == 6, "six points, the ends of three diameters"),
            Kind::Stack => (false, "contours"),
        };
        if !is_fine {
            return Err(MeasureError::Points { takes, count });
        }
        let figure = Self { kind, points: points(places), ends: Vec::new() };
        let apart = |a: usize, b: usize| figure.points[a].distance(figure.points[b]) > SAME_MM;
        let sound = match kind {
            Kind::Distance => true,
            Kind::Angle => apart(0, 1) && apart(1, 2),
            Kind::Ellipsoid => apart(0, 1) && apart(2, 3) && apart(4, 5),
            Kind::Area | Kind::Stack => spanned(&figure.points).length() > SAME_MM,
        };
        if sound { Ok(figure) } else { Err(MeasureError::Degenerate) }
    }

    /// Creates a stack from contours, in any order; also returns their places in the stack's order.
    ///
    /// # Errors
    /// [`MeasureError`] for contours that are not one above the other.
    pub(super) fn stack(mut contours: Vec<Vec<Place>>) -> Result<(Self, Vec<Place>), MeasureError> {
        if contours.len() < 2 {
            return Err(MeasureError::FewContours);
        }
        let mut up: Option<DVec3> = None;
        for contour in &contours {
            let normal = spanned(&points(contour));
            if contour.len() < 3 || normal.length() <= SAME_MM {
                return Err(MeasureError::Contour);
            }
            let normal = normal.normalize();
            let up = *up.get_or_insert(normal);
            if normal.dot(up).abs() < PARALLEL.cos() {
                return Err(MeasureError::NotParallel { degrees: PARALLEL.to_degrees() });
            }
        }
        let up = up.unwrap_or(DVec3::Z);
        let height = |contour: &Vec<Place>| middle(&points(contour)).dot(up);
        contours.sort_by(|a, b| height(a).total_cmp(&height(b)));
        if contours.windows(2).any(|pair| height(&pair[1]) - height(&pair[0]) <= SAME_MM) {
            return Err(MeasureError::SameHeight);
        }
        let mut end = 0;
        let ends = contours.iter().map(|contour| {
            end += contour.len();
            end
        });
        let ends = ends.collect();
        let places = contours.concat();
        Ok((Self { kind: Kind::Stack, points: points(&places), ends }, places))
    }

    /// Returns its size, in its [unit](Self::unit).
    pub fn value(&self) -> f64 {
        self.of(&self.points)
    }

    fn of(&self, points: &[DVec3]) -> f64 {
        match self.kind {
            Kind::Distance => points[0].distance(points[1]),
            Kind::Angle => (points[0] - points[1]).angle_between(points[2] - points[1]).to_degrees(),
            Kind::Area => spanned(points).length(),
            Kind::Ellipsoid => PI / 6.0 * points.chunks_exact(2).map(|ends| ends[0].distance(ends[1])).product::<f64>(),
            Kind::Stack => self.slabs(points).iter().map(|[area, thickness]| area * thickness).sum(),
        }
    }

    /// Returns areas and thicknesses of a stack. Each contour represents half the distance to
    /// its neighbours; those at the ends extend as far beyond the stack as inwards.
    fn slabs(&self, points: &[DVec3]) -> Vec<[f64; 2]> {
        let mut from = 0;
        let contours = self.ends.iter().map(|end| {
            let contour = &points[from..*end];
            from = *end;
            contour
        });
        let contours: Vec<&[DVec3]> = contours.collect();
        let up = contours.first().map_or(DVec3::Z, |first| spanned(first).normalize_or_zero());
        let heights: Vec<f64> = contours.iter().map(|contour| middle(contour).dot(up)).collect();
        let gap = |at: usize| (heights[at + 1] - heights[at]).abs();
        let last = contours.len() - 1;
        let thickness = |at: usize| match at {
            0 => gap(0),
            at if at == last => gap(last - 1),
            at => (gap(at - 1) + gap(at)) / 2.0,
        };
        contours.iter().enumerate().map(|(at, contour)| [spanned(contour).length(), thickness(at)]).collect()
    }

    /// Whether it consists of single points, and not of outlines.
    pub(super) fn is_of_few(&self) -> bool {
        matches!(self.kind, Kind::Distance | Kind::Angle | Kind::Ellipsoid)
    }

    /// Returns its size with some points displaced, by their number.
    pub(super) fn moved(&self, shifts: impl Iterator<Item = (usize, DVec3)>) -> f64 {
        let mut points = self.points.clone();
        shifts.for_each(|(number, shift)| points[number] += shift);
        self.of(&points)
    }

    /// Returns the change of the value per mm of each point's motion along each axis.
    pub(super) fn slopes(&self) -> Vec<DVec3> {
        let mut points = self.points.clone();
        let mut slope = |n: usize, axis: DVec3| {
            let at = self.points[n];
            let [above, below] = [STEP_MM, -STEP_MM].map(|step| {
                points[n] = at + axis * step;
                self.of(&points)
            });
            points[n] = at;
            (above - below) / (2.0 * STEP_MM)
        };
        (0..self.points.len()).map(|n| DVec3::from_array(DVec3::AXES.map(|axis| slope(n, axis)))).collect()
    }

    /// Returns the standard deviations due to unsampled space beyond its points: for a stack the
    /// extent of the body beyond each end, which is uniform; none otherwise.
    pub(super) fn unsampled(&self) -> Vec<f64> {
        if self.kind != Kind::Stack {
            return Vec::new();
        }
        let slabs = self.slabs(&self.points);
        let ends = [slabs.first(), slabs.last()].into_iter().flatten();
        // The body ends anywhere from nothing to a whole slab beyond an end; half a slab is
        // assumed.
        ends.map(|[area, thickness]| area * thickness / 12.0_f64.sqrt()).collect()
    }

    /// Returns the unit of its value.
    pub fn unit(&self) -> &'static str {
        match self.kind {
            Kind::Distance => "mm",
            Kind::Angle => "°",
            Kind::Area => "mm²",
            Kind::Ellipsoid | Kind::Stack => "mm³",
        }
    }

    /// Returns notes for the user.
    pub(super) fn notes(&self) -> Vec<String> {
        match self.kind {
            Kind::Area => {
                let normal = spanned(&self.points).normalize_or_zero();
                let at = middle(&self.points);
                let off = self.points.iter().map(|p| (*p - at).dot(normal).abs()).fold(0.0, f64::max);
                let size = self.points.iter().map(|p| p.distance(at)).fold(0.0, f64::max);
                let bent = off > FLAT * size;
                bent.then(|| {
                    format!(
                        "the points lie up to {off:.1} mm off a plane; the area is that of the outline's projection"
                    )
                })
                .into_iter()
                .collect()
            }
            Kind::Ellipsoid => {
                let axes: Vec<DVec3> =
                    self.points.chunks_exact(2).map(|ends| (ends[1] - ends[0]).normalize_or_zero()).collect();
                let dots = [(0, 1), (1, 2), (0, 2)].map(|(a, b)| axes[a].dot(axes[b]).abs());
                let leaning = dots.iter().fold(0.0_f64, |most, dot| most.max(dot.asin()));
                let is_leaning = leaning > SQUARE;
                let note = || {
                    format!(
                        "the diameters are {:.0}° from right angles: the error is larger than stated",
                        leaning.to_degrees()
                    )
                };
                is_leaning.then(note).into_iter().collect()
            }
            Kind::Distance | Kind::Angle | Kind::Stack => Vec::new(),
        }
    }
}

fn points(places: &[Place]) -> Vec<DVec3> {
    places.iter().map(|place| DVec3::from_array(place.point)).collect()
}

/// Returns the vector area of a closed line (half the sum of the cross products of its points).
/// The length for a flat line is its area, in any orientation.
fn spanned(points: &[DVec3]) -> DVec3 {
    let Some(first) = points.first() else { return DVec3::ZERO };
    // Relative to the first point, so that distant positions lose no digits.
    let sum: DVec3 = points.windows(2).map(|pair| (pair[0] - *first).cross(pair[1] - *first)).sum();
    sum / 2.0
}

fn middle(points: &[DVec3]) -> DVec3 {
    points.iter().sum::<DVec3>() / points.len().max(1) as f64
}
