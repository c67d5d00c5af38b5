//! Results of least squares.

use std::fmt;

use serde::Serialize;

use super::certainty::Certainty;
use super::parameters::{Block, Parameters, State};

/// Reasons why the iteration ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stopped {
    /// The step changed no component by more than 1e-11 of its typical size.
    Step,
    /// No step reduces the cost: rounding is reached.
    Cost,
    /// The limit of iterations; the state may be some way from the optimum.
    Iterations,
}

/// A combination of parameters, and its accuracy.
#[derive(Debug, Clone, PartialEq)]
pub struct Direction {
    /// Standard deviation along it, in typical sizes: for a point with a typical size of 100
    /// mm, 0.01 is 1 mm. Infinite if the data do not determine it.
    pub sd: f64,
    /// Its components: name, unit, and size in that unit.
    pub parts: Vec<(String, &'static str, f64)>,
    /// The same over typical sizes: a unit vector.
    shares: Vec<f64>,
    columns: Vec<Option<usize>>,
}

impl Direction {
    /// Returns its part in a block, over typical sizes: all blocks together make a unit vector.
    /// 0 for a fixed block.
    pub fn share<const K: usize>(&self, block: impl Block<K>) -> [f64; K] {
        match self.columns[block.place().block()] {
            Some(column) => std::array::from_fn(|k| self.shares[column + k]),
            None => [0.0; K],
        }
    }

    /// Returns the names of its main components, for people: those at least half as large as
    /// the largest.
    pub fn leading(&self) -> String {
        let most = self.shares.iter().fold(0.0_f64, |most, share| most.max(share.abs()));
        let named = self.shares.iter().zip(&self.parts).filter(|(share, _)| share.abs() >= 0.5 * most);
        named.map(|(_, (name, ..))| name.as_str()).collect::<Vec<_>>().join(" and ")
    }
}

impl fmt::Display for Direction {
    /// Writes its larger components, the largest first: `0.96·stylus tip z − 0.28·stylus tip
    /// x`. They are over typical sizes, with the sign that makes the first positive.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut named: Vec<(f64, &str)> =
            self.shares.iter().zip(&self.parts).map(|(share, (name, ..))| (*share, name.as_str())).collect();
        named.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
        let Some(&(first, _)) = named.first() else { return Ok(()) };
        for (i, (share, name)) in named.iter().filter(|(share, _)| share.abs() >= 0.1 * first.abs()).enumerate() {
            let share = share * first.signum();
            match (i, share < 0.0) {
                (0, _) => {}
                (_, true) => write!(f, " − ")?,
                (_, false) => write!(f, " + ")?,
            }
            write!(f, "{:.2}·{name}", share.abs())?;
        }
        Ok(())
    }
}

/// The state that explains the residuals best, and its covariance.
#[derive(Debug, Clone)]
pub struct Solution {
    /// The values.
    pub state: State,
    /// Sum over blocks of twice the loss, in the given standard deviations. For a quadratic
    /// loss it is the sum of squares of the whitened residuals.
    pub cost: f64,
    /// Number of steps taken or tried.
    pub iterations: u32,
    /// Reason why the iteration ended.
    pub stopped: Stopped,
    /// Standard deviation of the whitened residuals, from their sum of squares (quadratic loss)
    /// or their median (robust losses). About 1 if the whitening is right.
    pub spread: f64,
    /// Degrees of freedom: components of residuals less components of the step.
    pub freedom: usize,
    /// Largest over smallest singular value of the whitened, weighted Jacobian by typical sizes.
    pub condition: f64,
    /// Each block's whitened length, in the order in which they were added.
    pub lengths: Vec<f64>,
    /// Each block's weight by the loss: 1 for full weight, 0 for none.
    pub weights: Vec<f64>,
    pub(super) directions: Vec<Direction>,
    pub(super) certainty: Certainty,
}

impl Solution {
    /// Returns the joint covariance of the parameters.
    pub fn certainty(&self) -> &Certainty {
        &self.certainty
    }

    /// Returns the covariance of a block's step, in its unit squared (rad² for a rotation,
    /// relative for scales); 0 for a fixed block.
    pub fn covariance<const K: usize>(&self, block: impl Block<K>) -> [[f64; K]; K] {
        self.certainty.between(block, block)
    }

    /// Returns the standard deviations of a block's step.
    pub fn sds<const K: usize>(&self, block: impl Block<K>) -> [f64; K] {
        let covariance = self.covariance(block);
        std::array::from_fn(|i| covariance[i][i].sqrt())
    }

    /// Returns combinations of parameters, the least determined first; together they span a
    /// step.
    pub fn directions(&self) -> &[Direction] {
        &self.directions
    }
}

impl Direction {
    pub(super) fn new(parameters: &Parameters, columns: &[Option<usize>], shares: Vec<f64>, sd: f64) -> Self {
        let typical = parameters.typical();
        let parts = parameters.components().zip(shares.iter().zip(&typical));
        let parts = parts.map(|((name, unit), (share, typical))| (name.to_owned(), unit, share * typical)).collect();
        Self { sd, parts, shares, columns: columns.to_vec() }
    }
}
