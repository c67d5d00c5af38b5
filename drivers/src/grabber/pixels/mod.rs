//! Converts video in the grabbers' formats to frames of 8 bits per channel: pure functions of
//! bytes, without device and clock.
//!
//! A [`Layout`] describes the bytes, [`Rows`] selects the rows of a frame, and a [`Converter`]
//! converts them. The formats are the smallest set that grabbers are known to deliver; every
//! other format is refused by name.
//!
//! - `format`: the formats, with their range and colours. `refusal`: why a buffer gives no frame.
//! - [`rows`]: the rows of a buffer that form a frame, whole or by field.
//! - `luma`: rows to grey. `colour`: rows to red, green and blue. Both use integers: the same
//!   bits on every machine.
//! - `jpeg`: Motion JPEG.
//! - [`mod@reference`]: all of it but JPEG a second time, in plain form, for testing the others.

mod colour;
mod format;
mod jpeg;
mod luma;
pub mod reference;
mod refusal;
pub mod rows;
#[cfg(test)]
mod tests;

pub use format::{Colour, FourCc, Matrix, PixelFormat, Range, name_of};
pub use refusal::Refusal;
pub use rows::{Field, Rows, Scan, Take};

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
