//! One contour: a closed curve on a plane in the world.

use glam::{DVec2, DVec3};

use crate::error::SegmentError;
use crate::polygon;
use crate::spline;

/// Most points of a contour.
pub const MOST_POINTS: usize = 1000;
/// Largest cosine between the directions of a plane.
const SQUARE: f64 = 1e-3;

/// A closed curve on a plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Contour {
    origin: DVec3,
    across: DVec3,
    along: DVec3,
    /// Perpendicular to the plane, along the sweep.
    normal: DVec3,
    polygon: Vec<DVec2>,
    area: f64,
    centroid: DVec3,
    /// The largest disc within.
    disc: (DVec3, f64),
}

impl Contour {
    /// Returns the closed spline through `points`, mm from `origin` along the directions `across`
    /// and `along`, which may have any length. All numbers are finite. `number` counts from 1, for
    /// errors.
    ///
    /// # Errors
    /// [`SegmentError::Points`], [`SegmentError::Axes`], [`SegmentError::Repeated`],
    /// [`SegmentError::Crossed`].
    pub fn new(
        number: usize,
        origin: DVec3,
        [across, along]: [DVec3; 2],
        points: &[DVec2],
    ) -> Result<Self, SegmentError> {
        let count = points.len();
        if !(3..=MOST_POINTS).contains(&count) {
            return Err(SegmentError::Points { number, count, most: MOST_POINTS });
        }
        let [across, along] = [across, along].map(DVec3::normalize_or_zero);
        let normal = across.cross(along).normalize_or_zero();
        if across.dot(along).abs() > SQUARE || normal == DVec3::ZERO {
            return Err(SegmentError::Axes { number });
        }
        let along = normal.cross(across);
        if let Some(at) = (0..count).find(|at| points[*at] == points[(at + count - 1) % count]) {
            return Err(SegmentError::Repeated { number, point: at + 1 });
        }
        let polygon = spline::closed(points);
        if polygon::crosses_itself(&polygon) {
            return Err(SegmentError::Crossed { number });
        }
        let world = |p: DVec2| origin + across * p.x + along * p.y;
        let (area, centroid) = polygon::area(&polygon);
        let (centre, radius) = polygon::largest_disc(&polygon);
        let (centroid, disc) = (world(centroid), (world(centre), radius));
        Ok(Self { origin, across, along, normal, polygon, area, centroid, disc })
    }

    /// Corners of the polygon, world mm.
    pub fn corners(&self) -> impl Iterator<Item = DVec3> {
        self.polygon.iter().map(|p| self.origin + self.across * p.x + self.along * p.y)
    }

    /// Area, as a vector along the sweep, mm².
    pub fn area(&self) -> DVec3 {
        self.normal * self.area
    }

    /// Centroid of the area, world mm.
    pub fn centroid(&self) -> DVec3 {
        self.centroid
    }

    /// Perpendicular to the plane, of length 1.
    pub(crate) fn normal(&self) -> DVec3 {
        self.normal
    }

    /// Turns the perpendicular around.
    pub(crate) fn turn(&mut self) {
        self.normal = -self.normal;
    }

    /// Centre, world mm, and radius, mm, of the largest disc within.
    pub(crate) fn disc(&self) -> (DVec3, f64) {
        self.disc
    }

    /// Returns the distance of a point from the plane, mm, positive behind it along the sweep.
    pub(crate) fn height(&self, p: DVec3) -> f64 {
        self.normal.dot(p - self.origin)
    }

    /// Returns the distance of a point's foot on the plane from the polygon, mm, positive inside.
    pub(crate) fn distance(&self, p: DVec3) -> f64 {
        let p = p - self.origin;
        polygon::distance(&self.polygon, DVec2::new(p.dot(self.across), p.dot(self.along)))
    }
}
