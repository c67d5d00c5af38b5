//! Errors of a calibration on images that the fit did not use.
//!
//! In the same recording the calibration gives the target's position. In another recording it
//! may differ. A point or a plane is then fitted to the images by the calibration, and the
//! errors are their disagreement about it. The position of a stylus's tip is known in both.

use glam::DVec3;
use nalgebra::{Matrix3, SymmetricEigen};

use super::Place;
use super::detection::Detection;
use super::refine::Refined;
use crate::least_squares::Loss;
use crate::least_squares::loss::spread;
use crate::probe::errors::Errors;
use crate::probe::track::Track;
use crate::statistics::median;

/// Rounds of reweighting.
const ROUNDS: usize = 8;
/// Least spread, mm; smaller values are rounding errors.
const LEAST_SPREAD_MM: f64 = 1e-9;

/// Returns the errors of the target's position in these images, without images of other
/// objects: distances of the observed points from it, mm.
pub(super) fn errors(
    refined: &Refined,
    detections: &mut [Detection],
    track: &Track,
    known: Option<Place>,
) -> Option<Errors> {
    let mut place = known.or_else(|| place_of(&refined.place, &points(refined, detections, track)))?;
    for _ in 0..ROUNDS {
        for detection in detections.iter_mut() {
            if let Some(map) = detection.reference_from_probe(track, refined.lag_s) {
                detection.choose(|px| place.off_mm(map.transform_point3(refined.plane.point(px))));
            }
        }
        if known.is_none() {
            place = place_of(&place, &points(refined, detections, track))?;
        }
    }
    let seen: Vec<(usize, Vec<f64>)> = (detections.iter())
        .filter_map(|detection| {
            let map = detection.reference_from_probe(track, refined.lag_s)?;
            let off = |px| place.off_mm(map.transform_point3(refined.plane.point(px)));
            Some((detection.frame, detection.marks.iter().copied().map(off).collect()))
        })
        .collect();
    let components = if matches!(place, Place::Point(_)) { 3 } else { 1 };
    let lengths: Vec<(usize, f64)> = seen.iter().flat_map(|(_, off)| off).map(|off| (components, *off)).collect();
    let (scale, loss) = (spread(&lengths).max(LEAST_SPREAD_MM), Loss::Tukey.of(components));
    Errors::of(seen.into_iter().filter(|(_, off)| off.iter().all(|off| loss.weight(off / scale) > 0.0)))
}

/// Returns the observed points in the reference's frame.
fn points(refined: &Refined, detections: &[Detection], track: &Track) -> Vec<DVec3> {
    let of_detection = |detection: &Detection| {
        let map = detection.reference_from_probe(track, refined.lag_s)?;
        Some(detection.marks.iter().map(|px| map.transform_point3(refined.plane.point(*px))).collect::<Vec<_>>())
    };
    detections.iter().filter_map(of_detection).flatten().collect()
}

/// Fits a target of the given kind to most points; `None` without points.
fn place_of(kind: &Place, points: &[DVec3]) -> Option<Place> {
    if points.is_empty() {
        return None;
    }
    match kind {
        Place::Point(_) => {
            let along = |axis: usize| median(&mut points.iter().map(|point| point[axis]).collect::<Vec<_>>());
            Some(Place::Point(DVec3::new(along(0), along(1), along(2))))
        }
        Place::Plane { .. } => {
            let mut weights = vec![1.0; points.len()];
            let mut place = *kind;
            for round in 0..2 * ROUNDS {
                place = through(points, &weights);
                let off: Vec<f64> = points.iter().map(|point| place.off_mm(*point)).collect();
                let scale = spread(&off.iter().map(|off| (1, *off)).collect::<Vec<_>>()).max(LEAST_SPREAD_MM);
                let loss = if round < ROUNDS { Loss::Huber } else { Loss::Tukey }.of(1);
                weights = off.iter().map(|off| loss.weight(off / scale)).collect();
            }
            Some(place)
        }
    }
}

/// Fits a plane to weighted points: it minimises the sum of squared distances.
fn through(points: &[DVec3], weights: &[f64]) -> Place {
    let total: f64 = weights.iter().sum();
    let middle = points.iter().zip(weights).map(|(point, weight)| *point * *weight).sum::<DVec3>() / total;
    let mut spread = Matrix3::<f64>::zeros();
    for (point, weight) in points.iter().zip(weights) {
        let off = (*point - middle).to_array();
        spread += Matrix3::from_fn(|i, j| weight * off[i] * off[j]);
    }
    let eigen = SymmetricEigen::new(spread);
    let least = (0..3).min_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b])).unwrap_or(0);
    let normal = DVec3::from_array([0, 1, 2].map(|i| eigen.eigenvectors[(i, least)])).normalize();
    Place::Plane { normal, distance_mm: normal.dot(middle) }
}
