//! Frame grabbers: video in, pictures of 8 bits out.
//!
//! - [`pixels`]: formats of video to pictures, without a device.
//! - [`interlace`]: which of a frame's lines were seen when.
//! - `timing`: whether a driver's stamps and numbers are to be believed.
//! - `v4l2`: Linux's interface, and what to ask for of what is offered.
//! - `list`: what is there. [`device`]: a grabber that is kept going.
//!
//! | clock | tick | wrap | what a stamp marks |
//! |---|---|---|---|
//! | CLOCK_MONOTONIC, by the kernel; where a driver's stamps are of another clock, the time at which the frame was handed over, and the description says so | a frame (V4L2's sequence), lost ones included | 2³² | the end of the frame, or the start of its exposure (UVC: its first packet), as the driver says; of fields see [`interlace`] |

pub mod device;
pub mod interlace;
mod list;
pub mod pixels;
#[cfg(test)]
mod tests;
mod timing;
pub(crate) mod v4l2;

pub use device::Grabber;
pub use interlace::Interlace;

use std::sync::Arc;

use crate::clock::Monotonic;
use crate::{Device, Driver, Error, Listing, OpenSettings};
use pixels::{Colour, Matrix, PixelFormat, Range};

/// Opens frame grabbers and everything else that Linux shows as a video device.
#[derive(Debug)]
pub struct GrabberDriver;

/// Which grabber, and what to ask of it. What is `None` is chosen by what the device offers.
#[derive(Debug, Clone, PartialEq)]
pub struct GrabberSettings {
    /// The node (`/dev/video0`, or a link to it as in `/dev/v4l/by-id`), or the device's name or place as listed, which stay the same when it is
    /// plugged in again.
    pub device: String,
    /// The input, by name or number, of devices with several; the one in force otherwise.
    pub input: Option<String>,
    /// The analogue standard; what the device sees otherwise.
    pub standard: Option<Standard>,
    /// The format of the video. Otherwise the largest picture that comes fluently, without compression if that costs nothing.
    pub format: Option<PixelFormat>,
    /// Pixels across and lines down.
    pub size: Option<[u32; 2]>,
    /// Frames a second; the most there is otherwise.
    pub rate_hz: Option<f64>,
    /// What pictures to make.
    pub colour: Colour,
    /// What stands for black and white, where the driver is wrong about it.
    pub range: Option<Range>,
    /// How luma was made, where the driver is wrong about it.
    pub matrix: Option<Matrix>,
    /// What to make of interlaced video.
    pub interlace: Interlace,
    /// How the video's pictures lie, by two letters as in sequence files: frames say so. Empty where that is not known.
    pub orientation: &'static str,
    /// Buffers that the kernel fills ahead: what may come while nobody asks.
    pub buffers: u32,
}

impl GrabberSettings {
    /// Everything chosen by what the device offers; grey pictures.
    pub fn new(device: impl Into<String>) -> Self {
        Self {
            device: device.into(),
            input: None,
            standard: None,
            format: None,
            size: None,
            rate_hz: None,
            colour: Colour::Grey,
            range: None,
            matrix: None,
            interlace: Interlace::default(),
            orientation: "",
            buffers: 6,
        }
    }
}

/// Analogue video standards, by their systems of lines and colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Standard {
    /// 525 lines, 59.94 fields a second.
    Ntsc,
    /// 625 lines, 50 fields a second.
    Pal,
    /// 625 lines, 50 fields a second.
    Secam,
}

impl Driver for GrabberDriver {
    fn name(&self) -> &'static str {
        "grabber"
    }

    fn list(&self) -> Vec<Listing> {
        list::list()
    }

    fn open(&self, settings: &OpenSettings) -> Result<Box<dyn Device>, Error> {
        let OpenSettings::Grabber(settings) = settings else {
            return Err(Error::Misuse("the grabber driver opens video devices; these settings are of another".into()));
        };
        Ok(Box::new(Grabber::new(settings.clone(), Arc::new(Monotonic))?))
    }
}
