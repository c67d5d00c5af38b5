//! Latency of the tracker against the video.
//!
//! Both devices stamp their measurements by one clock, each with its own delay. `lag_s` is the
//! tracker's delay less the video's. Above 0 the tracker lags: a frame stamped t shows the pose
//! that the tracker has stamped t + lag.
//!
//! - [`line`](mod@line): detects the floor of a water tank in a frame, as a straight line.
//! - [`motion`]: the numbers of a tracker's poses that the line depends on.
//! - [`align`](mod@align): the lag at which the line follows the tracker best, with its
//!   standard error.
//! - [`stamps`]: times of measurements, by one of their stamps.
//! - [`floor`]: combines these, from lines and poses to the lag.
//! - [`crossings`]: the lag at which slices of any scan agree best along their intersections.

#![cfg_attr(test, allow(clippy::print_stdout, reason = "figures, for who asks with --nocapture"))]
#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "a comparison with NaN must refuse, not pass")]

pub mod align;
pub mod crossings;
pub mod floor;
pub mod line;
mod long_run;
pub mod motion;
mod robust;
pub mod stamps;
