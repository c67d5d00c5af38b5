//! Piecewise linear functions with values from 0 to 1.

use super::super::real::Real;

/// Positions lie within ± this, so that no difference of two overflows in single precision.
const FARTHEST: f64 = 1e30;

/// A piecewise linear function of one number with N values from 0 to 1. Beyond its first and last point it holds their values.
#[derive(Debug, Clone, PartialEq)]
pub struct Piecewise<const N: usize> {
    /// Ascending, also after rounding to f32; at least one.
    positions: Vec<f64>,
    /// At the positions, 0 to 1.
    values: Vec<[f64; N]>,
    /// From each position to the next; none behind the last.
    slopes: Vec<[f64; N]>,
}

/// One value.
pub type Curve = Piecewise<1>;

/// Why points make no curve. The display has no beginning: the caller says of which curve.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum CurveError {
    /// No points.
    #[error("holds no points: give at least one")]
    Empty,
    /// NaN, infinite, or larger than any intensity.
    #[error("stands at {position}, which is no finite number within ±1e30")]
    Position {
        /// Which point, from 0.
        index: usize,
        /// Where it stands.
        position: f64,
    },
    /// Not to the right of the point before it.
    #[error(
        "stands at {position}, after a point at {before}: sort the points by their first number, each larger than the last (for a step, leave \
         a small distance)"
    )]
    Order {
        /// Which point, from 0.
        index: usize,
        /// Where it stands.
        position: f64,
        /// Where the point before it stands.
        before: f64,
    },
    /// Outside 0 to 1.
    #[error("holds {value}: give values from 0 to 1")]
    Value {
        /// Which point, from 0.
        index: usize,
        /// What it holds.
        value: f64,
    },
}

impl CurveError {
    /// Which point is meant, from 0; none where there are no points.
    pub fn index(self) -> Option<usize> {
        match self {
            Self::Empty => None,
            Self::Position { index, .. } | Self::Order { index, .. } | Self::Value { index, .. } => Some(index),
        }
    }
}

impl<const N: usize> Piecewise<N> {
    /// A function through points (position, values).
    ///
    /// # Errors
    /// [`CurveError`]: no points, positions that do not ascend (in f32 either) or are not finite, values outside 0 to 1.
    pub fn through(points: &[(f64, [f64; N])]) -> Result<Self, CurveError> {
        if points.is_empty() {
            return Err(CurveError::Empty);
        }
        for (index, &(position, values)) in points.iter().enumerate() {
            if position.is_nan() || position.abs() > FARTHEST {
                return Err(CurveError::Position { index, position });
            }
            if let Some(&value) = values.iter().find(|value| !(0.0..=1.0).contains(*value)) {
                return Err(CurveError::Value { index, value });
            }
        }
        for (index, pair) in points.windows(2).enumerate() {
            let (before, position) = (pair[0].0, pair[1].0);
            // Single precision must tell them apart, by so much that the slope does not overflow.
            if position as f32 - (before as f32) < f32::MIN_POSITIVE {
                return Err(CurveError::Order { index: index + 1, position, before });
            }
        }
        let slope = |(x0, y0): (f64, [f64; N]), (x1, y1): (f64, [f64; N])| {
            std::array::from_fn(|channel| (y1[channel] - y0[channel]) / (x1 - x0))
        };
        Ok(Self {
            positions: points.iter().map(|point| point.0).collect(),
            values: points.iter().map(|point| point.1).collect(),
            slopes: points.windows(2).map(|pair| slope(pair[0], pair[1])).collect(),
        })
    }

    /// The values at `x`, exact at the points; those of the first point where `x` is not a number.
    #[inline]
    pub fn at<T: Real>(&self, x: T) -> [T; N] {
        let behind = self.positions.partition_point(|&position| T::from_f64(position) <= x);
        let segment = behind.saturating_sub(1);
        let start = self.values[segment].map(T::from_f64);
        // Before the first point, and from the last on.
        if behind == 0 || behind == self.positions.len() {
            return start;
        }
        let along = x - T::from_f64(self.positions[segment]);
        let slope = &self.slopes[segment];
        std::array::from_fn(|channel| (start[channel] + along * T::from_f64(slope[channel])).unit())
    }

    /// Where the first point and the last one stand.
    pub fn span(&self) -> [f64; 2] {
        [self.positions[0], self.positions[self.positions.len() - 1]]
    }

    /// The points.
    pub fn points(&self) -> impl Iterator<Item = (f64, [f64; N])> {
        self.positions.iter().copied().zip(self.values.iter().copied())
    }

    /// Whether the values of each point are the same number.
    pub(super) fn channels_agree(&self) -> bool {
        self.values.iter().all(|values| values.iter().all(|value| *value == values[0]))
    }
}

impl Curve {
    /// A curve through points (position, value).
    ///
    /// # Errors
    /// [`CurveError`], as for [`Piecewise::through`].
    pub fn new(points: &[(f64, f64)]) -> Result<Self, CurveError> {
        Self::through(&points.iter().map(|&(position, value)| (position, [value])).collect::<Vec<_>>())
    }

    /// The value at `x`.
    #[inline]
    pub fn value<T: Real>(&self, x: T) -> T {
        let [value] = self.at(x);
        value
    }

    /// The smallest interval outside of which the curve is 0, infinite where an end holds more; none where it is 0 everywhere.
    pub fn support(&self) -> Option<[f64; 2]> {
        let positive = |value: &[f64; 1]| value[0] > 0.0;
        let first = self.values.iter().position(positive)?;
        let last = self.values.iter().rposition(positive)?;
        let low = if first == 0 { f64::NEG_INFINITY } else { self.positions[first - 1] };
        Some([low, self.positions.get(last + 1).copied().unwrap_or(f64::INFINITY)])
    }
}
