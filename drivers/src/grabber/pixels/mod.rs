//! Converts video in the grabbers' formats to frames of 8 bits per channel: pure functions of
//! bytes, without device and clock.
//!
//! A [`Layout`] describes the bytes, [`Rows`] selects the rows of a frame, and a [`Converter`]
//! converts them. The formats are the smallest set that grabbers are known to deliver; every
//! other format is refused by name.
//!
//! - [`rows`]: the rows of a buffer that form a frame, whole or by field.
//! - `luma`: rows to grey. `colour`: rows to red, green and blue. Both use integers: the same
//!   bits on every machine.
//! - `jpeg`: Motion JPEG.
//! - [`mod@reference`]: all of it but JPEG a second time, in plain form, for testing the others.

mod colour;
mod jpeg;
mod luma;
pub mod reference;
pub mod rows;
#[cfg(test)]
mod tests;

use std::fmt;

pub use rows::{Field, Rows, Scan, Take};

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
    const fn red_and_blue(self) -> [f64; 2] {
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

/// Contents of a buffer of video.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Pixel format.
    pub format: PixelFormat,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Bytes from one row to the next (`bytesperline`), of the first plane; separate U and V rows
    /// have half of it. Ignored for [`PixelFormat::Mjpg`].
    pub row_bytes: u32,
    /// Range of black and white. JPEG is always full.
    pub range: Range,
    /// Luma coefficients. JPEG always has BT.601.
    pub matrix: Matrix,
}

/// Why a buffer gives no frame.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// The layout is impossible.
    #[error("{width}×{height} pixels in {format} with {row_bytes} bytes a line cannot be converted: {problem}")]
    Layout {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
        /// Pixel format.
        format: PixelFormat,
        /// Bytes from row to row.
        row_bytes: u32,
        /// The problem.
        problem: &'static str,
    },
    /// The buffer is shorter than its layout requires.
    #[error("the frame has {given} of {needed} bytes; check the cable")]
    Short {
        /// Present bytes.
        given: usize,
        /// Required bytes.
        needed: usize,
    },
    /// The JPEG image is damaged or not as agreed.
    #[error("the frame is not a complete JPEG image: {0}")]
    Jpeg(String),
}

/// Maximum width and height of a frame, in pixels.
const LONGEST: u32 = 16384;

/// Converts buffers of one layout to frames. Holds precomputed values; converting allocates
/// nothing (JPEG: what its decoder needs).
pub struct Converter {
    layout: Layout,
    rows: Rows,
    colour: Colour,
    width: usize,
    height: usize,
    stride: usize,
    /// Bytes of a row that are pixels.
    row: usize,
    coefficients: colour::Coefficients,
    jpeg: jpeg::Decoder,
}

impl Converter {
    /// Creates a converter.
    ///
    /// # Errors
    /// [`Refusal::Layout`] if no frame can have this layout.
    pub fn new(layout: Layout, rows: Rows, colour: Colour) -> Result<Self, Refusal> {
        let refuse = |problem| {
            let Layout { format, size: [width, height], row_bytes, .. } = layout;
            Err(Refusal::Layout { width, height, format, row_bytes, problem })
        };
        let [width, height] = layout.size;
        if width == 0 || height == 0 {
            return refuse("there are no pixels");
        }
        if width > LONGEST || height > LONGEST || layout.row_bytes > 16 * LONGEST {
            return refuse("this is larger than supported");
        }
        let row = layout.format.row_bytes(width) as usize;
        let (width, height, stride) = (width as usize, height as usize, layout.row_bytes as usize);
        if stride < row {
            return refuse("its lines do not fit");
        }
        if matches!(layout.format, PixelFormat::I420 | PixelFormat::Yv12) && stride / 2 < width.div_ceil(2) {
            return refuse("its lines of colour do not fit");
        }
        if rows.lines(height) == 0 {
            return refuse("a field of it has no lines");
        }
        Ok(Self {
            layout,
            rows,
            colour,
            width,
            height,
            stride,
            row,
            coefficients: colour::Coefficients::new(layout.matrix, layout.range),
            jpeg: jpeg::Decoder::default(),
        })
    }

    /// Returns the width and height of the frames.
    pub fn size(&self) -> [u32; 2] {
        [self.layout.size[0], u32::try_from(self.rows.lines(self.height)).unwrap_or(u32::MAX)]
    }

    /// Returns the colour of the frames.
    pub const fn colour(&self) -> Colour {
        self.colour
    }

    /// Returns the bytes of a frame.
    pub fn picture_bytes(&self) -> usize {
        self.width * self.rows.lines(self.height) * self.colour.channels()
    }

    /// Returns the minimum bytes of a buffer; 0 for JPEG, which contains its own size.
    pub fn video_bytes(&self) -> usize {
        let whole = self.stride * self.height;
        let half = self.height.div_ceil(2);
        match self.layout.format {
            PixelFormat::Mjpg => 0,
            PixelFormat::Nv12 => whole + self.stride * (half - 1) + 2 * self.width.div_ceil(2),
            PixelFormat::I420 | PixelFormat::Yv12 => {
                whole + (self.stride / 2) * (2 * half - 1) + self.width.div_ceil(2)
            }
            _ => whole - self.stride + self.row,
        }
    }

    /// Converts `video`, which may be longer than needed, to a frame; `out` has
    /// [`Self::picture_bytes`]. After a refusal its content is arbitrary.
    ///
    /// # Errors
    /// [`Refusal::Short`] if bytes are missing, [`Refusal::Jpeg`] if the image is damaged or of
    /// another size.
    ///
    /// # Panics
    /// If `out` does not have the length of a frame.
    pub fn convert(&mut self, video: &[u8], out: &mut [u8]) -> Result<(), Refusal> {
        assert_eq!(out.len(), self.picture_bytes(), "the picture's buffer is as long as the picture");
        let needed = self.video_bytes();
        if video.len() < needed {
            return Err(Refusal::Short { given: video.len(), needed });
        }
        match (self.layout.format, self.colour) {
            (PixelFormat::Mjpg, colour) => self.jpeg.decode(video, self.layout.size, colour, self.rows, out)?,
            (format, Colour::Grey) if !format.is_rgb() => {
                let kernel = luma::kernel(format, self.layout.range);
                self.lines(video, out, kernel);
            }
            (_, Colour::Grey) => self.grey_of_rgb(video, out),
            (format, Colour::Rgb) if format.is_rgb() => self.rgb_of_rgb(video, out),
            (format, Colour::Rgb) if format.is_grey() => self.rgb_of_grey(video, out),
            (_, Colour::Rgb) => self.rgb_of_yuv(video, out),
        }
        Ok(())
    }

    /// Calls `kernel` for each row of the frame with the row's pixel bytes in the buffer and its
    /// row in the frame.
    fn lines(&self, video: &[u8], out: &mut [u8], kernel: impl Fn(&[u8], &mut [u8])) {
        for (i, line) in out.chunks_exact_mut(self.width * self.colour.channels()).enumerate() {
            let at = self.rows.line(i, self.height) * self.stride;
            kernel(&video[at..at + self.row], line);
        }
    }

    fn grey_of_rgb(&self, video: &[u8], out: &mut [u8]) {
        let weights = colour::weights(self.layout.matrix, self.layout.format == PixelFormat::Bgr24);
        match self.layout.range {
            Range::Full => self.lines(video, out, |row, line| colour::grey_of_rgb::<false>(row, line, weights)),
            Range::Limited => self.lines(video, out, |row, line| colour::grey_of_rgb::<true>(row, line, weights)),
        }
    }

    fn rgb_of_rgb(&self, video: &[u8], out: &mut [u8]) {
        let swap = self.layout.format == PixelFormat::Bgr24;
        match (swap, self.layout.range) {
            (false, Range::Full) => self.lines(video, out, |row, line| line.copy_from_slice(row)),
            (false, Range::Limited) => self.lines(video, out, luma::expand_all),
            (true, Range::Full) => self.lines(video, out, colour::swap::<false>),
            (true, Range::Limited) => self.lines(video, out, colour::swap::<true>),
        }
    }

    fn rgb_of_grey(&self, video: &[u8], out: &mut [u8]) {
        let kernel = luma::kernel(self.layout.format, self.layout.range);
        self.lines(video, out, |row, line| colour::triple(row, line, kernel));
    }

    fn rgb_of_yuv(&self, video: &[u8], out: &mut [u8]) {
        let k = &self.coefficients;
        match self.layout.format {
            PixelFormat::Yuyv => self.lines(video, out, |row, line| colour::rgb_of_packed::<0, 1>(row, line, k)),
            PixelFormat::Uyvy => self.lines(video, out, |row, line| colour::rgb_of_packed::<1, 0>(row, line, k)),
            format => {
                let chroma = &video[self.stride * self.height..];
                let pairs = self.width.div_ceil(2);
                let half = self.stride / 2;
                let plane = half * self.height.div_ceil(2);
                for (i, line) in out.chunks_exact_mut(3 * self.width).enumerate() {
                    let at = self.rows.line(i, self.height) * self.stride;
                    let y = &video[at..at + self.width];
                    let row = self.rows.colour_line(i, self.height);
                    if format == PixelFormat::Nv12 {
                        let at = row * self.stride;
                        colour::rgb_of_pairs(y, &chroma[at..at + 2 * pairs], line, k);
                    } else {
                        let first = &chroma[row * half..row * half + pairs];
                        let second = &chroma[plane + row * half..plane + row * half + pairs];
                        let [u, v] = if format == PixelFormat::I420 { [first, second] } else { [second, first] };
                        colour::rgb_of_planes(y, u, v, line, k);
                    }
                }
            }
        }
    }
}
