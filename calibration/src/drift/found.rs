//! The drift of a scan's poses, and reasons not to correct it.

use glam::{DAffine3, DVec3};

use super::fitted::Fitted;
use super::knots::{NUMBERS, PER_SWEEP, Twist, between, hats};
use crate::crossings::state::rigid;
use crate::error::DriftError;
use crate::slices::Slices;

/// Displacement of the image that is worth a correction, mm, and in its standard errors. The
/// jackknife takes these for about twice as large as they are: a stretch is much of what
/// determines a knot.
const DRIFTED_MM: f64 = 0.3;
const DRIFTED_ERRORS: f64 = 1.0;
/// Largest corrections: mm and degrees. Beyond, the body has moved.
const MOST_MM: f64 = 3.0;
const MOST_DEG: f64 = 3.0;

/// Slow drift of a scan's poses.
///
/// A drift that all sweeps share is not in it: the first sweep is held.
#[derive(Debug, Clone, PartialEq)]
pub struct Drift {
    /// The sweeps that cross, in the order of time. The first is held.
    pub sweeps: Vec<SweepDrift>,
    /// Rigid: from mm of the image, about its middle, to the probe.
    pub probe_from_picture: DAffine3,
    /// Number of compared lines.
    pub lines: usize,
    /// Medians of the correlations along the lines, before and after.
    pub correlations: [f64; 2],
    /// Displacement of the image by the correction, root mean square of nine points over the slices
    /// of the sweeps that are not held, mm.
    pub shift_mm: f64,
    /// Its standard error, mm.
    pub shift_se_mm: f64,
    /// Largest displacement of a point, mm.
    pub largest_mm: f64,
    /// Largest turn, degrees.
    pub largest_deg: f64,
}

/// Corrections of a sweep's poses.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepDrift {
    /// Times of the first and the last slice, s.
    pub span_s: [f64; 2],
    /// Mean time from slice to slice, s. So far beyond its ends a correction of the sweep holds.
    pub gap_s: f64,
    /// Motions of the image in its own frame at the begin, the middle and the end of the span:
    /// along u, v and the normal, mm, and about these through the image's middle, rad. Between
    /// them each number is linear in time.
    pub knots: [[f64; 6]; PER_SWEEP],
}

impl SweepDrift {
    /// Returns the time by which a time is beyond the sweep, s; 0 within.
    fn beyond_s(&self, time_s: f64) -> f64 {
        (self.span_s[0] - time_s).max(time_s - self.span_s[1]).max(0.0)
    }

    fn at(&self, time_s: f64) -> Twist {
        let [from, to] = self.span_s;
        between(&hats((time_s - from) / (to - from), PER_SWEEP), |knot| self.knots[knot])
    }
}

impl Drift {
    pub(super) fn of(slices: &Slices, fitted: &Fitted) -> Self {
        let Fitted { crossed, numbers, .. } = fitted;
        let knot = |knot: usize| -> Twist { std::array::from_fn(|k| numbers[knot * NUMBERS + k]) };
        let sweep = |(rank, sweep): (usize, &usize)| {
            let span_s = crossed.directions.sweeps_s[*sweep];
            let count = crossed.directions.sweep.iter().filter(|of| **of == Some(*sweep)).count();
            let first = rank.checked_sub(1).map(|rank| rank * PER_SWEEP);
            SweepDrift {
                span_s,
                gap_s: (span_s[1] - span_s[0]) / (count - 1) as f64,
                knots: std::array::from_fn(|k| first.map_or([0.0; NUMBERS], |first| knot(first + k))),
            }
        };
        let [shift_mm, shift_se_mm] = shift(fitted);
        let points = &fitted.points;
        let moved = |by: &DAffine3| points.map(|p| by.transform_point3(p).distance(p)).into_iter().fold(0.0, f64::max);
        let motions: Vec<DAffine3> = (0..slices.pixels.len()).map(|slice| fitted.knots.moved(slice, numbers)).collect();
        let turns = numbers.as_slice().chunks_exact(NUMBERS).map(|of| DVec3::new(of[3], of[4], of[5]).length());
        Self {
            sweeps: crossed.sweeps.iter().enumerate().map(sweep).collect(),
            probe_from_picture: fitted.probe_from_picture,
            lines: crossed.pairs.len(),
            correlations: fitted.correlations,
            shift_mm,
            shift_se_mm,
            largest_mm: motions.iter().map(moved).fold(0.0, f64::max),
            largest_deg: turns.fold(0.0, f64::max).to_degrees(),
        }
    }

    /// Returns the correction of the probe's pose at a time in s, as the slices' times are: rigid,
    /// in the probe's frame, mm. It multiplies the pose on its right: world from probe by the
    /// tracker, times the correction. Poses of the held sweep keep their place. There is none
    /// between sweeps, nor for sweeps that cross no other.
    pub fn at(&self, time_s: f64) -> Option<DAffine3> {
        let beyond = |sweep: &&SweepDrift| sweep.beyond_s(time_s);
        let sweep = self.sweeps.iter().min_by(|a, b| beyond(a).total_cmp(&beyond(b)))?;
        let is_in = time_s.is_finite() && beyond(&sweep) <= sweep.gap_s;
        is_in.then(|| self.probe_from_picture * rigid(&sweep.at(time_s)) * self.probe_from_picture.inverse())
    }

    /// Returns a frame's pose corrected at its time, s, from the one by the tracker and the
    /// calibration in use; none where [`Drift::at`] has none.
    pub fn corrected(&self, time_s: f64, world_from_image: DAffine3, probe_from_image: DAffine3) -> Option<DAffine3> {
        Some(world_from_image * probe_from_image.inverse() * self.at(time_s)? * probe_from_image)
    }

    /// Returns the reason not to correct the poses, if there is one.
    pub(super) fn unfit(&self) -> Option<DriftError> {
        let Self { shift_mm, shift_se_mm: se_mm, largest_mm, largest_deg, correlations: [before, after], .. } = *self;
        let large = [(largest_mm, MOST_MM, "mm"), (largest_deg, MOST_DEG, "degrees")];
        if let Some((by, most, unit)) = large.into_iter().find(|(by, most, _)| !(by <= most)) {
            return Some(DriftError::Large { by, most, unit });
        }
        if !(shift_mm > DRIFTED_MM && shift_mm > DRIFTED_ERRORS * se_mm) {
            return Some(DriftError::Nothing { shift_mm, se_mm });
        }
        (!(after > before)).then_some(DriftError::NoBetter { before, after })
    }
}

/// Returns the root mean square of the image's displacement over the moved slices, mm, and its
/// standard error.
fn shift(fitted: &Fitted) -> [f64; 2] {
    let gram = fitted.gram();
    let mut moved: Vec<&[(usize, f64)]> =
        fitted.knots.shares.iter().map(Vec::as_slice).filter(|shares| !shares.is_empty()).collect();
    // In the order of time, so that the sums do not depend on the slices' order in memory.
    moved.sort_by(|a, b| a[0].0.cmp(&b[0].0).then(b[0].1.total_cmp(&a[0].1)));
    let (mut squares, mut variances) = (0.0, 0.0);
    for (i, of_i) in moved.iter().flat_map(|shares| shares.iter().map(|share| (share, *shares))) {
        for j in of_i {
            let by = i.1 * j.1;
            let [first, second] = [i.0, j.0].map(|knot| fitted.numbers.fixed_rows::<NUMBERS>(knot * NUMBERS));
            squares += by * first.dot(&(gram * second));
            let block = fitted.covariance.fixed_view::<NUMBERS, NUMBERS>(i.0 * NUMBERS, j.0 * NUMBERS);
            variances += by * (gram * block).trace();
        }
    }
    [squares, variances].map(|sum| (sum / moved.len() as f64).sqrt())
}
