//! Converts rows to red, green and blue, and these to grey: ITU-R BT.601 and BT.709 in integers
//! of 2⁻¹³, rounded once.
//!
//! A colour difference belongs to two or four pixels, which all use it unchanged. The arithmetic
//! is compiled twice, for any processor and for those with AVX2. It uses integers, so both give
//! the same bits.
#![allow(unsafe_code, reason = "a function for processors with AVX2 is called where there is AVX2")]

use super::format::{Matrix, Range};
use super::luma::expand;

/// Fractional bits of the coefficients: with 13, all fit in 16 bits, and their rounding error is
/// below 2⁻⁵ of a level.
const BITS: u32 = 13;

/// Coefficients from Y'CbCr to R'G'B'. They have 16 bits, because even the oldest vector
/// instructions multiply these.
#[derive(Debug, Clone, Copy)]
pub(super) struct Coefficients {
    /// Coefficient of Y.
    luma: i16,
    red_of_v: i16,
    green_of_u: i16,
    green_of_v: i16,
    blue_of_u: i16,
    /// Constant for all channels: the offset of black, and one half for rounding.
    black: i32,
    /// Whether the processor has AVX2.
    avx2: bool,
}

impl Coefficients {
    pub(super) fn new(matrix: Matrix, range: Range) -> Self {
        let [red, blue] = matrix.red_and_blue();
        let green = 1.0 - red - blue;
        let (luma, black, chroma) = match range {
            Range::Limited => (255.0 / 219.0, 16.0, 255.0 / 224.0),
            Range::Full => (1.0, 0.0, 1.0),
        };
        let fixed = |value: f64| (value * f64::from(1 << BITS)).round();
        Self {
            luma: fixed(luma) as i16,
            red_of_v: fixed(2.0 * (1.0 - red) * chroma) as i16,
            green_of_u: fixed(-2.0 * (1.0 - blue) * blue / green * chroma) as i16,
            green_of_v: fixed(-2.0 * (1.0 - red) * red / green * chroma) as i16,
            blue_of_u: fixed(2.0 * (1.0 - blue) * chroma) as i16,
            black: (1 << (BITS - 1)) - fixed(luma * black) as i32,
            avx2: has_avx2(),
        }
    }
}

fn has_avx2() -> bool {
    #[cfg(target_arch = "x86_64")]
    return is_x86_feature_detected!("avx2");
    #[cfg(not(target_arch = "x86_64"))]
    return false;
}

/// Pairs of pixels that are converted together.
const PAIRS: usize = 32;

/// Pairs of pixels, ordered by component, so that each step below is the same for all of them.
struct Block {
    /// Luma of the first and the second pixel of each pair.
    y: [[u8; PAIRS]; 2],
    u: [u8; PAIRS],
    v: [u8; PAIRS],
}

impl Block {
    const EMPTY: Self = Self { y: [[0; PAIRS]; 2], u: [0; PAIRS], v: [0; PAIRS] };

    /// Converts all pixels to interleaved red, green and blue.
    fn convert(&self, k: &Coefficients, out: &mut [u8; 6 * PAIRS]) {
        #[cfg(target_arch = "x86_64")]
        if k.avx2 {
            // SAFETY: the flag is set only after the processor was found to have AVX2.
            return unsafe { self.convert_avx2(k, out) };
        }
        let mut levels = [[[0; PAIRS]; 3]; 2];
        self.levels_alone(k, &mut levels);
        interleave_alone(&levels, out);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn convert_avx2(&self, k: &Coefficients, out: &mut [u8; 6 * PAIRS]) {
        let mut levels = [[[0; PAIRS]; 3]; 2];
        self.levels(k, &mut levels);
        interleave(&levels, out);
    }

    /// Wraps [`Self::levels`] in a function of its own, like [`interleave_alone`]. Without AVX2
    /// the two take five times as long when compiled as one loop, which the compiler does not
    /// vectorise.
    #[inline(never)]
    fn levels_alone(&self, k: &Coefficients, levels: &mut Levels) {
        self.levels(k, levels);
    }

    /// Computes the levels of red, green and blue, of the first and the second pixel of each
    /// pair.
    #[inline(always)]
    fn levels(&self, k: &Coefficients, levels: &mut Levels) {
        let product = |a: i16, b: i16| i32::from(a) * i32::from(b);
        let level = |sum: i32| ((sum >> BITS) as i16).clamp(0, 255) as u8;
        for ([red, green, blue], y) in levels.iter_mut().zip(&self.y) {
            for n in 0..PAIRS {
                let (u, v) = (i16::from(self.u[n]) - 128, i16::from(self.v[n]) - 128);
                let y = product(y[n].into(), k.luma) + k.black;
                red[n] = level(y + product(v, k.red_of_v));
                green[n] = level(y + product(u, k.green_of_u) + product(v, k.green_of_v));
                blue[n] = level(y + product(u, k.blue_of_u));
            }
        }
    }
}

/// Red, green and blue, of the first and the second pixel of each pair.
type Levels = [[[u8; PAIRS]; 3]; 2];

#[inline(never)]
fn interleave_alone(levels: &Levels, out: &mut [u8; 6 * PAIRS]) {
    interleave(levels, out);
}

/// Interleaves the levels pixel by pixel.
#[inline(always)]
fn interleave(levels: &Levels, out: &mut [u8; 6 * PAIRS]) {
    let mut pixels = [[0_u32; PAIRS]; 2];
    for (pixels, [red, green, blue]) in pixels.iter_mut().zip(levels) {
        for n in 0..PAIRS {
            pixels[n] = u32::from(red[n]) | u32::from(green[n]) << 8 | u32::from(blue[n]) << 16;
        }
    }
    // Four pixels of three bytes are three words.
    let [first, second] = &pixels;
    for ((out, a), b) in out.chunks_exact_mut(12).zip(first.chunks_exact(2)).zip(second.chunks_exact(2)) {
        let words = [a[0] | b[0] << 24, b[0] >> 8 | a[1] << 16, a[1] >> 16 | b[1] << 8];
        for (out, word) in out.chunks_exact_mut(4).zip(words) {
            out.copy_from_slice(&word.to_le_bytes());
        }
    }
}

/// Converts a row block by block; `load` fills a block from the given pair of pixels on.
#[inline(always)]
fn by_blocks(line: &mut [u8], k: &Coefficients, load: impl Fn(&mut Block, usize)) {
    let mut block = Block::EMPTY;
    let mut last = [0; 6 * PAIRS];
    for (nth, out) in line.chunks_mut(6 * PAIRS).enumerate() {
        load(&mut block, nth * PAIRS);
        match <&mut [u8; 6 * PAIRS]>::try_from(&mut *out) {
            Ok(out) => block.convert(k, out),
            Err(_) => {
                block.convert(k, &mut last);
                out.copy_from_slice(&last[..out.len()]);
            }
        }
    }
}

/// Returns the bytes of one block, from pair `at` on.
#[inline(always)]
fn from<const EACH: usize>(row: &[u8], at: usize) -> &[u8] {
    &row[EACH * at..row.len().min(EACH * (at + PAIRS))]
}

/// Converts packed pairs of pixels: luma at `Y` and `Y + 2`, U at `C`, V at `C + 2` of each four
/// bytes.
pub(super) fn rgb_of_packed<const Y: usize, const C: usize>(row: &[u8], line: &mut [u8], k: &Coefficients) {
    by_blocks(line, k, |block, at| {
        for (n, four) in from::<4>(row, at).chunks_exact(4).enumerate() {
            block.y[0][n] = four[Y];
            block.y[1][n] = four[Y + 2];
            block.u[n] = four[C];
            block.v[n] = four[C + 2];
        }
    });
}

/// Converts a plane of luma and one of U V pairs.
pub(super) fn rgb_of_pairs(y: &[u8], uv: &[u8], line: &mut [u8], k: &Coefficients) {
    by_blocks(line, k, |block, at| {
        load_luma(block, y, at);
        for (n, uv) in from::<2>(uv, at).chunks_exact(2).enumerate() {
            block.u[n] = uv[0];
            block.v[n] = uv[1];
        }
    });
}

/// Converts three planes.
pub(super) fn rgb_of_planes(y: &[u8], u: &[u8], v: &[u8], line: &mut [u8], k: &Coefficients) {
    by_blocks(line, k, |block, at| {
        load_luma(block, y, at);
        let (u, v) = (from::<1>(u, at), from::<1>(v, at));
        block.u[..u.len()].copy_from_slice(u);
        block.v[..v.len()].copy_from_slice(v);
    });
}

#[inline(always)]
fn load_luma(block: &mut Block, y: &[u8], at: usize) {
    let y = from::<2>(y, at);
    let pairs = y.chunks_exact(2);
    // For an odd width, the last pixel is half a pair.
    if let &[last] = pairs.remainder() {
        block.y[0][y.len() / 2] = last;
    }
    for (n, pair) in pairs.enumerate() {
        block.y[0][n] = pair[0];
        block.y[1][n] = pair[1];
    }
}

/// Returns the weights of a pixel's three bytes in its grey, in 2⁻¹⁶; they sum to one, so grey is
/// unchanged.
pub(super) fn weights(matrix: Matrix, reversed: bool) -> [u32; 3] {
    let [red, blue] = matrix.red_and_blue().map(|part| (part * 65536.0).round() as u32);
    let green = 65536 - red - blue;
    if reversed { [blue, green, red] } else { [red, green, blue] }
}

/// Converts pixels of three bytes to grey.
pub(super) fn grey_of_rgb<const LIMITED: bool>(row: &[u8], line: &mut [u8], [a, b, c]: [u32; 3]) {
    for (out, pixel) in line.iter_mut().zip(row.chunks_exact(3)) {
        let sum = u32::from(pixel[0]) * a + u32::from(pixel[1]) * b + u32::from(pixel[2]) * c + 0x8000;
        let grey = (sum >> 16) as u8;
        *out = if LIMITED { expand(grey) } else { grey };
    }
}

/// Reverses the three bytes of each pixel.
pub(super) fn swap<const LIMITED: bool>(row: &[u8], line: &mut [u8]) {
    for (out, pixel) in line.chunks_exact_mut(3).zip(row.chunks_exact(3)) {
        let reversed = [pixel[2], pixel[1], pixel[0]];
        out.copy_from_slice(&if LIMITED { reversed.map(expand) } else { reversed });
    }
}

/// Writes grey three times; `kernel` computes the grey, some pixels at a time.
pub(super) fn triple(row: &[u8], line: &mut [u8], kernel: fn(&[u8], &mut [u8])) {
    const PIXELS: usize = 256;
    let bytes = 3 * row.len() / line.len();
    let mut grey = [0; PIXELS];
    for (out, row) in line.chunks_mut(3 * PIXELS).zip(row.chunks(bytes * PIXELS)) {
        let grey = &mut grey[..out.len() / 3];
        kernel(row, grey);
        for (pixel, &value) in out.chunks_exact_mut(3).zip(grey.iter()) {
            pixel.fill(value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tests every luma with a grid of colour differences that includes the extremes, in both
    /// compiled versions.
    #[test]
    fn avx2_and_plain_code_give_same_bits() {
        if !has_avx2() {
            return;
        }
        for (matrix, range) in [(Matrix::Bt601, Range::Limited), (Matrix::Bt709, Range::Full)] {
            let with = Coefficients::new(matrix, range);
            let without = Coefficients { avx2: false, ..with };
            for u in (0..=255).step_by(15) {
                for v in (0..=255).step_by(17) {
                    let row: Vec<u8> = (0..=255).flat_map(|y| [y, u, 255 - y, v]).collect();
                    let mut lines = [vec![0; 6 * 256], vec![0; 6 * 256]];
                    rgb_of_packed::<0, 1>(&row, &mut lines[0], &with);
                    rgb_of_packed::<0, 1>(&row, &mut lines[1], &without);
                    assert_eq!(lines[0], lines[1], "{u} {v}");
                }
            }
        }
    }
}
