//! Rigid motions of slices, on the image's side: linear in time between a sweep's knots.

use glam::DAffine3;
use nalgebra::DVector;

use super::crossed::Crossed;
use crate::crossings::state::rigid;
use crate::slices::Slices;

/// Numbers of a motion: along u, v and the normal, mm, and about these, rad.
pub(super) const NUMBERS: usize = 6;
/// Knots of a sweep whose poses drift: at its begin, its middle and its end.
pub(super) const PER_SWEEP: usize = 3;

/// A motion's six numbers.
pub(super) type Twist = [f64; NUMBERS];

/// Knots of sweeps that cross.
pub(super) struct Knots {
    pub(super) count: usize,
    /// Knots that move each slice, with their shares; none of a slice that is held.
    pub(super) shares: Vec<Vec<(usize, f64)>>,
}

impl Knots {
    /// Places some knots in each sweep, evenly, but for the first sweeps that are held.
    pub(super) fn of(slices: &Slices, crossed: &Crossed, per_sweep: usize, held: usize) -> Self {
        let share = |slice: usize| {
            let rank = crossed.sweeps.iter().position(|sweep| crossed.directions.sweep[slice] == Some(*sweep))?;
            let first = rank.checked_sub(held)? * per_sweep;
            let [from, to] = crossed.directions.sweeps_s[crossed.sweeps[rank]];
            let own = hats((slices.pixels[slice].0 - from) / (to - from), per_sweep);
            Some(own.into_iter().map(|(knot, share)| (first + knot, share)).collect())
        };
        let shares = (0..slices.pixels.len()).map(|slice| share(slice).unwrap_or_default()).collect();
        Self { count: (crossed.sweeps.len() - held) * per_sweep, shares }
    }

    /// Returns the motion of a slice, of the knots' numbers.
    pub(super) fn moved(&self, slice: usize, numbers: &DVector<f64>) -> DAffine3 {
        rigid(&between(&self.shares[slice], |knot| std::array::from_fn(|k| numbers[knot * NUMBERS + k])))
    }
}

/// Returns the shares of even knots at a time from 0 to 1; beyond, those of the end.
pub(super) fn hats(at: f64, knots: usize) -> Vec<(usize, f64)> {
    if knots < 2 {
        return vec![(0, 1.0)];
    }
    let place = at.clamp(0.0, 1.0) * (knots - 1) as f64;
    let before = (place as usize).min(knots - 2);
    let share = place - before as f64;
    vec![(before, 1.0 - share), (before + 1, share)]
}

/// Returns the numbers between knots.
pub(super) fn between(shares: &[(usize, f64)], of: impl Fn(usize) -> Twist) -> Twist {
    shares.iter().fold([0.0; NUMBERS], |sum, (knot, share)| {
        let numbers = of(*knot);
        std::array::from_fn(|k| sum[k] + share * numbers[k])
    })
}
