//! The Pareto front of time and error, and the default's position relative to it.

use crate::contestant::Match;
use crate::measure::Row;

/// Relative difference up to which times and errors count as equal: runs of one program differ
/// by as much.
pub(crate) const SLACK: f64 = 0.03;
/// A rival that gains no more than this is near.
pub(crate) const NEAR: f64 = 0.1;

/// Criterion of the comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Measure {
    /// Against the scene, for any width: the total error of the volume, blur and noise together.
    Anyone,
    /// The same among contestants of one width.
    Truth,
    /// Against the scene under the default's width: noise, sampling and arithmetic, without the
    /// intended blur.
    Blurred,
    /// The gradient of the latter.
    Slope,
}

impl Measure {
    pub(crate) const ALL: [Self; 4] = [Self::Blurred, Self::Slope, Self::Truth, Self::Anyone];

    pub(crate) fn of(self, row: &Row) -> f64 {
        match self {
            Self::Anyone | Self::Truth => row.score.truth.rmse,
            Self::Blurred => row.score.blurred.rmse,
            Self::Slope => row.score.slope,
        }
    }

    /// Returns whether a row is compared: with equal coverage, one thread, and the width that
    /// the criterion requires.
    pub(crate) fn compares(self, row: &Row) -> bool {
        let width = self == Self::Anyone || row.contestant.matching() == Match::Whole;
        row.comparable && row.contestant.threads == 1 && width
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Anyone => "truth, any width",
            Self::Truth => "truth",
            Self::Blurred => "blurred truth",
            Self::Slope => "gradient",
        }
    }
}

/// Returns the indices of the points that no other point equals or betters in both numbers, in
/// ascending order of the first.
pub(crate) fn front(points: &[[f64; 2]]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|a, b| points[*a][0].total_cmp(&points[*b][0]).then(points[*a][1].total_cmp(&points[*b][1])));
    let mut least = f64::INFINITY;
    order.retain(|i| {
        let better = points[*i][1] < least;
        least = least.min(points[*i][1]);
        better
    });
    order
}

/// A contestant that beats the default over one scan: not slower and not less accurate, and more
/// than [`SLACK`] better in one of them.
#[derive(Debug, Clone)]
pub(crate) struct Rival {
    pub(crate) name: String,
    /// Its time and its error relative to the default's.
    pub(crate) parts: [f64; 2],
}

impl Rival {
    /// Returns whether it gains little.
    pub(crate) fn is_near(&self) -> bool {
        self.parts[0].min(self.parts[1]) >= 1.0 - NEAR
    }
}

/// Returns all that beat the default (the first row), the one with the smallest product of
/// ratios first.
pub(crate) fn rivals(rows: &[&Row], measure: Measure) -> Vec<Rival> {
    let Some(default) = rows.iter().find(|row| row.contestant.is_default() && row.contestant.threads == 1) else {
        return Vec::new();
    };
    let mut rivals: Vec<Rival> = rows
        .iter()
        .filter(|row| measure.compares(row) && !row.contestant.is_default())
        .map(|row| Rival {
            name: row.contestant.name(),
            parts: [row.over_default[1], measure.of(row) / measure.of(default)],
        })
        .filter(|rival| beats(rival.parts))
        .collect();
    rivals.sort_by(|a, b| (a.parts[0] * a.parts[1]).total_cmp(&(b.parts[0] * b.parts[1])));
    rivals
}

fn beats([time, error]: [f64; 2]) -> bool {
    time <= 1.0 && error <= 1.0 && time.min(error) < 1.0 - SLACK
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn front_descends_and_other_points_are_dominated() {
        let points: Vec<[f64; 2]> =
            (0..200).map(f64::from).map(|i| [(i * 0.737).fract() + 0.01, (i * 0.317).fract() + 0.01]).collect();
        let front = front(&points);
        for pair in front.windows(2) {
            assert!(points[pair[0]][0] <= points[pair[1]][0] && points[pair[0]][1] > points[pair[1]][1]);
        }
        for (i, p) in points.iter().enumerate() {
            let beaten = points.iter().enumerate().any(|(j, q)| j != i && q[0] <= p[0] && q[1] <= p[1]);
            assert_eq!(beaten, !front.contains(&i), "{i}");
        }
    }

    #[test]
    fn equal_points_appear_once_on_front_and_nan_never() {
        assert_eq!(front(&[[1.0, 1.0], [1.0, 1.0], [2.0, f64::NAN]]).len(), 1);
    }

    #[test]
    fn rival_must_not_lose_and_must_gain_more_than_slack() {
        assert!(beats([0.9, 1.0]) && beats([1.0, 0.5]));
        assert!(!beats([0.98, 0.99]) && !beats([0.5, 1.01]) && !beats([f64::NAN, 0.5]) && !beats([0.5, f64::NAN]));
    }
}
