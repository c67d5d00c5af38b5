//! Reference conversion, one pixel at a time in `f64`, for testing and benchmarking the
//! converters.

use super::{Colour, Field, Layout, Matrix, PixelFormat, Range, Rows, Scan, Take};

/// Converts `video` to unrounded levels from 0 to 255; grey three times. The rules for rows are
/// stated here a second time, as plainly as in the standard.
///
/// # Panics
/// If `video` is shorter than `layout` requires, or of a format without equations (JPEG).
pub fn reference(layout: &Layout, rows: Rows, colour: Colour, video: &[u8]) -> Vec<[f64; 3]> {
    let [width, height] = layout.size.map(|side| side as usize);
    let lines = if matches!(rows.take, Take::All) { height } else { height / 2 };
    let sample = Sample { layout, rows, video };
    let mut out = Vec::with_capacity(width * lines);
    for i in 0..lines {
        for x in 0..width {
            out.push(equation(layout, colour, sample.at(x, i)));
        }
    }
    out
}

/// Finds a pixel's samples.
struct Sample<'a> {
    layout: &'a Layout,
    rows: Rows,
    video: &'a [u8],
}

impl Sample<'_> {
    /// Returns luma and colour differences, or red, green and blue, of pixel `x` of row `i` of
    /// the frame.
    fn at(&self, x: usize, i: usize) -> [f64; 3] {
        let height = self.layout.size[1] as usize;
        let stride = self.layout.row_bytes as usize;
        let half = height.div_ceil(2);
        let (field, k) = match self.rows.take {
            Take::All => (if i.is_multiple_of(2) { Field::Top } else { Field::Bottom }, i / 2),
            Take::Field(field) => (field, i),
        };
        let y = self.line(field, k, height);
        let c = if self.rows.scan == Scan::Progressive { y / 2 } else { self.line(field, k / 2, half) }.min(half - 1);
        let at = |n: usize| f64::from(self.video[n]);
        let word = |bits: i32| {
            let n = y * stride + 2 * x;
            let word = u16::from_le_bytes([self.video[n], self.video[n + 1]]);
            (f64::from(word) / 2_f64.powi(bits - 8)).floor() % 256.0
        };
        let pairs = stride * height;
        let planes = [pairs + c * (stride / 2) + x / 2, pairs + (half + c) * (stride / 2) + x / 2];
        let four = y * stride + 4 * (x / 2);
        let three = y * stride + 3 * x;
        match self.layout.format {
            PixelFormat::Grey => [at(y * stride + x), 128.0, 128.0],
            PixelFormat::Y10 => [word(10), 128.0, 128.0],
            PixelFormat::Y12 => [word(12), 128.0, 128.0],
            PixelFormat::Y16 => [word(16), 128.0, 128.0],
            PixelFormat::Yuyv => [at(four + 2 * (x % 2)), at(four + 1), at(four + 3)],
            PixelFormat::Uyvy => [at(four + 1 + 2 * (x % 2)), at(four), at(four + 2)],
            PixelFormat::Nv12 => {
                let pair = pairs + c * stride + 2 * (x / 2);
                [at(y * stride + x), at(pair), at(pair + 1)]
            }
            PixelFormat::I420 => [at(y * stride + x), at(planes[0]), at(planes[1])],
            PixelFormat::Yv12 => [at(y * stride + x), at(planes[1]), at(planes[0])],
            PixelFormat::Rgb24 => [at(three), at(three + 1), at(three + 2)],
            PixelFormat::Bgr24 => [at(three + 2), at(three + 1), at(three)],
            PixelFormat::Mjpg => panic!("a JPEG picture has no samples at places"),
        }
    }

    /// Returns the index of row `k` of a field in a plane of `lines` rows.
    fn line(&self, field: Field, k: usize, lines: usize) -> usize {
        match self.rows.scan {
            Scan::Progressive | Scan::Interlaced => 2 * k + usize::from(field == Field::Bottom),
            Scan::Sequential { first } if first == field => k,
            Scan::Sequential { first: Field::Top } => lines.div_ceil(2) + k,
            Scan::Sequential { first: Field::Bottom } => lines / 2 + k,
        }
    }
}

/// Applies the equations of ITU-R BT.601 and BT.709.
fn equation(layout: &Layout, colour: Colour, [first, second, third]: [f64; 3]) -> [f64; 3] {
    let (red, blue) = match layout.matrix {
        Matrix::Bt601 => (0.299, 0.114),
        Matrix::Bt709 => (0.2126, 0.0722),
    };
    let green = 1.0 - red - blue;
    let limited = layout.range == Range::Limited;
    let wide = |value: f64| if limited { (value - 16.0) * 255.0 / 219.0 } else { value };
    let pixel = if layout.format.is_rgb() {
        match colour {
            Colour::Grey => [wide(red * first + green * second + blue * third); 3],
            Colour::Rgb => [first, second, third].map(wide),
        }
    } else if colour == Colour::Grey || layout.format.is_grey() {
        [wide(first); 3]
    } else {
        let y = wide(first);
        let [u, v] = [second, third].map(|c| (c - 128.0) * if limited { 255.0 / 224.0 } else { 1.0 });
        let from_blue = 2.0 * (1.0 - blue) * u;
        let from_red = 2.0 * (1.0 - red) * v;
        [y + from_red, y - (red * from_red + blue * from_blue) / green, y + from_blue]
    };
    pixel.map(|value| value.clamp(0.0, 255.0))
}
