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
#[cfg(test)]
mod tests;
mod timing;
pub(crate) mod v4l2;

pub use device::Grabber;
pub use interlace::Interlace;

use std::sync::Arc;

use sonoweave_core::Device;
use sonoweave_core::clock::Monotonic;

use crate::{Driver, Error, Listing, OpenSettings};
use pixels::{Colour, Matrix, PixelFormat, Range};

/// Opens frame grabbers and all other video devices of Linux.
#[derive(Debug)]
pub struct GrabberDriver;

/// Settings of a grabber. Each `None` is chosen from the device's offers.
#[derive(Debug, Clone, PartialEq)]
pub struct GrabberSettings {
    /// The node (`/dev/video0`, or a link to it as in `/dev/v4l/by-id`), or the listed name or
    /// bus location of the device. Name and location stay the same when the device is plugged in
    /// again.
    pub device: String,
    /// The input, by name or number, of devices with several; otherwise the current one.
    pub input: Option<String>,
    /// The analogue standard; otherwise the detected one.
    pub standard: Option<Standard>,
    /// The video format. Otherwise the largest frame at a fluent rate, uncompressed if that costs
    /// nothing.
    pub format: Option<PixelFormat>,
    /// Width and height in pixels.
    pub size: Option<[u32; 2]>,
    /// Frames per second; otherwise the highest rate.
    pub rate_hz: Option<f64>,
    /// Colour of the delivered frames.
    pub colour: Colour,
    /// Range of black and white, if the driver reports a wrong one.
    pub range: Option<Range>,
    /// Luma coefficients, if the driver reports wrong ones.
    pub matrix: Option<Matrix>,
    /// Treatment of interlaced video.
    pub interlace: Interlace,
    /// Orientation of the frames, in two letters as in sequence files; frames carry it. Empty if
    /// unknown.
    pub orientation: &'static str,
    /// Number of kernel buffers: frames that may arrive before the next read.
    pub buffers: u32,
}

impl GrabberSettings {
    /// Returns settings that choose everything from the device's offers, with grey frames.
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

/// Analogue video standards, by line and colour system.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Standard {
    /// 525 lines, 59.94 fields per second.
    Ntsc,
    /// 625 lines, 50 fields per second.
    Pal,
    /// 625 lines, 50 fields per second.
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
            return Err(Error::OtherDriver(self.name()));
        };
        Ok(Box::new(Grabber::new(settings.clone(), Arc::new(Monotonic))?))
    }
}
