//! Frames that do not show one moment: they repeat, or the scanner averages them.

use std::ops::RangeInclusive;

use super::reference::{Placed, Reference};
use super::window::{Picture, Windows};
use crate::error::PressureError;
use crate::slices::Slices;
use crate::statistics::median;

/// Share of frames that may repeat the one before.
const MOST_REPEATS: f64 = 0.05;
/// Pairs of neighbours that are compared at most, and those that are needed.
const MOST_PAIRS: usize = 36;
const LEAST_PAIRS: usize = 12;
/// Distance of frames that do not rest on one place, in the limit of near planes.
const MOVING: f64 = 0.25;
/// Ratio of distances from which on correlations are compared.
const FURTHER: f64 = 1.5;
/// Correlations of far neighbours between which persistence shows: below, speckle has changed
/// anyway; above, it has hardly changed.
const ALIKE: RangeInclusive<f64> = 0.5..=0.92;
/// Loss of correlation by that of near neighbours. Without persistence, it rises by the square of
/// the distance at first.
const LEAST_LOSS: f64 = 1.5;

/// Refuses scans whose frames repeat. The runs are slices of sweeps, by time.
pub(super) fn repeats(slices: &Slices, runs: &[Vec<usize>]) -> Result<(), PressureError> {
    let same = |pair: &&[usize]| slices.pixels[pair[0]].1 == slices.pixels[pair[1]].1;
    let frames = runs.iter().flat_map(|run| run.windows(2)).filter(same).count();
    let all = runs.iter().map(Vec::len).sum();
    if frames as f64 > MOST_REPEATS * all as f64 { Err(PressureError::Repeats { frames, all }) } else { Ok(()) }
}

/// Refuses scans whose frames resemble the ones before by time, not by distance. Sweeps at even
/// speed do not tell, and pass.
pub(super) fn persistence(
    slices: &Slices,
    windows: &Windows,
    placed: &[Option<Placed>],
    runs: &[Vec<usize>],
    limit_mm: f64,
) -> Result<(), PressureError> {
    let pairs: Vec<[usize; 2]> = runs.iter().flat_map(|run| run.windows(2)).map(|pair| [pair[0], pair[1]]).collect();
    let every = pairs.len().div_ceil(MOST_PAIRS).max(1);
    let compared = |pair: &[usize; 2]| {
        let [one, other] = [placed[pair[0]]?, placed[pair[1]]?];
        let reference = Reference::new(slices, vec![other], f64::INFINITY);
        let distance = reference.distance_mm(&one);
        if !(distance.is_finite() && distance >= MOVING * limit_mm) {
            return None;
        }
        let seen = Picture::new(&reference.seen_from(&one));
        Some((distance, windows.alike(&seen, &Picture::of(slices, pair[0]))?))
    };
    let mut found: Vec<(f64, f64)> = pairs.iter().step_by(every).filter_map(compared).collect();
    if found.len() < LEAST_PAIRS {
        return Ok(());
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let third = found.len() / 3;
    let medians = |part: &[(f64, f64)]| {
        let [mut distances, mut alike]: [Vec<f64>; 2] =
            [part.iter().map(|p| p.0).collect(), part.iter().map(|p| p.1).collect()];
        (median(&mut distances), median(&mut alike))
    };
    let [(near_mm, near), (far_mm, far)] = [medians(&found[..third]), medians(&found[found.len() - third..])];
    let tells = far_mm >= FURTHER * near_mm && ALIKE.contains(&far);
    let falls = 1.0 - far >= LEAST_LOSS * (1.0 - near);
    if tells && !falls { Err(PressureError::Persistence { near_mm, near, far_mm, far }) } else { Ok(()) }
}
