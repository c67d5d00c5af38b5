//! Interpolates numbers between uneven samples by natural cubic splines, interrupted at long
//! gaps.

use crate::error::LatencyError;

/// N numbers as functions of time.
#[derive(Debug, Clone)]
pub struct Spline<const N: usize> {
    pieces: Vec<Piece<N>>,
    repeated: usize,
}

/// Samples without a gap, at rising times, with the spline's second derivatives there.
#[derive(Debug, Clone)]
struct Piece<const N: usize> {
    times: Vec<f64>,
    values: Vec<[f64; N]>,
    bends: Vec<[f64; N]>,
}

impl<const N: usize> Spline<N> {
    /// Interpolates samples (s, values) in any order; of several at one time the last counts.
    /// Samples farther apart than `longest_gap_s` are not interpolated.
    ///
    /// # Errors
    /// [`LatencyError`] for a sample with NaN or infinity.
    pub fn new(mut samples: Vec<(f64, [f64; N])>, longest_gap_s: f64) -> Result<Self, LatencyError> {
        let is_finite = |(time, values): &(f64, [f64; N])| time.is_finite() && values.iter().all(|x| x.is_finite());
        if let Some(index) = samples.iter().position(|sample| !is_finite(sample)) {
            return Err(LatencyError::NotFinite { index });
        }
        samples.sort_by(|a, b| a.0.total_cmp(&b.0));
        let all = samples.len();
        // The sort is stable, so the last of equal times is the last given.
        samples.reverse();
        samples.dedup_by(|earlier, later| earlier.0 == later.0);
        samples.reverse();
        let pieces = samples.chunk_by(|a, b| b.0 - a.0 <= longest_gap_s).filter(|piece| piece.len() > 1);
        Ok(Self { pieces: pieces.map(Piece::new).collect(), repeated: all - samples.len() })
    }

    /// Returns the number of samples dropped because another had the same time.
    pub fn repeated(&self) -> usize {
        self.repeated
    }

    /// Returns the number of samples in interpolated pieces.
    pub fn len(&self) -> usize {
        self.pieces.iter().map(|piece| piece.times.len()).sum()
    }

    /// Returns whether there are no interpolated pieces.
    pub fn is_empty(&self) -> bool {
        self.pieces.is_empty()
    }

    /// Returns the first and last time, s.
    pub fn span_s(&self) -> Option<[f64; 2]> {
        Some([*self.pieces.first()?.times.first()?, *self.pieces.last()?.times.last()?])
    }

    /// Returns the values and their change per second; `None` outside the pieces.
    pub fn at(&self, time_s: f64) -> Option<([f64; N], [f64; N])> {
        let after = self.pieces.partition_point(|piece| piece.times[0] <= time_s);
        let piece = self.pieces.get(after.checked_sub(1)?)?;
        (time_s <= piece.times[piece.times.len() - 1]).then(|| piece.at(time_s))
    }

    /// Returns the samples, in the order of their times.
    pub fn samples(&self) -> impl Iterator<Item = (f64, &[f64; N])> {
        self.pieces.iter().flat_map(|piece| piece.times.iter().copied().zip(&piece.values))
    }

    /// Returns the noise of each number's samples: a robust deviation from the straight line
    /// between their neighbours.
    pub fn noise(&self) -> [f64; N] {
        std::array::from_fn(|k| {
            let mut left: Vec<f64> = self.pieces.iter().flat_map(|piece| piece.second_differences(k)).collect();
            crate::statistics::deviation_about_zero(&mut left)
        })
    }
}

impl<const N: usize> Piece<N> {
    /// Fits a spline to at least two samples at rising times.
    fn new(samples: &[(f64, [f64; N])]) -> Self {
        let (times, values): (Vec<f64>, Vec<[f64; N]>) = samples.iter().copied().unzip();
        let n = times.len();
        let mut bends = vec![[0.0; N]; n];
        // Solves the tridiagonal system of the second derivatives, which are 0 at the ends.
        // Elimination needs no pivots, because the matrix is diagonally dominant.
        let mut above = vec![0.0; n];
        for i in 1..n - 1 {
            let (left, right) = (times[i] - times[i - 1], times[i + 1] - times[i]);
            let pivot = 2.0 * (left + right) - left * above[i - 1];
            above[i] = right / pivot;
            for k in 0..N {
                let turn = (values[i + 1][k] - values[i][k]) / right - (values[i][k] - values[i - 1][k]) / left;
                bends[i][k] = (6.0 * turn - left * bends[i - 1][k]) / pivot;
            }
        }
        for i in (1..n - 1).rev() {
            let next = bends[i + 1];
            bends[i].iter_mut().zip(next).for_each(|(bend, next)| *bend -= above[i] * next);
        }
        Self { times, values, bends }
    }

    /// Evaluates within the first and the last time.
    fn at(&self, time_s: f64) -> ([f64; N], [f64; N]) {
        let i = self.times.partition_point(|t| *t <= time_s).clamp(1, self.times.len() - 1);
        let step = self.times[i] - self.times[i - 1];
        let (a, b) = ((self.times[i] - time_s) / step, (time_s - self.times[i - 1]) / step);
        let each = |k: usize| {
            let ([from, to], [left, right]) =
                ([self.values[i - 1][k], self.values[i][k]], [self.bends[i - 1][k], self.bends[i][k]]);
            let square = step * step / 6.0;
            let value = a * from + b * to + ((a * a * a - a) * left + (b * b * b - b) * right) * square;
            let slope = (to - from) / step + ((3.0 * b * b - 1.0) * right - (3.0 * a * a - 1.0) * left) * step / 6.0;
            (value, slope)
        };
        (std::array::from_fn(|k| each(k).0), std::array::from_fn(|k| each(k).1))
    }

    /// Returns each sample's deviation from the straight line of its neighbours, scaled to the
    /// standard deviation of independent noise.
    fn second_differences(&self, k: usize) -> impl Iterator<Item = f64> {
        (1..self.times.len() - 1).map(move |i| {
            let [before, at, after] = [i - 1, i, i + 1].map(|i| self.times[i]);
            let share = (at - before) / (after - before);
            let line = (1.0 - share) * self.values[i - 1][k] + share * self.values[i + 1][k];
            (self.values[i][k] - line) / (1.0 + share * share + (1.0 - share) * (1.0 - share)).sqrt()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn uneven(n: i32) -> Vec<f64> {
        (0..n).map(|i| 0.1 * f64::from(i) + 0.03 * (f64::from(i) * 1.7).sin()).collect()
    }

    #[test]
    fn lines_are_exact_and_curves_followed_with_slope() {
        let samples = uneven(60).into_iter().map(|t| (t, [3.0 - 2.0 * t, (2.0 * t).sin()])).collect();
        let track = Spline::new(samples, 1.0).unwrap();
        for at in (0..400).map(|i| 0.5 + 0.01 * f64::from(i)) {
            let ([line, wave], [slope, change]) = track.at(at).unwrap();
            assert!((line - (3.0 - 2.0 * at)).abs() < 1e-12 && (slope + 2.0).abs() < 1e-10);
            assert!((wave - (2.0 * at).sin()).abs() < 2e-4 && (change - 2.0 * (2.0 * at).cos()).abs() < 1e-2, "{at}");
            // The slope must be the derivative of the interpolated curve itself.
            let step = 1e-6;
            let by_difference = (track.at(at + step).unwrap().0[1] - track.at(at - step).unwrap().0[1]) / (2.0 * step);
            assert!((change - by_difference).abs() < 1e-6);
        }
    }

    #[test]
    fn gaps_and_ends_are_not_interpolated() {
        let samples = [0.0, 0.1, 0.2, 0.9, 1.0, 3.0].map(|t| (t, [t])).to_vec();
        let track = Spline::new(samples, 0.5).unwrap();
        for (at, is_known) in [
            (-0.01, false),
            (0.0, true),
            (0.2, true),
            (0.3, false),
            (0.9, true),
            (1.0, true),
            (2.0, false),
            (3.0, false),
        ] {
            assert_eq!(track.at(at).is_some(), is_known, "{at}");
        }
        assert_eq!((track.len(), track.span_s()), (5, Some([0.0, 1.0])));
    }

    #[test]
    fn order_is_free_and_last_of_equal_times_counts() {
        let track = Spline::new(vec![(1.0, [5.0]), (0.0, [1.0]), (1.0, [2.0]), (2.0, [3.0])], 9.0).unwrap();
        assert_eq!(track.samples().map(|(t, [x])| (t, *x)).collect::<Vec<_>>(), [(0.0, 1.0), (1.0, 2.0), (2.0, 3.0)]);
        assert_eq!(track.repeated(), 1);
        assert_eq!(Spline::new(vec![(0.0, [f64::NAN])], 1.0).unwrap_err(), LatencyError::NotFinite { index: 0 });
    }

    #[test]
    fn noise_is_found_beside_motion() {
        let mut random = crate::tests::noise::Noise::new(3);
        let samples = uneven(2000).into_iter().map(|t| (t, [20.0 * (0.5 * t).sin() + 0.2 * random.normal()]));
        let [noise] = Spline::new(samples.collect(), 1.0).unwrap().noise();
        assert!((noise - 0.2).abs() < 0.02, "{noise}");
    }
}
