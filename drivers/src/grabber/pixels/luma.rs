//! Converts rows to grey.

use super::format::{PixelFormat, Range};

/// Expands limited range to full: 16 becomes 0 and 235 becomes 255, rounded to nearest; values
/// outside are clipped.
pub(super) const fn expand(luma: u8) -> u8 {
    let above = luma.saturating_sub(16) as u16;
    let above = if above > 219 { 219 } else { above };
    // At most 219·255 + 109 < 2¹⁶, so the division compiles to a 16-bit multiplication.
    ((above * 255 + 109) / 219) as u8
}

/// Applies [`expand`] to every byte.
pub(super) fn expand_all(row: &[u8], line: &mut [u8]) {
    for (out, &value) in line.iter_mut().zip(row) {
        *out = expand(value);
    }
}

fn every_other<const AT: usize, const LIMITED: bool>(row: &[u8], line: &mut [u8]) {
    // For an odd width, the rest of the last pair of pixels is ignored.
    for (out, pair) in line.iter_mut().zip(row.chunks_exact(2)) {
        *out = if LIMITED { expand(pair[AT]) } else { pair[AT] };
    }
}

fn words<const BITS: u32, const LIMITED: bool>(row: &[u8], line: &mut [u8]) {
    for (out, pair) in line.iter_mut().zip(row.chunks_exact(2)) {
        let word = u16::from_le_bytes([pair[0], pair[1]]);
        // Bits above those of the format are unreliable.
        let high = ((word >> (BITS - 8)) & 0xff) as u8;
        *out = if LIMITED { expand(high) } else { high };
    }
}

fn copy(row: &[u8], line: &mut [u8]) {
    line.copy_from_slice(row);
}

/// Returns the conversion of a row of `format` to grey. The format holds luma; of words the eight
/// highest bits are used.
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
