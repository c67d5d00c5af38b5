//! Settings of a grabber.

use super::interlace::Interlace;
use super::pixels::{Colour, Matrix, PixelFormat, Range};

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
