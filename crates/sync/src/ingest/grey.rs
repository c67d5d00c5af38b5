//! Conversion of multi-channel images to grey: the one place where colour is discarded.
//!
//! Channels by their number: grey; grey and opacity; red, green, blue; red, green, blue and
//! opacity. Opacity carries no echo information and is ignored. Colours become luma by ITU-R
//! BT.601, as in scanners' video and JPEG: 0.299 red + 0.587 green + 0.114 blue. 8 and 16 bit
//! values are weighted in integers of 2⁻¹⁶ and rounded once. Grey colours thus keep their
//! value, and all machines give the same bits. Other types are weighted in single precision.

/// Weights of red, green and blue, in 2⁻¹⁶; their sum is 1.
const LUMA: [u32; 3] = [19_595, 38_470, 7_471];
const HALF: u32 = 1 << 15;

/// A scalar type from which luma can be computed.
pub(super) trait Weighed: Copy {
    fn luma(rgb: [Self; 3]) -> Self;
}

/// Returns the weighted sum, at most (2¹⁶ − 1)·2¹⁶ plus a half: within 32 bits.
fn weighed(rgb: [u32; 3]) -> u32 {
    (LUMA[0] * rgb[0] + LUMA[1] * rgb[1] + LUMA[2] * rgb[2] + HALF) >> 16
}

impl Weighed for u8 {
    fn luma(rgb: [Self; 3]) -> Self {
        weighed(rgb.map(u32::from)) as Self
    }
}

impl Weighed for u16 {
    fn luma(rgb: [Self; 3]) -> Self {
        weighed(rgb.map(u32::from)) as Self
    }
}

impl Weighed for f32 {
    fn luma([red, green, blue]: [Self; 3]) -> Self {
        let [r, g, b] = LUMA.map(|part| part as Self / 65_536.0);
        blue.mul_add(b, green.mul_add(g, red * r))
    }
}

/// Returns the grey values of pixels with 1 to 4 channels.
pub(super) fn of<T: Weighed>(pixels: Vec<T>, channels: u32) -> Vec<T> {
    match channels {
        2 => pixels.as_chunks::<2>().0.iter().map(|[grey, _]| *grey).collect(),
        3 => pixels.as_chunks::<3>().0.iter().map(|rgb| T::luma(*rgb)).collect(),
        4 => pixels.as_chunks::<4>().0.iter().map(|[r, g, b, _]| T::luma([*r, *g, *b])).collect(),
        _ => pixels,
    }
}

/// Describes the conversion for this number of channels; `None` for grey images.
pub fn described(channels: u32) -> Option<String> {
    match channels {
        2 => Some(
            "of 2 channels a pixel the first is the grey value; the second is taken for opacity and left out".into(),
        ),
        3 | 4 => {
            let opacity = if channels == 4 { ", without the fourth channel" } else { "" };
            Some(format!("of {channels} channels a pixel the luma is the grey value (ITU-R BT.601{opacity})"))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grey_keeps_value_and_colours_are_weighted() {
        for level in 0..=u8::MAX {
            assert_eq!(u8::luma([level; 3]), level);
        }
        for level in [0, 1, 255, 256, 32_767, 32_768, 65_534, 65_535_u16] {
            assert_eq!(u16::luma([level; 3]), level);
        }
        assert_eq!([[255, 0, 0], [0, 255, 0], [0, 0, 255]].map(u8::luma), [76, 150, 29]);
        assert_eq!(f32::luma([1.0; 3]), 1.0);
        assert!((f32::luma([100.0, 10.0, 1.0]) - 35.884).abs() < 2e-3);
    }

    #[test]
    fn integer_luma_is_definition_rounded() {
        for (r, g, b) in (0..=255_u8).step_by(5).flat_map(|r| (0..=255_u8).step_by(3).map(move |g| (r, g, r ^ g))) {
            let exact = 0.299 * f64::from(r) + 0.587 * f64::from(g) + 0.114 * f64::from(b);
            assert!((f64::from(u8::luma([r, g, b])) - exact).abs() <= 0.51, "{r} {g} {b}");
        }
    }

    #[test]
    fn channels_are_known_by_their_number() {
        assert_eq!(of(vec![1_u8, 2, 3], 1), [1, 2, 3]);
        assert_eq!(of(vec![1_u8, 99, 3, 98], 2), [1, 3]);
        assert_eq!(of(vec![255_u8, 0, 0, 0, 0, 255], 3), [76, 29]);
        assert_eq!(of(vec![255_u8, 0, 0, 1, 0, 0, 255, 2], 4), [76, 29]);
        assert!(described(1).is_none() && described(3).unwrap().contains("BT.601"));
    }
}
