//! Grey of pictures in several channels: the one place where colour is given up.
//!
//! Channels are, by their number: grey; grey and opacity; red, green and blue; these and opacity. Opacity says nothing of an echo and is left out. Of a colour
//! remains its luma by ITU-R BT.601, as scanners' video and JPEG have it: 0.299 red + 0.587 green + 0.114 blue. 8 and 16 bits are weighed in integers of 2⁻¹⁶,
//! rounded once, so that grey stays what it was and every machine makes the same bits; other types in single precision.

/// Red's, green's and blue's part, 2⁻¹⁶; together 1.
const LUMA: [u32; 3] = [19_595, 38_470, 7_471];
const HALF: u32 = 1 << 15;

/// A scalar of which luma is made.
pub(super) trait Weighed: Copy {
    fn luma(rgb: [Self; 3]) -> Self;
}

/// At most 2¹⁶ − 1 times 2¹⁶, and a half: within 32 bits.
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

/// Grey of pixels of so many channels, 1 to 4.
pub(super) fn of<T: Weighed>(pixels: Vec<T>, channels: u32) -> Vec<T> {
    match channels {
        2 => pixels.as_chunks::<2>().0.iter().map(|[grey, _]| *grey).collect(),
        3 => pixels.as_chunks::<3>().0.iter().map(|rgb| T::luma(*rgb)).collect(),
        4 => pixels.as_chunks::<4>().0.iter().map(|[r, g, b, _]| T::luma([*r, *g, *b])).collect(),
        _ => pixels,
    }
}

/// What is done to pictures of so many channels, in words; `None` of grey ones.
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
    fn grey_stays_what_it_was_and_colours_have_their_parts() {
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
    fn the_integers_are_the_definition_rounded() {
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
