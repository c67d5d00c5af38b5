//! Lines to grey.

use super::{PixelFormat, Range};

/// Of limited range to full: 16 becomes 0 and 235 becomes 255, rounded to the nearest; what lies outside is clipped.
pub(super) const fn expand(luma: u8) -> u8 {
    let above = luma.saturating_sub(16) as u16;
    let above = if above > 219 { 219 } else { above };
    // At most 219·255 + 109 < 2¹⁶, so that the division is a multiplication of 16 bits.
    ((above * 255 + 109) / 219) as u8
}

/// [`expand`], for every byte.
pub(super) fn expand_all(row: &[u8], line: &mut [u8]) {
    for (out, &value) in line.iter_mut().zip(row) {
        *out = expand(value);
    }
}

fn every_other<const AT: usize, const LIMITED: bool>(row: &[u8], line: &mut [u8]) {
    // Of an odd number of pixels the last pair is half used: it is taken from the bytes that are left.
    for (out, pair) in line.iter_mut().zip(row.chunks_exact(2)) {
        *out = if LIMITED { expand(pair[AT]) } else { pair[AT] };
    }
}

fn words<const BITS: u32, const LIMITED: bool>(row: &[u8], line: &mut [u8]) {
    for (out, pair) in line.iter_mut().zip(row.chunks_exact(2)) {
        let word = u16::from_le_bytes([pair[0], pair[1]]);
        // Bits above those that the format has are not to be trusted.
        let high = ((word >> (BITS - 8)) & 0xff) as u8;
        *out = if LIMITED { expand(high) } else { high };
    }
}

fn copy(row: &[u8], line: &mut [u8]) {
    line.copy_from_slice(row);
}

/// Makes grey of a line of `format`, which holds luma; of words the eight highest bits.
pub(super) fn kernel(format: PixelFormat, range: Range) -> fn(&[u8], &mut [u8]) {
    use PixelFormat as P;
    match (format, range) {
        (P::Y10, Range::Full) => words::<10, false>,
        (P::Y10, Range::Limited) => words::<10, true>,
        (P::Y12, Range::Full) => words::<12, false>,
        (P::Y12, Range::Limited) => words::<12, true>,
        (P::Y16, Range::Full) => words::<16, false>,
        (P::Y16, Range::Limited) => words::<16, true>,
        (P::Yuyv, Range::Full) => every_other::<0, false>,
        (P::Yuyv, Range::Limited) => every_other::<0, true>,
        (P::Uyvy, Range::Full) => every_other::<1, false>,
        (P::Uyvy, Range::Limited) => every_other::<1, true>,
        (_, Range::Full) => copy,
        (_, Range::Limited) => expand_all,
    }
}
