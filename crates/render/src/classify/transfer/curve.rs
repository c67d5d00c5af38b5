//! Piecewise linear functions with values from 0 to 1.

pub use super::knots::{Knot, Piecewise};
use crate::real::{Number, Real};

/// Positions lie within ± this, so that no difference of two overflows in single precision.
const FARTHEST: f64 = 1e30;

/// A curve of one value.
pub type Curve = Piecewise<1>;

/// Reason why points are not a valid curve. The message has no subject: the caller names the
/// curve.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum CurveError {
    /// No points.
    #[error("holds no points: give at least one")]
    Empty,
    /// NaN, infinite, or larger than any intensity.
    #[error("stands at {position}, which must be a finite number within ±1e30")]
    Position {
        /// Index of the point, from 0.
        index: usize,
        /// Its position.
        position: f64,
    },
    /// Not to the right of the point before it.
    #[error(
        "stands at {position}, after a point at {before}: sort the points by their first number, each larger than the last (for a step, leave \
         a small distance)"
    )]
    Order {
        /// Index of the point, from 0.
        index: usize,
        /// Its position.
        position: f64,
        /// Position of the point before it.
        before: f64,
    },
    /// Outside 0 to 1.
    #[error("holds {value}: give values from 0 to 1")]
    Value {
        /// Index of the point, from 0.
        index: usize,
        /// Its value.
        value: f64,
    },
}

impl CurveError {
    /// Returns the index of the invalid point, from 0; `None` if there are no points.
    pub fn index(self) -> Option<usize> {
        match self {
            Self::Empty => None,
            Self::Position { index, .. } | Self::Order { index, .. } | Self::Value { index, .. } => Some(index),
        }
    }
}

impl<const N: usize> Piecewise<N> {
    /// Creates a function through points (position, values).
    ///
    /// # Errors
    /// [`CurveError`]: no points, positions that do not ascend (in f32 either) or are not
    /// finite, values outside 0 to 1.
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
            // The positions must differ in single precision, by enough that the slope does not
            // overflow.
            if position as f32 - (before as f32) < f32::MIN_POSITIVE {
                return Err(CurveError::Order { index: index + 1, position, before });
            }
        }
        let mut double: Vec<_> =
            points.iter().map(|&(position, values)| Knot { position, values, slopes: [0.0; N] }).collect();
        for (index, pair) in points.windows(2).enumerate() {
            let [(x0, y0), (x1, y1)] = [pair[0], pair[1]];
            double[index].slopes = std::array::from_fn(|channel| (y1[channel] - y0[channel]) / (x1 - x0));
        }
        let single = double
            .iter()
            .map(|knot| Knot {
                position: knot.position as f32,
                values: knot.values.map(|x| x as f32),
                slopes: knot.slopes.map(|x| x as f32),
            })
            .collect();
        Ok(Self { double, single })
    }

    /// Returns the values at `x`, exact at the points; those of the first point for NaN.
    #[inline(always)]
    pub fn at<T: Number>(&self, x: T) -> [T; N] {
        let knots = T::Scalar::knots(self);
        let (first, last) = (&knots[0], &knots[knots.len() - 1]);
        // Clamps `x`, so that beyond the ends the distance to the end point is 0.
        let x = x.max(T::splat(first.position)).min(T::splat(last.position));
        let mut position = T::splat(first.position);
        let (mut values, mut slopes) = ([T::zero(); N], [T::zero(); N]);
        for channel in 0..N {
            (values[channel], slopes[channel]) = (T::splat(first.values[channel]), T::splat(first.slopes[channel]));
        }
        for knot in &knots[1..] {
            let reached = T::splat(knot.position).le(x);
            if !T::any(reached) {
                break;
            }
            position = T::select(reached, T::splat(knot.position), position);
            for channel in 0..N {
                values[channel] = T::select(reached, T::splat(knot.values[channel]), values[channel]);
                slopes[channel] = T::select(reached, T::splat(knot.slopes[channel]), slopes[channel]);
            }
        }
        let along = x - position;
        for channel in 0..N {
            values[channel] = along.mul_add(slopes[channel], values[channel]).unit();
        }
        values
    }

    /// Returns the positions of the first and the last point.
    pub fn span(&self) -> [f64; 2] {
        [self.double[0].position, self.double[self.double.len() - 1].position]
    }

    /// Returns the points.
    pub fn points(&self) -> impl Iterator<Item = (f64, [f64; N])> {
        self.double.iter().map(|knot| (knot.position, knot.values))
    }

    /// Returns whether the values of each point are the same number.
    pub(super) fn channels_agree(&self) -> bool {
        self.double.iter().all(|knot| knot.values.iter().all(|value| *value == knot.values[0]))
    }
}

impl Curve {
    /// Creates a curve through points (position, value).
    ///
    /// # Errors
    /// [`CurveError`], in the same cases as [`Piecewise::through`].
    pub fn new(points: &[(f64, f64)]) -> Result<Self, CurveError> {
        Self::through(&points.iter().map(|&(position, value)| (position, [value])).collect::<Vec<_>>())
    }

    /// Returns the value at `x`.
    #[inline(always)]
    pub fn value<T: Number>(&self, x: T) -> T {
        let [value] = self.at(x);
        value
    }

    /// Returns the smallest interval outside of which the curve is 0, infinite on a side whose
    /// end value is positive; `None` if it is 0 everywhere.
    pub fn support(&self) -> Option<[f64; 2]> {
        let positive = |knot: &Knot<f64, 1>| knot.values[0] > 0.0;
        let first = self.double.iter().position(positive)?;
        let last = self.double.iter().rposition(positive)?;
        let low = if first == 0 { f64::NEG_INFINITY } else { self.double[first - 1].position };
        Some([low, self.double.get(last + 1).map_or(f64::INFINITY, |knot| knot.position)])
    }
}
