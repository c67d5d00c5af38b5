//! Start for a plane target: tries normals in all directions, and solves for the rest by linear
//! least squares.
//!
//! The probe has the pose R, t in the reference's frame, and the plane has the normal n. A
//! point (u, v) of the line satisfies n·R(u·**u** + v·**v** + **o**) − d = −n·t. For a given n
//! this is linear in ten numbers. So normals all over half a sphere are tried. Their fits are
//! compared in pixels, not in mm: along a direction in which the probe hardly moved, an image
//! of size zero fits all lines. The best normal of each neighbourhood and its lag move to the
//! best fit, by the median. Those about as good as the best are refined. No assumption is made
//! about the probe's pose.

use std::f64::consts::{PI, TAU};

use glam::{DAffine3, DVec2, DVec3};

use super::detection::Detection;
use super::refine::{Refined, Start, refine};
use super::{Place, Target};
use crate::least_squares::{Loss, Unsolved};
use crate::probe::plane::{ImagePlane, Unit, solve};
use crate::probe::track::Track;
use crate::statistics::median;

/// Count of the plane's numbers and the distance.
const UNKNOWN: usize = 10;
/// Number of normals; neighbours are 9° apart.
const NORMALS: usize = 300;
/// Largest angle of neighbours, rad.
const NEAR_RAD: f64 = 0.28;
/// Number of the best normals that are followed.
const FOLLOWED: usize = 8;
/// Lags at which normals are tried, if there are times, s.
const LAGS_S: [f64; 5] = [0.0, 0.15, -0.15, 0.3, -0.3];
/// Initial step of a normal, rad, and step of the lag per rad of it, s; the steps are halved …
const STEP_RAD: f64 = 0.1;
const LAG_S: f64 = 0.7;
/// … this many times.
const HALVINGS: usize = 8;
/// Candidates whose misfit is at most this multiple of the best one's are refined.
const ALIKE: f64 = 3.0;
/// Number of reweighted solutions per loss.
const ROUNDS: usize = 3;
/// Least spread, pixels; smaller values are rounding errors.
const LEAST_SPREAD_PX: f64 = 1e-9;

/// A normal with its solution.
struct Tried {
    normal: DVec3,
    lag_s: f64,
    plane: ImagePlane,
    distance_mm: f64,
    /// Median distance of lines from their predicted positions, pixels.
    off_px: f64,
    agrees: Vec<bool>,
}

/// Finds the plane and the target that explain the lines best, and refines them.
///
/// # Errors
/// [`Unsolved`] for the best one, if none can be refined; `None` if there is no start at all.
pub(super) fn find(
    detections: &[Detection],
    track: &Track,
    size_px: [u32; 2],
    lag: bool,
) -> Option<Result<Refined, Unsolved>> {
    let maps = |lag_s: f64| -> Vec<Option<DAffine3>> {
        detections.iter().map(|detection| detection.reference_from_probe(track, lag_s)).collect()
    };
    let mut nearby: Vec<(f64, DVec3, f64)> = Vec::new();
    for &lag_s in if lag { &LAGS_S[..] } else { &LAGS_S[..1] } {
        let maps = maps(lag_s);
        let tried: Vec<Tried> =
            normals().filter_map(|normal| Tried::of((normal, lag_s), detections, &maps, size_px)).collect();
        let is_best_near = |one: &&Tried| {
            let near = tried.iter().filter(|other| one.normal.dot(other.normal).abs() > NEAR_RAD.cos());
            near.map(|other| other.off_px).fold(f64::INFINITY, f64::min) >= one.off_px
        };
        nearby.extend(tried.iter().filter(is_best_near).map(|one| (one.off_px, one.normal, lag_s)));
    }
    nearby.sort_by(|a, b| a.0.total_cmp(&b.0));
    let follow = |normal: DVec3, lag_s: f64| Tried::of((normal, lag_s), detections, &maps(lag_s), size_px);
    let mut best: Vec<Tried> = (nearby.into_iter().take(FOLLOWED))
        .filter_map(|(_, normal, lag_s)| follow(normal, lag_s)?.followed(lag, follow))
        .collect();
    best.sort_by(|a, b| a.off_px.total_cmp(&b.off_px));
    let least = ALIKE * best.first()?.off_px.max(LEAST_SPREAD_PX);
    best.retain(|one| one.off_px <= least);
    let refined = best.into_iter().map(|one| {
        let place = Place::Plane { normal: one.normal, distance_mm: one.distance_mm };
        let initial = Start { plane: one.plane, place, lag_s: one.lag_s, agrees: one.agrees };
        refine(Target::Plane, detections, track, initial, lag)
    });
    let mut found: Option<(f64, Result<Refined, Unsolved>)> = None;
    for refined in refined {
        let off_px = refined.as_ref().map_or(f64::INFINITY, |refined| off_px(refined, detections, track));
        if found.as_ref().is_none_or(|(least, _)| off_px < *least) {
            found = Some((off_px, refined));
        }
    }
    found.map(|(_, refined)| refined)
}

/// Returns directions all over half a sphere, evenly (a spiral of the golden angle).
fn normals() -> impl Iterator<Item = DVec3> {
    let golden = PI * (3.0 - 5.0_f64.sqrt());
    (0..NORMALS).map(move |i| {
        let z = (i as f64 + 0.5) / NORMALS as f64;
        let (sin, cos) = (golden * i as f64 % TAU).sin_cos();
        let radius = (1.0 - z * z).sqrt();
        DVec3::new(radius * cos, radius * sin, z)
    })
}

impl Tried {
    /// Solves for the rest with a given normal. `None` if the lines leave it open.
    fn of(
        (normal, lag_s): (DVec3, f64),
        detections: &[Detection],
        maps: &[Option<DAffine3>],
        size_px: [u32; 2],
    ) -> Option<Self> {
        let unit = Unit::of(size_px);
        let rows: Vec<(DVec2, DVec3, f64)> = (detections.iter().zip(maps))
            .filter_map(|(detection, map)| Some((detection, (*map)?)))
            .flat_map(|(detection, map)| {
                let seen = map.matrix3.transpose() * normal;
                detection.marks.iter().map(move |px| (*px, seen, normal.dot(map.translation)))
            })
            .collect();
        let mut weights = vec![1.0; rows.len()];
        let mut found = None;
        for round in 0..2 * ROUNDS {
            let (mut matrix, mut right) = ([[0.0; UNKNOWN]; UNKNOWN], [0.0; UNKNOWN]);
            for ((px, seen, height), weight) in rows.iter().zip(&weights) {
                let at = unit.brought(*px);
                let [x, y, z] = seen.to_array();
                let row = [at.x * x, at.x * y, at.x * z, at.y * x, at.y * y, at.y * z, x, y, z, -1.0];
                for (k, entry) in row.iter().enumerate() {
                    (0..=k).for_each(|l| matrix[k][l] += weight * entry * row[l]);
                    right[k] -= weight * entry * height;
                }
            }
            // Undetermined numbers are closed by the shortest solution: 1e-9 of the diagonal's
            // mean.
            let ridge = 1e-9 * (0..UNKNOWN).map(|i| matrix[i][i]).sum::<f64>() / UNKNOWN as f64;
            (0..UNKNOWN).for_each(|i| matrix[i][i] += ridge);
            let x = solve(matrix, right)?;
            let vector = |first: usize| DVec3::from_slice(&x[first..]);
            let plane = unit.plane(vector(0), vector(3), vector(6));
            let off_px: Vec<f64> = rows
                .iter()
                .map(|(px, seen, height)| (seen.dot(plane.point(*px)) + height - x[9]).abs() / steepness(&plane, *seen))
                .collect();
            let middle = median(&mut off_px.clone());
            // The median distance of a normal distribution is 0.6745 standard deviations.
            let spread = (middle / 0.6745).max(LEAST_SPREAD_PX);
            let loss = if round < ROUNDS { Loss::Huber } else { Loss::Tukey }.of(1);
            for (weight, (off, (_, seen, _))) in weights.iter_mut().zip(off_px.iter().zip(&rows)) {
                *weight = loss.weight(off / spread) / steepness(&plane, *seen).powi(2);
            }
            let agrees = |spots: &[f64]| spots.iter().all(|off| Loss::Tukey.of(1).weight(off / spread) > 0.0);
            let mut two = off_px.chunks_exact(2);
            let agrees = maps.iter().map(|map| map.is_some() && two.next().is_some_and(agrees)).collect();
            found = Some(Self { normal, lag_s, plane, distance_mm: x[9], off_px: middle, agrees });
        }
        found.filter(|tried| tried.off_px.is_finite() && tried.plane.u.is_finite() && tried.plane.v.is_finite())
    }

    /// Follows small steps of the normal, and of the lag if it is fitted, to the best fit.
    fn followed(self, lag: bool, of: impl Fn(DVec3, f64) -> Option<Self>) -> Option<Self> {
        let (mut here, mut step) = (self, STEP_RAD);
        for _ in 0..HALVINGS {
            loop {
                let (first, second) = here.normal.any_orthonormal_pair();
                let turned = |along: DVec3| ((here.normal + along * step).normalize(), here.lag_s);
                let later = |sign: f64| (here.normal, here.lag_s + sign * LAG_S * step);
                let beside = [first, -first, second, -second].map(turned).into_iter().chain([1.0, -1.0].map(later));
                let beside = beside.take(if lag { 6 } else { 4 }).filter_map(|(normal, lag_s)| of(normal, lag_s));
                let best = beside.min_by(|a, b| a.off_px.total_cmp(&b.off_px))?;
                if best.off_px >= here.off_px {
                    break;
                }
                here = best;
            }
            step *= 0.5;
        }
        Some(here)
    }
}

/// Returns the change of height above the plane per pixel across its line, mm.
fn steepness(plane: &ImagePlane, seen: DVec3) -> f64 {
    plane.u.dot(seen).hypot(plane.v.dot(seen)).max(f64::MIN_POSITIVE)
}

/// Returns the median distance of lines from their predicted positions, pixels, including
/// unused lines.
fn off_px(refined: &Refined, detections: &[Detection], track: &Track) -> f64 {
    let Place::Plane { normal, .. } = refined.place else { return f64::INFINITY };
    let of_detection = |detection: &Detection| {
        let map = detection.reference_from_probe(track, refined.lag_s)?;
        let pixel_mm = steepness(&refined.plane, map.matrix3.transpose() * normal);
        let off = |px: &DVec2| refined.place.off_mm(map.transform_point3(refined.plane.point(*px))) / pixel_mm;
        Some(detection.marks.iter().map(off).fold(0.0, f64::max))
    };
    median(&mut detections.iter().filter_map(of_detection).collect::<Vec<_>>())
}
