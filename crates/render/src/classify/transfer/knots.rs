//! The points of piecewise linear functions, in double and in single precision.

/// A piecewise linear function of one number, N values from 0 to 1. Beyond its first and last
/// point it keeps their values.
#[derive(Debug, Clone, PartialEq)]
pub struct Piecewise<const N: usize> {
    /// Ascending, also after rounding to f32; at least one.
    pub(super) double: Vec<Knot<f64, N>>,
    /// The same points, rounded.
    pub(super) single: Vec<Knot<f32, N>>,
}

/// A point of a curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Knot<S, const N: usize> {
    pub(super) position: S,
    /// At the position, 0 to 1.
    pub(super) values: [S; N],
    /// From here to the next point; 0 at the last.
    pub(super) slopes: [S; N],
}

impl<const N: usize> Piecewise<N> {
    /// Returns the points as given.
    pub(crate) fn double(&self) -> &[Knot<f64, N>] {
        &self.double
    }

    /// Returns the points in single precision.
    pub(crate) fn single(&self) -> &[Knot<f32, N>] {
        &self.single
    }
}
