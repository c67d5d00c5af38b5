//! Numbers in text of fixed columns and of fields, eight characters at a time.
//!
//! A tracker's text is mostly digits, and reading it a digit at a time is what would limit a decoder. The functions here look at eight bytes as
//! one word: which are digits, where they end, what they amount to. Each is tested against a plain reading of the same characters.

const ONES: u64 = 0x0101_0101_0101_0101;
const TOPS: u64 = 0x8080_8080_8080_8080;

/// Bit 7 of each byte that is not an ASCII digit; `digits` is the text with `'0'` taken from each byte by exclusive or.
fn not_digits(digits: u64) -> u64 {
    // 0..=9 plus 0x76 stays below 0x80; everything else reaches or has bit 7.
    (((digits & !TOPS) + 0x76 * ONES) | digits) & TOPS
}

/// Eight decimal digits as values, the first in the lowest byte.
fn decimal(digits: u64) -> u32 {
    let pairs = (digits * 10 + (digits >> 8)) & 0x00ff_00ff_00ff_00ff;
    let fours = (pairs * 100 + (pairs >> 16)) & 0x0000_ffff_0000_ffff;
    ((fours * 10_000 + (fours >> 32)) & 0xffff_ffff) as u32
}

/// A number right-aligned in seven columns with `WHOLE` columns before the point: blanks, a sign or none, digits, point, digits.
///
/// Returns whether it is negative and its digits without the point; a negative zero stays negative.
#[inline]
pub(crate) fn fixed_point<const WHOLE: u32>(field: [u8; 7]) -> Option<(bool, u32)> {
    let [a, b, c, d, e, f, g] = field;
    let text = u64::from_le_bytes([a, b, c, d, e, f, g, b'0']);
    let digits = text ^ (ONES * u64::from(b'0'));
    let not_digits = not_digits(digits);
    let whole = (1_u64 << (8 * WHOLE)) - 1;
    let point = 0xff_u64 << (8 * WHOLE);
    // Bytes before the first digit, all bits set.
    let lead = ((not_digits & whole) >> 7) * 0xff;
    // Blanks there, but for a sign in the last of them.
    let odd = (text ^ (ONES * u64::from(b' '))) & lead;
    let last = (lead ^ (lead >> 8)) & ONES;
    let minus = last * u64::from(b' ' ^ b'-');
    let plus = last * u64::from(b' ' ^ b'+');
    let good = not_digits & !whole == TOPS & point
        && (text & point) >> (8 * WHOLE) == u64::from(b'.')
        && lead & (lead + 1) == 0
        && lead != whole
        && (odd == 0 || odd == minus || odd == plus);
    if !good {
        return None;
    }
    let digits = digits & !lead;
    let joined = (digits & whole) | ((digits >> 8) & !whole);
    Some((odd != 0 && odd == minus, decimal(joined << 16)))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The same, a character at a time.
    fn plain(field: &[u8; 7], whole: usize) -> Option<(bool, u32)> {
        let text = std::str::from_utf8(field).ok()?.trim_start_matches(' ');
        let (negative, text) = match text.as_bytes().first()? {
            b'-' => (true, &text[1..]),
            b'+' => (false, &text[1..]),
            _ => (false, text),
        };
        let (before, after) = text.split_once('.')?;
        let digits = |part: &str| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit());
        (digits(before) && digits(after) && after.len() == 6 - whole)
            .then(|| (negative, format!("{before}{after}").parse().unwrap()))
    }

    proptest! {
        #[test]
        fn columns_are_read_as_a_character_at_a_time(field in proptest::collection::vec("[ 0-9.+-]", 7)) {
            let field: [u8; 7] = field.concat().into_bytes().try_into().unwrap();
            prop_assert_eq!(fixed_point::<4>(field), plain(&field, 4));
            prop_assert_eq!(fixed_point::<2>(field), plain(&field, 2));
        }

        #[test]
        fn any_bytes_are_read_as_a_character_at_a_time(field in any::<[u8; 7]>()) {
            prop_assert_eq!(fixed_point::<4>(field), plain(&field, 4));
            prop_assert_eq!(fixed_point::<2>(field), plain(&field, 2));
        }

        #[test]
        fn what_was_written_is_read(hundredths in -99_999_i32..=99_999) {
            let field: [u8; 7] = format!("{:7.2}", f64::from(hundredths) / 100.0).into_bytes().try_into().unwrap();
            prop_assert_eq!(fixed_point::<4>(field), Some((hundredths < 0, hundredths.unsigned_abs())));
            let field: [u8; 7] = format!("{:7.4}", f64::from(hundredths) / 1e4).into_bytes().try_into().unwrap();
            prop_assert_eq!(fixed_point::<2>(field), Some((hundredths < 0, hundredths.unsigned_abs())));
        }
    }
}
