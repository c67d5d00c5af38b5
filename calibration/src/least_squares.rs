//! Least squares: the parameters that explain measurements best, their covariance, and the
//! parameters that the measurements do not determine.
//!
//! A problem has two parts. One is a list of parameters with names, units and typical sizes
//! ([`Parameters`]). The other is a function that adds, for a state, every residual with its
//! derivatives and its noise ([`Blocks`]). [`solve`](solve()) does the rest: damped
//! Gauss–Newton, robust losses scaled by the residuals' own spread, covariance, condition
//! number and undetermined directions ([`Solution`]). Example: a point measured three times
//! well and once badly:
//!
//! ```
//! use calibration::least_squares::{
//!     Blocks, Loss, Parameters, Settings, State, Whitening, rows, solve,
//! };
//! use glam::{DMat3, DVec3};
//!
//! let measured = [
//!     DVec3::new(10.1, 0.0, 5.0),
//!     DVec3::new(9.9, 0.1, 5.0),
//!     DVec3::new(10.0, -0.1, 5.0),
//!     DVec3::new(60.0, 0.0, 5.0),
//! ];
//! let mut parameters = Parameters::new();
//! // Typical size in mm, and start value.
//! let point = parameters.point("the point", 10.0, DVec3::ZERO);
//! let noise = Whitening::sd(0.1);
//! let solution = solve(
//!     &parameters,
//!     &Settings::robust(Loss::Tukey),
//!     |state: &State, blocks: &mut Blocks<'_>| {
//!         for p in measured {
//!             let residual = state.point(point) - p;
//!             blocks.add(residual.to_array(), &noise).by(point, rows(DMat3::IDENTITY));
//!         }
//!     },
//! )
//! .unwrap();
//! assert!((solution.state.point(point) - DVec3::new(10.0, 0.0, 5.0)).length() < 0.01);
//! assert!(solution.weights[3] == 0.0); // the bad one
//! let sd_mm = solution.sds(point); // along x, y and z
//! # assert!(sd_mm[0] > 0.01 && sd_mm[0] < 1.0);
//! ```
//!
//! - [`parameters`]: blocks of parameters on their manifolds: points and other vectors are
//!   added to, scales multiplied, rotations turned from the left or the right.
//! - [`blocks`]: residuals, derivatives and noise. Every problem's tests compare the derivatives
//!   with finite differences.
//! - [`loss`]: quadratic, Huber, Cauchy, Tukey, for residuals of any number of components.
//! - [`solution`]: the result; [`certainty`]: covariances of results, and predicted ones with
//!   more measurements.
//!
//! # Numbers
//!
//! Residuals are whitened by their noise. Columns of the Jacobian are scaled by the parameters'
//! typical sizes, so that mm and rad compare. A step uses the singular values of the triangle
//! of a QR decomposition. Normal equations are never formed, because they would square the
//! condition number. All sums have a fixed order: the same input gives the same bits.

pub mod blocks;
pub mod certainty;
mod linear;
pub mod loss;
pub mod parameters;
pub mod solution;
mod solve;
#[cfg(test)]
pub(crate) mod tests;

pub use blocks::{Blocks, Residual, Whitening, rows, turned};
pub use certainty::Certainty;
pub use loss::Loss;
pub use parameters::{Parameters, Rotation, Scale, Side, State, Vector};
pub use solution::{Direction, Solution, Stopped};
pub use solve::{Noise, Settings, Unsolved, solve};
