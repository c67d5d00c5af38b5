//! Video as grabbers deliver it to pictures of 8 bits: pure functions of bytes, no device and no clock.
//!
//! A [`Layout`] says what the bytes are, [`Rows`] which of their lines make a picture, a [`Converter`] does it. The least set of formats that
//! grabbers are seen to deliver is known; all else is refused by its name.
//!
//! - [`rows`]: which lines of a buffer make a picture, whole or by field.
//! - `luma`: lines to grey. `colour`: lines to red, green and blue. Both in integers: the same bits on every machine.
//! - `jpeg`: Motion JPEG.
//! - [`mod@reference`]: all of it but JPEG once more, plainly: what the others are tested against.

mod colour;
mod jpeg;
mod luma;
pub mod reference;
pub mod rows;
#[cfg(test)]
mod tests;

use std::fmt;

pub use rows::{Field, Rows, Scan, Take};

/// How a driver names a format: four letters.
pub type FourCc = [u8; 4];

/// Formats that can be converted, by V4L2's names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PixelFormat {
    /// `GREY`: a byte a pixel.
    Grey,
    /// `Y10 `: ten bits in the low end of two bytes, little endian.
    Y10,
    /// `Y12 `: twelve bits in the low end of two bytes, little endian.
    Y12,
    /// `Y16 `: two bytes, little endian.
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
    /// `MJPG` or `JPEG`: a JPEG picture a frame.
    Mjpg,
}

impl PixelFormat {
    /// All of them, those that cost least and lose nothing of the grey first.
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

    /// V4L2's name for it.
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

    /// The format of a name, if it is one of ours.
    pub fn from_fourcc(fourcc: FourCc) -> Option<Self> {
        if &fourcc == b"JPEG" {
            return Some(Self::Mjpg);
        }
        Self::ALL.into_iter().find(|format| format.fourcc() == fourcc)
    }

    /// Whether it holds nothing but grey.
    pub const fn is_grey(self) -> bool {
        matches!(self, Self::Grey | Self::Y10 | Self::Y12 | Self::Y16)
    }

    /// Whether it is stored as red, green and blue.
    pub const fn is_rgb(self) -> bool {
        matches!(self, Self::Rgb24 | Self::Bgr24)
    }

    /// Bytes that a line of `width` pixels takes at least (of the first plane), 0 where there are no lines.
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

/// A format's name as people write it; bytes that are no letters are shown as such.
pub fn name_of(fourcc: FourCc) -> String {
    fourcc.escape_ascii().to_string().trim_end().to_owned()
}

/// Which bytes stand for black and white.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Range {
    /// 16 to 235, colour differences 16 to 240; what lies outside is clipped. Usual for video.
    Limited,
    /// 0 to 255.
    Full,
}

/// How luma is made of red, green and blue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Matrix {
    /// ITU-R BT.601: standard definition, JPEG.
    Bt601,
    /// ITU-R BT.709: high definition.
    Bt709,
}

impl Matrix {
    /// The parts of red and blue in luma.
    const fn red_and_blue(self) -> [f64; 2] {
        match self {
            Self::Bt601 => [0.299, 0.114],
            Self::Bt709 => [0.2126, 0.0722],
        }
    }
}

/// What pictures are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Colour {
    /// One channel.
    #[default]
    Grey,
    /// Red, green, blue, interleaved.
    Rgb,
}

impl Colour {
    /// Channels of a pixel.
    pub const fn channels(self) -> usize {
        match self {
            Self::Grey => 1,
            Self::Rgb => 3,
        }
    }
}

/// What a buffer of video holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Its format.
    pub format: PixelFormat,
    /// Pixels across and lines down.
    pub size: [u32; 2],
    /// Bytes from one line to the next (`bytesperline`), of the first plane; the lines of U and V alone are half as far apart. Ignored for
    /// [`PixelFormat::Mjpg`].
    pub row_bytes: u32,
    /// What stands for black and white. JPEG is always full.
    pub range: Range,
    /// How luma was made. JPEG's is always BT.601.
    pub matrix: Matrix,
}

/// Why there is no picture.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Refusal {
    /// The layout cannot be.
    #[error("a picture of {width}×{height} pixels in {format} with {row_bytes} bytes a line cannot be: {problem}")]
    Layout {
        /// Pixels across.
        width: u32,
        /// Lines down.
        height: u32,
        /// The format.
        format: PixelFormat,
        /// Bytes from line to line.
        row_bytes: u32,
        /// Why.
        problem: &'static str,
    },
    /// The buffer is shorter than its layout says.
    #[error("the frame holds {given} bytes where {needed} make a picture; it was cut off on its way")]
    Short {
        /// Bytes there are.
        given: usize,
        /// Bytes there should be.
        needed: usize,
    },
    /// The JPEG picture is damaged or not of the kind that was agreed.
    #[error("the frame is no whole JPEG picture: {0}")]
    Jpeg(String),
}

/// Longest side of a picture.
const LONGEST: u32 = 16384;

/// Makes pictures of buffers of one layout. Holds what is computed once; converting allocates nothing (JPEG: what its decoder needs).
pub struct Converter {
    layout: Layout,
    rows: Rows,
    colour: Colour,
    width: usize,
    height: usize,
    stride: usize,
    /// Bytes of a line that are pixels.
    row: usize,
    coefficients: colour::Coefficients,
    jpeg: jpeg::Decoder,
}

impl Converter {
    /// # Errors
    /// [`Refusal::Layout`] when no picture can be of this layout.
    pub fn new(layout: Layout, rows: Rows, colour: Colour) -> Result<Self, Refusal> {
        let refuse = |problem| {
            let Layout { format, size: [width, height], row_bytes, .. } = layout;
            Err(Refusal::Layout { width, height, format, row_bytes, problem })
        };
        let [width, height] = layout.size;
        if width == 0 || height == 0 {
            return refuse("it has no pixels");
        }
        if width > LONGEST || height > LONGEST || layout.row_bytes > 16 * LONGEST {
            return refuse("it is larger than any that is known");
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

    /// Pixels across and lines down of the pictures.
    pub fn size(&self) -> [u32; 2] {
        [self.layout.size[0], u32::try_from(self.rows.lines(self.height)).unwrap_or(u32::MAX)]
    }

    /// Channels of their pixels.
    pub const fn colour(&self) -> Colour {
        self.colour
    }

    /// Bytes of a picture.
    pub fn picture_bytes(&self) -> usize {
        self.width * self.rows.lines(self.height) * self.colour.channels()
    }

    /// Bytes that a buffer must have at least; 0 for JPEG, which says so itself.
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

    /// Makes the picture of `video`, which may be longer than it need be; `out` has [`Self::picture_bytes`]. After a refusal its content is
    /// arbitrary.
    ///
    /// # Errors
    /// [`Refusal::Short`] when bytes are missing, [`Refusal::Jpeg`] when the picture is damaged or of another size.
    ///
    /// # Panics
    /// When `out` is not as long as a picture.
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

    /// Calls `kernel` for each line of the picture with the buffer's line (as many bytes as its pixels take) and the picture's.
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
