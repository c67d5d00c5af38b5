//! Formats of video: order of the components, range and luma coefficients; colour of the frames.

use std::fmt;

/// A driver's name of a format: four letters.
pub type FourCc = [u8; 4];

/// Convertible formats, by V4L2's names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PixelFormat {
    /// `GREY`: one byte per pixel.
    Grey,
    /// `Y10 `: ten bits in the low end of two bytes, little-endian.
    Y10,
    /// `Y12 `: twelve bits in the low end of two bytes, little-endian.
    Y12,
    /// `Y16 `: two bytes, little-endian.
    Y16,
    /// `YUYV`: two pixels in Y U Y V.
    Yuyv,
    /// `UYVY`: two pixels in U Y V Y.
    Uyvy,
    /// `NV12`: a plane of Y, then one of U V pairs for each 2×2 pixels.
    Nv12,
    /// `YU12`, also called I420: planes of Y, U, V, the latter two for each 2×2 pixels.
    I420,
    /// `YV12`: planes of Y, V, U, the latter two for each 2×2 pixels.
    Yv12,
    /// `RGB3`: red, green, blue.
    Rgb24,
    /// `BGR3`: blue, green, red.
    Bgr24,
    /// `MJPG` or `JPEG`: one JPEG image per frame.
    Mjpg,
}

impl PixelFormat {
    /// All formats; the cheapest that keep the full grey come first.
    pub const ALL: [Self; 12] = [
        Self::Grey,
        Self::Y16,
        Self::Y12,
        Self::Y10,
        Self::Yuyv,
        Self::Uyvy,
        Self::Nv12,
        Self::I420,
        Self::Yv12,
        Self::Rgb24,
        Self::Bgr24,
        Self::Mjpg,
    ];

    /// Returns V4L2's name.
    pub const fn fourcc(self) -> FourCc {
        *match self {
            Self::Grey => b"GREY",
            Self::Y10 => b"Y10 ",
            Self::Y12 => b"Y12 ",
            Self::Y16 => b"Y16 ",
            Self::Yuyv => b"YUYV",
            Self::Uyvy => b"UYVY",
            Self::Nv12 => b"NV12",
            Self::I420 => b"YU12",
            Self::Yv12 => b"YV12",
            Self::Rgb24 => b"RGB3",
            Self::Bgr24 => b"BGR3",
            Self::Mjpg => b"MJPG",
        }
    }

    /// Returns the format of a name, if it is supported.
    pub fn from_fourcc(fourcc: FourCc) -> Option<Self> {
        if &fourcc == b"JPEG" {
            return Some(Self::Mjpg);
        }
        Self::ALL.into_iter().find(|format| format.fourcc() == fourcc)
    }

    /// Returns whether the format holds only grey.
    pub const fn is_grey(self) -> bool {
        matches!(self, Self::Grey | Self::Y10 | Self::Y12 | Self::Y16)
    }

    /// Returns whether the format is stored as red, green and blue.
    pub const fn is_rgb(self) -> bool {
        matches!(self, Self::Rgb24 | Self::Bgr24)
    }

    /// Returns the minimum bytes of a row of `width` pixels (of the first plane); 0 for a format
    /// without rows.
    pub const fn row_bytes(self, width: u32) -> u32 {
        match self {
            Self::Grey | Self::Nv12 | Self::I420 | Self::Yv12 => width,
            Self::Y10 | Self::Y12 | Self::Y16 => width.saturating_mul(2),
            Self::Yuyv | Self::Uyvy => width.div_ceil(2).saturating_mul(4),
            Self::Rgb24 | Self::Bgr24 => width.saturating_mul(3),
            Self::Mjpg => 0,
        }
    }
}

impl fmt::Display for PixelFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&name_of(self.fourcc()))
    }
}

/// Returns the usual spelling of a format's name; other bytes than letters are escaped.
pub fn name_of(fourcc: FourCc) -> String {
    fourcc.escape_ascii().to_string().trim_end().to_owned()
}

/// Byte values of black and white.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Range {
    /// 16 to 235, colour differences 16 to 240; values outside are clipped. Usual for video.
    Limited,
    /// 0 to 255.
    Full,
}

/// Luma coefficients of red, green and blue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Matrix {
    /// ITU-R BT.601: standard definition, JPEG.
    Bt601,
    /// ITU-R BT.709: high definition.
    Bt709,
}

impl Matrix {
    /// Returns the weights of red and blue in luma.
    pub(super) const fn red_and_blue(self) -> [f64; 2] {
        match self {
            Self::Bt601 => [0.299, 0.114],
            Self::Bt709 => [0.2126, 0.0722],
        }
    }
}

/// Colour of the frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Colour {
    /// One channel.
    #[default]
    Grey,
    /// Red, green, blue, interleaved.
    Rgb,
}

impl Colour {
    /// Returns the number of channels of a pixel.
    pub const fn channels(self) -> usize {
        match self {
            Self::Grey => 1,
            Self::Rgb => 3,
        }
    }
}
