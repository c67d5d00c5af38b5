//! The gap between two slices that are too far apart.
//!
//! From each of a fixed grid of pixels of the first slice, a line runs along its normal to the
//! second slice's plane. A line belongs to the gap if it begins and ends on data and is longer
//! than twice a slice's reach. Its unseen part holds points spaced at half a slice's reach. Once
//! all points have been seen, the gap has been seen, except within a quarter of the reach at its
//! borders.

use glam::DVec3;

use mask::Mask;

use super::slice_plane::{SlicePlane, holds};

/// Lines along u and v.
const GRID: usize = 6;
/// Largest number of points of a line; they lie farther apart in a gap too wide for this number.
const LAYERS: usize = 6;
/// Slices farther apart than this show different places, mm.
pub const MOST_MM: f64 = 30.0;
/// Largest expected width of a pixel, mm.
const BORDER_MM: f64 = 2.0;
/// Slices whose planes meet at more than 60° also show different places.
const LEAST_COSINE: f64 = 0.5;

/// Relation of two slices.
#[derive(Debug, Clone)]
pub enum Between {
    /// There is no gap between them.
    Close,
    /// There is a gap between them.
    Apart(Box<Gap>),
    /// They show different places: side by side, too far apart, or too much turned.
    Elsewhere,
}

/// The gap between two slices.
#[derive(Debug, Clone)]
pub struct Gap {
    prism: [[DVec3; 4]; 2],
    /// Points not seen yet.
    points: Vec<DVec3>,
    centre: DVec3,
    radius: f64,
    width_mm: f64,
}

/// Returns the relation of two slices with one mask, for this reach to either side.
pub fn between(a: &SlicePlane, b: &SlicePlane, mask: &Mask, reach_mm: f64) -> Between {
    let along = a.normal();
    let cosine = along.dot(b.normal());
    if cosine.abs() < LEAST_COSINE {
        return Between::Elsewhere;
    }
    // The distance to the other plane is affine in the position, so it is largest at a corner.
    let distance = |from: DVec3| -b.distance(from) / cosine;
    let longest = a.corners().iter().map(|corner| distance(*corner).abs()).fold(0.0, f64::max);
    if longest <= 2.0 * reach_mm {
        return Between::Close;
    }
    let [columns, rows] = a.data();
    let at = |[low, high]: [f64; 2], cell: f64| low + (high - low) * cell / GRID as f64;
    let mut points = Vec::new();
    let mut cells = [[GRID, 0], [GRID, 0]];
    let (mut meet, mut width_mm) = (false, 0.0_f64);
    for cell in 0..GRID * GRID {
        let cell = [cell % GRID, cell / GRID];
        let [u, v] = [at(columns, cell[0] as f64 + 0.5), at(rows, cell[1] as f64 + 0.5)];
        let from = a.world(u, v);
        let distance = distance(from);
        let foot = b.local(from + along * distance);
        if !holds(mask, u, v) || !holds(mask, foot.x, foot.y) {
            continue;
        }
        meet = true;
        let unseen = distance.abs() - 2.0 * reach_mm;
        if distance.abs() > MOST_MM {
            return Between::Elsewhere;
        }
        if unseen <= 0.0 {
            continue;
        }
        width_mm = width_mm.max(distance.abs());
        let layers = ((2.0 * unseen / reach_mm).ceil() as usize).clamp(1, LAYERS);
        for layer in 0..layers {
            let depth = reach_mm + unseen * (layer as f64 + 0.5) / layers as f64;
            points.push(from + along * (depth * distance.signum()));
        }
        for (span, cell) in cells.iter_mut().zip(cell) {
            *span = [span[0].min(cell), span[1].max(cell + 1)];
        }
    }
    if points.is_empty() {
        return if meet { Between::Close } else { Between::Elsewhere };
    }
    let corner = |[u, v]: [usize; 2]| a.world(at(columns, cells[0][u] as f64), at(rows, cells[1][v] as f64));
    let near = [[0, 0], [1, 0], [1, 1], [0, 1]].map(corner);
    let far = near.map(|from| from + along * distance(from));
    let centre = points.iter().sum::<DVec3>() / points.len() as f64;
    let radius = points.iter().map(|point| point.distance(centre)).fold(0.0, f64::max);
    Between::Apart(Box::new(Gap { prism: [near, far], points, centre, radius, width_mm }))
}

impl Gap {
    /// Returns its corners on the first slice and on the second.
    pub fn prism(&self) -> &[[DVec3; 4]; 2] {
        &self.prism
    }

    /// Returns the middle of the points not seen yet.
    pub fn centre(&self) -> DVec3 {
        self.points.iter().sum::<DVec3>() / self.points.len().max(1) as f64
    }

    /// Returns the distance between the slices, mm.
    pub fn width_mm(&self) -> f64 {
        self.width_mm
    }

    /// Returns whether all of it was seen.
    pub fn is_closed(&self) -> bool {
        self.points.is_empty()
    }

    /// Removes the points that a slice sees; returns the number of tested points.
    pub fn see(&mut self, plane: &SlicePlane, mask: &Mask, reach_mm: f64) -> u64 {
        let far = plane.distance(self.centre).abs() > self.radius + reach_mm;
        if far || (plane.beside(self.centre).abs() - plane.half_mm()).max_element() > self.radius + BORDER_MM {
            return 0;
        }
        let points = self.points.len() as u64;
        self.points.retain(|point| !plane.sees(*point, reach_mm, mask));
        points
    }
}
