//! Least squares: what numbers explain measurements best, how sure they are, and what the measurements do not say at all.
//!
//! A problem is a list of parameters with names, units and typical sizes ([`Parameters`]), and a function that puts down, for a state of theirs, every residual with
//! its derivatives and its noise ([`Blocks`]). [`solve`](solve()) does the rest: damped Gauss–Newton, robust losses with a scale from the residuals' own spread, covariance, condition
//! and undetermined directions ([`Solution`]). A point that was measured three times, and once badly:
//!
//! ```
//! use calibration::least_squares::{Blocks, Loss, Parameters, Settings, State, Whitening, rows, solve};
//! use glam::{DMat3, DVec3};
//!
//! let measured = [DVec3::new(10.1, 0.0, 5.0), DVec3::new(9.9, 0.1, 5.0), DVec3::new(10.0, -0.1, 5.0), DVec3::new(60.0, 0.0, 5.0)];
//! let mut parameters = Parameters::new();
//! let point = parameters.point("the point", 10.0, DVec3::ZERO); // typical size in mm, and where to begin
//! let noise = Whitening::sd(0.1);
//! let solution = solve(&parameters, &Settings::robust(Loss::Tukey), |state: &State, blocks: &mut Blocks<'_>| {
//!     for p in measured {
//!         let residual = state.point(point) - p;
//!         blocks.add(residual.to_array(), &noise).by(point, rows(DMat3::IDENTITY));
//!     }
//! })
//! .unwrap();
//! assert!((solution.state.point(point) - DVec3::new(10.0, 0.0, 5.0)).length() < 0.01);
//! assert!(solution.weights[3] == 0.0); // the bad one
//! let sd_mm = solution.sds(point); // along x, y and z
//! # assert!(sd_mm[0] > 0.01 && sd_mm[0] < 1.0);
//! ```
//!
//! - [`parameters`]: blocks of parameters on their manifolds: points and other vectors are added to, scales multiplied, rotations turned from the left or the right.
//! - [`blocks`]: residuals, derivatives and noise. [`check_jacobian`] holds the derivatives against finite differences; every problem's tests call it.
//! - [`loss`]: quadratic, Huber, Cauchy, Tukey, for residuals of any number of components.
//! - [`solution`]: what comes out; [`certainty`]: how sure it is, and how sure it would be with more.
//!
//! # Numbers
//!
//! Residuals are whitened by their noise. Columns of the Jacobian are scaled by the parameters' typical sizes, so that mm and rad compare. A step is found from the singular values of
//! the triangle of a QR decomposition, never from normal equations, which would square the condition number. All sums have a fixed order: the same input gives the same bits.

pub mod blocks;
pub mod certainty;
mod check;
mod linear;
pub mod loss;
pub mod parameters;
pub mod solution;
mod solve;
#[cfg(test)]
mod tests;

pub use blocks::{Blocks, Residual, Whitening, rows, turned};
pub use certainty::Certainty;
pub use check::{JacobianCheck, check_jacobian};
pub use loss::Loss;
pub use parameters::{Parameters, Rotation, Scale, Side, State, Vector};
pub use solution::{Direction, Solution, Stopped};
pub use solve::{Noise, Settings, Unsolved, solve};
