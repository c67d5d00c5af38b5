//! Detects the moments when a tip rests.

use glam::DVec3;

use crate::least_squares::{Blocks, Loss, Parameters, Settings as Solver, State, Whitening, loss::spread, rows, solve};

/// Number of neighbours on each side for detecting jumps.
const NEIGHBOURS: usize = 2;
/// Longest gap in time within a rest, s.
const LONGEST_GAP_S: f64 = 1.0;

/// A place where the tip rested.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rest {
    /// Position, mm.
    pub at: DVec3,
    /// Indices of the first and the last reading, from 0.
    pub readings: [usize; 2],
    /// Start and end, s.
    pub time_s: [f64; 2],
    /// Standard deviation of the tip about the position, per axis, mm.
    pub spread_mm: f64,
}

/// Returns a tracker's noise at the tip, mm per axis, from the distances of readings from the
/// middle of their two neighbours. Motion contributes little to these, and the median ignores
/// jumps. `None` for fewer than three readings.
pub(crate) fn noise(positions: &[(f64, DVec3)]) -> Option<f64> {
    let bend = |three: &[(f64, DVec3)]| (3, (three[0].1 - 2.0 * three[1].1 + three[2].1).length());
    let bends: Vec<_> = positions.windows(3).map(bend).collect();
    // The second difference has 1 + 4 + 1 times the variance.
    (!bends.is_empty()).then(|| spread(&bends) / 6_f64.sqrt())
}

/// Finds the rests among readings (time in s, place in mm, in the order of time). A rest is a
/// stretch of at least `least_s` within `radius_mm` of its mean; of overlapping ones the
/// longest counts. Single readings that jump away and back are ignored like missing ones.
pub(crate) fn find(positions: &[(f64, DVec3)], radius_mm: f64, least_s: f64) -> Vec<Rest> {
    let steady: Vec<usize> = (0..positions.len()).filter(|&i| !jumps(positions, i, radius_mm)).collect();
    let at = |k: usize| positions[steady[k]];
    let mut stretches: Vec<[usize; 2]> = Vec::new();
    let (mut first, mut sum) = (0, DVec3::ZERO);
    for last in 0..steady.len() {
        if last > 0 && at(last).0 - at(last - 1).0 > LONGEST_GAP_S {
            (first, sum) = (last, DVec3::ZERO);
        }
        sum += at(last).1;
        while first < last {
            let middle = sum / (last - first + 1) as f64;
            if (first..=last).all(|k| at(k).1.distance(middle) <= radius_mm) {
                break;
            }
            sum -= at(first).1;
            first += 1;
        }
        if at(last).0 - at(first).0 >= least_s {
            match stretches.last_mut() {
                // The same stretch, one reading longer.
                Some([known, end]) if *known == first => *end = last,
                _ => stretches.push([first, last]),
            }
        }
    }
    // The longest first; shorter ones that overlap belong to the same rest.
    stretches.sort_by(|a, b| (at(b[1]).0 - at(b[0]).0).total_cmp(&(at(a[1]).0 - at(a[0]).0)).then(a[0].cmp(&b[0])));
    let mut chosen: Vec<[usize; 2]> = Vec::new();
    for stretch in stretches {
        if chosen.iter().all(|other| stretch[1] < other[0] || stretch[0] > other[1]) {
            chosen.push(stretch);
        }
    }
    chosen.sort_unstable();
    let rest = |[first, last]: [usize; 2]| {
        let places: Vec<DVec3> = (first..=last).map(|k| at(k).1).collect();
        let (middle, spread_mm) = middle(&places);
        Rest { at: middle, readings: [steady[first], steady[last]], time_s: [at(first).0, at(last).0], spread_mm }
    };
    chosen.into_iter().map(rest).collect()
}

/// Returns whether a reading lies more than a rest's width from the median of its
/// neighbourhood, by coordinates.
fn jumps(positions: &[(f64, DVec3)], index: usize, radius_mm: f64) -> bool {
    let around = index.saturating_sub(NEIGHBOURS)..(index + NEIGHBOURS + 1).min(positions.len());
    let middle = DVec3::from_array([0, 1, 2].map(|axis| {
        let mut sorted: Vec<f64> = positions[around.clone()].iter().map(|(_, p)| p[axis]).collect();
        sorted.sort_by(f64::total_cmp);
        sorted[sorted.len() / 2]
    }));
    positions[index].1.distance(middle) > 2.0 * radius_mm
}

/// Returns the place that most readings agree on (Tukey's loss), and the spread about it.
fn middle(places: &[DVec3]) -> (DVec3, f64) {
    let mean = places.iter().sum::<DVec3>() / places.len() as f64;
    let mut parameters = Parameters::new();
    let point = parameters.point("rest", 1.0, mean);
    let unit = Whitening::sd(1.0);
    let put = |state: &State, blocks: &mut Blocks<'_>| {
        for place in places {
            let residual = state.point(point) - *place;
            blocks.add(residual.to_array(), &unit).by(point, rows(glam::DMat3::IDENTITY));
        }
    };
    match solve(&parameters, &Solver::robust(Loss::Tukey), put) {
        Ok(solution) => (solution.state.point(point), solution.spread),
        // Too few readings for more.
        Err(_) => (mean, 0.0),
    }
}
