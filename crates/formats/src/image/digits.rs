//! Parses pixels written as decimal text.

use std::io::{self, BufRead};

use sonoweave_core::reading::PixelType;

use crate::image::numbers::number;

/// Longest accepted number, bytes.
const LONGEST: usize = 400;

/// Double precision represents all whole numbers up to here: 2⁵³.
const MOST_EXACT: f64 = 9_007_199_254_740_992.0;

/// Reads the next number's text; `None` at the end. Whitespace or commas separate numbers. Adds
/// the bytes read to `consumed`.
pub(super) fn token(reader: &mut impl BufRead, consumed: &mut u64) -> io::Result<Option<String>> {
    let parts = |byte: &u8| byte.is_ascii_whitespace() || *byte == b',';
    let mut token = Vec::new();
    loop {
        let bytes = match reader.fill_buf() {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(error) => return Err(error),
        };
        let before = if token.is_empty() { bytes.iter().take_while(|byte| parts(byte)).count() } else { 0 };
        let length = bytes[before..].iter().position(parts);
        let until = length.map_or(bytes.len(), |length| before + length);
        token.extend_from_slice(&bytes[before..until.min(before + LONGEST)]);
        let (ends, taken) = (bytes.is_empty() || (length.is_some() && !token.is_empty()), until);
        reader.consume(taken);
        *consumed += taken as u64;
        if ends || token.len() >= LONGEST {
            break;
        }
    }
    Ok((!token.is_empty()).then(|| String::from_utf8_lossy(&token).into_owned()))
}

/// Parses the number into `scalar`, in native byte order. A whole number may have a point or an
/// exponent (`7.0`, `1e+06`): MetaIO writes all numbers via double precision. Returns `None` for
/// other texts, and for values outside the type.
pub(super) fn put(token: &str, pixel: PixelType, scalar: &mut [u8]) -> Option<()> {
    macro_rules! whole {
        ($kind:ty) => {
            token
                .parse()
                .ok()
                .or_else(|| spelled_out(token)?.parse().ok())
                .map(|value: $kind| scalar.copy_from_slice(&value.to_ne_bytes()))
        };
    }
    match pixel {
        PixelType::U8 => whole!(u8),
        PixelType::I8 => whole!(i8),
        PixelType::U16 => whole!(u16),
        PixelType::I16 => whole!(i16),
        PixelType::U32 => whole!(u32),
        PixelType::I32 => whole!(i32),
        PixelType::U64 => whole!(u64),
        PixelType::I64 => whole!(i64),
        // Parsed directly as F32: parsing via double precision would round twice.
        PixelType::F32 => {
            let value = token.parse().ok().or_else(|| number(token).map(|value| value as f32));
            value.map(|value: f32| scalar.copy_from_slice(&value.to_ne_bytes()))
        }
        PixelType::F64 => number(token).map(|value| scalar.copy_from_slice(&value.to_ne_bytes())),
    }
}

/// Returns the digits of a whole number written with a point or an exponent. Refuses values
/// beyond 2⁵³, which double precision does not represent exactly.
fn spelled_out(token: &str) -> Option<String> {
    let value: f64 = token.parse().ok()?;
    (value.fract() == 0.0 && value.abs() <= MOST_EXACT).then(|| format!("{:.0}", value + 0.0))
}

#[cfg(test)]
mod tests {
    use std::io::BufReader;

    use super::*;

    #[test]
    fn token_crosses_buffer_ends() {
        let text = b"  12, -3\n4.5e-3\t7";
        for capacity in 1..=text.len() {
            let mut reader = BufReader::with_capacity(capacity, &text[..]);
            let mut consumed = 0;
            let mut found = Vec::new();
            while let Some(token) = token(&mut reader, &mut consumed).unwrap() {
                found.push(token);
            }
            assert_eq!((found, consumed), (["12", "-3", "4.5e-3", "7"].map(str::to_owned).to_vec(), text.len() as u64));
        }
        let endless = vec![b'1'; 1 << 20];
        let got = token(&mut &*endless, &mut 0).unwrap().unwrap();
        assert_eq!(got.len(), LONGEST, "no more than a number may have is held");
    }

    #[test]
    fn put_refuses_values_outside_type() {
        let mut two = [0; 2];
        put("-300", PixelType::I16, &mut two).unwrap();
        assert_eq!(i16::from_ne_bytes(two), -300);
        for (spelled, whole) in [("1.0", 1), ("-3e+02", -300), ("3.2767e4", i16::MAX)] {
            put(spelled, PixelType::I16, &mut two).unwrap();
            assert_eq!(i16::from_ne_bytes(two), whole, "{spelled}");
        }
        for odd in ["1.5", "40000", "1e5", "1e", "nan", "inf", "1e400", "0x10", ""] {
            assert!(put(odd, PixelType::I16, &mut two).is_none(), "{odd}");
        }
        let mut eight = [0; 8];
        put("9007199254740992.0", PixelType::U64, &mut eight).unwrap();
        assert_eq!(u64::from_ne_bytes(eight), 1 << 53);
        assert!(put("1e18", PixelType::U64, &mut eight).is_none(), "its digits are not all there");
        assert!(put("-0.0", PixelType::U16, &mut two).is_some() && put("-1", PixelType::U16, &mut two).is_none());
        let mut four = [0; 4];
        put("nan", PixelType::F32, &mut four).unwrap();
        assert!(f32::from_ne_bytes(four).is_nan());
        put("0.1", PixelType::F32, &mut four).unwrap();
        assert_eq!(f32::from_ne_bytes(four), 0.1);
    }
}
