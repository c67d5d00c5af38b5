//! Parses numbers in fixed columns and in delimited fields, eight characters at a time.
//!
//! A tracker's text is mostly digits, so parsing digit by digit would limit the decoder's
//! speed. The functions here treat eight bytes as one word: they find the digits, their end and
//! their value. Tests compare each function with a plain parser of the same characters.

const ONES: u64 = 0x0101_0101_0101_0101;
const TOPS: u64 = 0x8080_8080_8080_8080;

/// Sets bit 7 of each byte that is not an ASCII digit; `digits` is the text with each byte
/// XORed with `'0'`.
fn not_digits(digits: u64) -> u64 {
    // 0..=9 plus 0x76 stays below 0x80; every other value reaches bit 7 or has it set.
    (((digits & !TOPS) + 0x76 * ONES) | digits) & TOPS
}

/// Converts eight decimal digit values to a number; the first digit is in the lowest byte.
fn decimal(digits: u64) -> u32 {
    let pairs = (digits * 10 + (digits >> 8)) & 0x00ff_00ff_00ff_00ff;
    let fours = (pairs * 100 + (pairs >> 16)) & 0x0000_ffff_0000_ffff;
    ((fours * 10_000 + (fours >> 32)) & 0xffff_ffff) as u32
}

/// Parses a number right-aligned in seven columns, with `WHOLE` columns before the point:
/// blanks, an optional sign, digits, point, digits.
///
/// Returns whether it is negative, and its digits without the point; a negative zero stays
/// negative.
#[inline]
pub(crate) fn fixed_point<const WHOLE: u32>(field: [u8; 7]) -> Option<(bool, u32)> {
    let [a, b, c, d, e, f, g] = field;
    let text = u64::from_le_bytes([a, b, c, d, e, f, g, b'0']);
    let digits = text ^ (ONES * u64::from(b'0'));
    let not_digits = not_digits(digits);
    let whole = (1_u64 << (8 * WHOLE)) - 1;
    let point = 0xff_u64 << (8 * WHOLE);
    // Bytes before the first digit, with all bits set.
    let lead = ((not_digits & whole) >> 7) * 0xff;
    // These bytes are blanks, except that the last may be a sign.
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

/// Parses eight hexadecimal digits of either case.
#[inline]
pub(crate) fn hex(field: [u8; 8]) -> Option<u32> {
    let text = u64::from_le_bytes(field);
    let digits = text ^ (ONES * u64::from(b'0'));
    let letters = not_digits(digits);
    // Upper case becomes lower; the significant bits of digits stay.
    let lower = text | (ONES * 0x20);
    if letters != 0 {
        // Each non-digit must be a..=f: its distance from 0x60 must be 1..=6.
        let marks = (letters >> 7) * 0xff;
        let distance = (lower ^ (ONES * 0x60)) & marks;
        // 1..=6 plus 0x79 stays below 0x80; 0 must not be.
        let beyond = ((distance & !TOPS) + 0x79 * ONES) & marks | distance;
        let some = (distance & !TOPS) + 0x7f * ONES;
        if beyond & TOPS != 0 || !some & letters != 0 || text & TOPS != 0 {
            return None;
        }
    }
    // A letter's low nibble is 1..=6 and stands for 10..=15.
    let nibbles = (text & (ONES * 0x0f)) + (letters >> 7) * 9;
    let pairs = (nibbles << 4 | nibbles >> 8) & 0x00ff_00ff_00ff_00ff;
    let fours = (pairs << 8 | pairs >> 16) & 0x0000_ffff_0000_ffff;
    Some(((fours << 16 | fours >> 32) & 0xffff_ffff) as u32)
}

/// Parses the decimal digits at the front of `text`. Returns their value, below 2³², and their
/// number, 1 to 10.
#[inline]
pub(crate) fn unsigned(text: &[u8]) -> Option<(u32, usize)> {
    let eight = match text.first_chunk() {
        Some(eight) => *eight,
        None => {
            let mut eight = [0; 8];
            eight[..text.len()].copy_from_slice(text);
            eight
        }
    };
    let digits = u64::from_le_bytes(eight) ^ (ONES * u64::from(b'0'));
    let not_digits = not_digits(digits);
    if not_digits == 0 {
        // At most two more digits.
        let mut value = u64::from(decimal(digits));
        let mut count = 8;
        for &byte in text[8..].iter().take(3) {
            if !byte.is_ascii_digit() {
                break;
            }
            value = value * 10 + u64::from(byte - b'0');
            count += 1;
        }
        return u32::try_from(value).ok().filter(|_| count <= 10).map(|value| (value, count));
    }
    let count = not_digits.trailing_zeros() / 8;
    if count == 0 {
        return None;
    }
    Some((decimal(digits << (64 - 8 * count)), count as usize))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Parses the same field character by character.
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
        fn fixed_point_of_column_characters_matches_plain(field in proptest::collection::vec("[ 0-9.+-]", 7)) {
            let field: [u8; 7] = field.concat().into_bytes().try_into().unwrap();
            prop_assert_eq!(fixed_point::<4>(field), plain(&field, 4));
            prop_assert_eq!(fixed_point::<2>(field), plain(&field, 2));
        }

        #[test]
        fn fixed_point_of_any_bytes_matches_plain(field in any::<[u8; 7]>()) {
            prop_assert_eq!(fixed_point::<4>(field), plain(&field, 4));
            prop_assert_eq!(fixed_point::<2>(field), plain(&field, 2));
        }

        #[test]
        fn hex_of_text_matches_from_str_radix(field in prop_oneof!["[0-9a-fA-F]{8}", "[0-9a-gA-G@`:/]{8}", "[ -~]{8}"]) {
            let bytes: [u8; 8] = field.as_bytes().try_into().unwrap();
            let all = field.bytes().all(|byte| byte.is_ascii_hexdigit());
            prop_assert_eq!(hex(bytes), u32::from_str_radix(&field, 16).ok().filter(|_| all));
        }

        #[test]
        fn hex_of_any_bytes_matches_from_str_radix(bytes in any::<[u8; 8]>()) {
            let text = std::str::from_utf8(&bytes).ok().filter(|text| text.bytes().all(|byte| byte.is_ascii_hexdigit()));
            prop_assert_eq!(hex(bytes), text.and_then(|text| u32::from_str_radix(text, 16).ok()));
        }

        #[test]
        fn unsigned_stops_at_first_non_digit(number in prop_oneof!["[0-9]{0,12}", any::<u32>().prop_map(|number| number.to_string())], rest in "[,*\r -~]{0,9}") {
            let text = format!("{number}{rest}");
            let count = text.bytes().take_while(u8::is_ascii_digit).count();
            let expected = text[..count].parse().ok().filter(|_| count <= 10).map(|value: u32| (value, count));
            prop_assert_eq!(unsigned(text.as_bytes()), expected);
        }

        #[test]
        fn fixed_point_roundtrips_formatted_values(hundredths in -99_999_i32..=99_999) {
            let field: [u8; 7] = format!("{:7.2}", f64::from(hundredths) / 100.0).into_bytes().try_into().unwrap();
            prop_assert_eq!(fixed_point::<4>(field), Some((hundredths < 0, hundredths.unsigned_abs())));
            let field: [u8; 7] = format!("{:7.4}", f64::from(hundredths) / 1e4).into_bytes().try_into().unwrap();
            prop_assert_eq!(fixed_point::<2>(field), Some((hundredths < 0, hundredths.unsigned_abs())));
        }
    }
}
