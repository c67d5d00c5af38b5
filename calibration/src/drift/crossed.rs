//! Sweeps that cross each other, and their lines.

use crate::crossings::state::State;
use crate::crossings::{Directions, LEAST_LINES, pairs};
use crate::error::{DriftError, Motion};
use crate::slices::Slices;
use crate::statistics::median;

/// Lines of two sweeps that link them.
const LEAST_OF_TWO: usize = 10;

/// Sweeps that cross each other, directly or by others between them.
pub(super) struct Crossed {
    pub(super) directions: Directions,
    /// The sweeps in the order of time. The first is held.
    pub(super) sweeps: Vec<usize>,
    /// Lines along which a motion of the others shows.
    pub(super) pairs: Vec<[usize; 2]>,
}

impl Crossed {
    pub(super) fn of(slices: &Slices, state: &State) -> Result<Self, DriftError> {
        let directions = Directions::of(slices, state);
        let all = pairs::chosen(slices, state);
        let motion = motion(&directions);
        let few =
            |lines: usize| DriftError::FewLines { lines, least: LEAST_LINES, directions: directions.count, motion };
        if all.len() < LEAST_LINES {
            return Err(few(all.len()));
        }
        let of_pair = |pair: &[usize; 2]| Some([directions.sweep[pair[0]]?, directions.sweep[pair[1]]?]);
        let count = directions.sweeps_s.len();
        let mut lines = vec![0; count * count];
        for [a, b] in all.iter().filter_map(of_pair) {
            lines[a * count + b] += 1;
            lines[b * count + a] += 1;
        }
        let is_linked = |a: usize, b: usize| a != b && lines[a * count + b] >= LEAST_OF_TWO;
        let held = (0..count).find(|a| (0..count).any(|b| is_linked(*a, b)));
        let held = held.ok_or(DriftError::FewSweeps { sweeps: count, motion })?;
        let mut sweeps = vec![held];
        let mut next = 0;
        while let Some(&from) = sweeps.get(next) {
            let more: Vec<usize> = (0..count).filter(|to| is_linked(from, *to) && !sweeps.contains(to)).collect();
            sweeps.extend(more);
            next += 1;
        }
        sweeps.sort_unstable();
        let shows = |pair: &[usize; 2]| {
            of_pair(pair).is_some_and(|of| of.iter().all(|sweep| sweeps.contains(sweep)) && of != [held; 2])
        };
        let pairs: Vec<[usize; 2]> = all.into_iter().filter(shows).collect();
        if pairs.len() < LEAST_LINES {
            return Err(few(pairs.len()));
        }
        Ok(Self { directions, sweeps, pairs })
    }

    /// Returns the sweep whose lines correlate least, with the median of their correlations.
    pub(super) fn worst(&self, correlations: &[Option<f64>]) -> Option<(usize, f64)> {
        let typical = |sweep: usize| {
            let touches = |pair: &[usize; 2]| pair.iter().any(|slice| self.directions.sweep[*slice] == Some(sweep));
            let own = self.pairs.iter().zip(correlations).filter(|(pair, _)| touches(pair));
            (sweep, median(&mut own.filter_map(|(_, correlation)| *correlation).collect::<Vec<f64>>()))
        };
        self.sweeps.iter().map(|sweep| typical(*sweep)).min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Returns the motion of the probe that would help most.
    pub(super) fn motion(&self) -> Motion {
        motion(&self.directions)
    }
}

fn motion(directions: &Directions) -> Motion {
    if directions.count < 2 { Motion::Turn } else { Motion::Tilt }
}
