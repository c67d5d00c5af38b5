//! Frame grabbers: video in, frames of 8 bits per channel out.
//!
//! - [`pixels`]: conversion of video formats to frames, without a device.
//! - [`interlace`]: the time of each of a frame's lines.
//! - `timing`: whether a driver's stamps and numbers are reliable.
//! - `v4l2`: Linux's interface, and the choice from the offers.
//! - `list`: the available devices. [`device`]: an open grabber with recovery.
//!
//! | clock | tick | wrap | what a stamp marks |
//! |---|---|---|---|
//! | CLOCK_MONOTONIC, by the kernel; if a driver's stamps are of another clock, the time at which the frame was handed over, as the description reports | a frame (V4L2's sequence), lost ones included | 2³² | the end of the frame, or the start of its exposure (UVC: its first packet), as the driver reports; for fields see [`interlace`] |

pub mod device;
pub mod interlace;
mod list;
pub mod pixels;
mod settings;
#[cfg(test)]
mod tests;
mod timing;
pub(crate) mod v4l2;

pub use device::Grabber;
pub use interlace::Interlace;
pub use list::list;
pub use settings::{GrabberSettings, Standard};
