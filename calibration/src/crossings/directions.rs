//! Sweeps of a scan, and directions of their planes.

use glam::DVec3;

use super::state::State;
use crate::slices::Slices;

/// Cosine of the angle within which planes have one direction: 20°.
const ALIKE: f64 = 0.939_692_620_785_908_4;
/// Share of the slices that a direction has.
const LEAST_SHARE: f64 = 0.05;
/// Slices of a sweep.
const LEAST_SLICES: usize = 5;
/// Pause between two sweeps, s.
const PAUSE_S: f64 = 1.0;

/// Directions that determine a calibration.
pub const LEAST_DIRECTIONS: usize = 3;

/// Sweeps and directions.
#[derive(Debug, Clone, PartialEq)]
pub struct Directions {
    /// Number of directions with a twentieth of the slices or more, 20° apart.
    pub count: usize,
    /// First and last time of each sweep, s.
    pub sweeps_s: Vec<[f64; 2]>,
    /// The sweep of each slice; none of a slice between sweeps.
    pub(crate) sweep: Vec<Option<usize>>,
}

impl Slices {
    /// Returns the sweeps of the scan, and how many directions they have.
    pub fn directions(&self) -> Directions {
        Directions::of(self, &State::of(self))
    }
}

impl Directions {
    /// Returns the slices of each sweep, by time.
    pub(crate) fn runs(&self, slices: &Slices) -> Vec<Vec<usize>> {
        let mut runs = vec![Vec::new(); self.sweeps_s.len()];
        self.sweep.iter().enumerate().for_each(|(slice, sweep)| {
            if let Some(sweep) = sweep {
                runs[*sweep].push(slice);
            }
        });
        runs.iter_mut().for_each(|run| run.sort_by(|a, b| slices.pixels[*a].0.total_cmp(&slices.pixels[*b].0)));
        runs
    }

    pub(crate) fn of(slices: &Slices, state: &State) -> Self {
        let plane = |(slice, (time_s, _)): (usize, &(f64, Vec<u16>))| {
            (*time_s, state.world_from_picture(slices, slice).map(|pose| pose.matrix3.z_axis))
        };
        Self::of_planes(&slices.pixels.iter().enumerate().map(plane).collect::<Vec<_>>())
    }

    /// Finds the sweeps of planes, by the time, s, and the unit normal of each; none without a
    /// pose.
    pub fn of_planes(planes: &[(f64, Option<DVec3>)]) -> Self {
        let mut order: Vec<usize> = (0..planes.len()).collect();
        order.sort_by(|a, b| planes[*a].0.total_cmp(&planes[*b].0));
        // The sum of each direction's normals, and how many there are.
        let mut found: Vec<(DVec3, usize)> = Vec::new();
        let mut runs: Vec<(usize, Vec<usize>)> = Vec::new();
        let mut before_s = f64::NEG_INFINITY;
        for slice in order {
            let Some(normal) = planes[slice].1 else { continue };
            let along = |(sum, _): &(DVec3, usize)| sum.normalize().dot(normal);
            let nearest = (0..found.len()).max_by(|a, b| along(&found[*a]).abs().total_cmp(&along(&found[*b]).abs()));
            let direction = nearest.filter(|direction| along(&found[*direction]).abs() > ALIKE).unwrap_or(found.len());
            if direction == found.len() {
                found.push((DVec3::ZERO, 0));
            }
            let turned = if found[direction].0.dot(normal) < 0.0 { -normal } else { normal };
            found[direction].0 += turned;
            found[direction].1 += 1;
            let time_s = planes[slice].0;
            match runs.last_mut().filter(|(last, _)| *last == direction && time_s - before_s < PAUSE_S) {
                Some((_, run)) => run.push(slice),
                None => runs.push((direction, vec![slice])),
            }
            before_s = time_s;
        }
        let all: usize = found.iter().map(|(_, count)| count).sum();
        let many = |count: usize| count >= LEAST_SLICES && count as f64 >= LEAST_SHARE * all as f64;
        let count = found.iter().filter(|(_, count)| many(*count)).count();
        let mut sweep = vec![None; planes.len()];
        let sweeps =
            runs.into_iter().filter(|(_, run)| run.len() >= LEAST_SLICES).enumerate().map(|(number, (_, run))| {
                run.iter().for_each(|slice| sweep[*slice] = Some(number));
                [run[0], run[run.len() - 1]].map(|slice| planes[slice].0)
            });
        let sweeps_s = sweeps.collect();
        Self { count, sweeps_s, sweep }
    }
}
