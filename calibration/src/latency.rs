//! How late the tracker is against the video.
//!
//! Both stamp what they measure by one clock, each with a delay of its own. `lag_s` is the tracker's delay less the video's: above 0 the tracker lags, and what a frame
//! stamped t shows, the tracker has stamped t + lag.
//!
//! - [`line`](mod@line): the floor of a water tank in a picture, as a straight line.
//! - [`track`]: numbers between samples at uneven times.
//! - [`motion`]: what of a tracker's poses the line can follow.
//! - [`align`](mod@align): the lag at which the line follows the tracker best, and how sure that is.
//! - [`stamps`]: when something was measured, by which of its stamps.
//! - [`floor`]: all of these, from lines and poses to the lag.
//! - [`poses`]: where the probe was at any time.
//! - [`crossings`]: the lag at which slices of any scan agree best where they cross.

#![cfg_attr(test, allow(clippy::print_stdout, reason = "figures, for who asks with --nocapture"))]
#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "a comparison with NaN must refuse, not pass")]

pub mod align;
pub mod crossings;
pub mod floor;
pub mod line;
mod long_run;
pub mod motion;
pub mod poses;
mod robust;
pub mod stamps;
pub mod track;
