//! Colour schemes of values in pictures of planes.

use image::Rgb;

use super::legend::{Entry, short};
use super::panel::grey;
use super::style::UNSEEN;

/// Colour scheme of values.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Shades {
    /// From black to white.
    #[default]
    Greys,
    /// For differences, with a window centred on 0: blue below, white at 0, orange above, darker
    /// with distance. Readable with any colour vision; in grey the darkness shows that there is
    /// a difference. Voxels without a difference are grey.
    Diverging,
}

/// Drawn content of a voxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum VoxelValue {
    /// The value of a seen voxel.
    Seen(f32),
    /// The value of an unseen voxel that was [filled](crate::fill).
    Filled(f32),
}

impl From<f32> for VoxelValue {
    fn from(value: f32) -> Self {
        Self::Seen(value)
    }
}

impl VoxelValue {
    pub(super) fn value(self) -> f32 {
        match self {
            Self::Seen(value) | Self::Filled(value) => value,
        }
    }

    /// Returns the value, if it was seen.
    pub(super) fn seen(self) -> Option<f32> {
        if let Self::Seen(value) = self { Some(value) } else { None }
    }

    /// Returns the value if it contributes to a pixel whose nearest voxel is `nearest`. Seen
    /// pixels use only seen voxels.
    pub(super) fn beside(self, nearest: Self) -> Option<f32> {
        if matches!(nearest, Self::Filled(_)) { Some(self.value()) } else { self.seen() }
    }

    /// Returns another value of the same kind.
    pub(super) fn with(self, value: f32) -> Self {
        match self {
            Self::Seen(_) => Self::Seen(value),
            Self::Filled(_) => Self::Filled(value),
        }
    }
}

/// Tint of filled voxels: orange, distinct from greys and from the blue of unseen voxels, and
/// its share.
const FILLED: ([f32; 3], f32) = ([235.0, 140.0, 20.0], 0.4);

/// The diverging colours from the lowest value to the highest; colours are interpolated between
/// them.
const DIVERGING: [[u8; 3]; 5] = [[12, 44, 116], [70, 146, 206], [247, 247, 247], [238, 142, 50], [124, 48, 4]];
/// Colour of voxels without a difference: a grey that no difference has.
const NO_DIFFERENCE: Rgb<u8> = Rgb([72, 72, 74]);

impl Shades {
    pub(super) fn colour(self, value: f32, window: [f32; 2]) -> Rgb<u8> {
        let grey = grey(value, window);
        match self {
            Self::Greys => Rgb([grey; 3]),
            Self::Diverging => {
                let at = f32::from(grey) / 255.0 * (DIVERGING.len() - 1) as f32;
                let low = (at.floor() as usize).min(DIVERGING.len() - 2);
                let part = at - low as f32;
                let mix = |c: usize| {
                    let [a, b] = [DIVERGING[low][c], DIVERGING[low + 1][c]].map(f32::from);
                    (a + part * (b - a)).round() as u8
                };
                Rgb([mix(0), mix(1), mix(2)])
            }
        }
    }

    /// Returns the colour of a voxel; filled ones are tinted.
    pub(super) fn of(self, value: VoxelValue, window: [f32; 2]) -> Rgb<u8> {
        let Rgb(plain) = self.colour(value.value(), window);
        let (tint, share) = FILLED;
        match value {
            VoxelValue::Seen(_) => Rgb(plain),
            VoxelValue::Filled(_) => {
                let mixed = |c: usize| f32::from(plain[c]) + share * (tint[c] - f32::from(plain[c]));
                Rgb([0, 1, 2].map(|c| mixed(c).round() as u8))
            }
        }
    }

    /// Returns the legend entry of the tint, on a middle grey.
    pub(super) fn filled(self, [low, high]: [f32; 2]) -> Entry {
        Entry::Swatch { colour: self.of(VoxelValue::Filled(0.5 * (low + high)), [low, high]), label: "filled" }
    }

    pub(super) fn nothing(self) -> Rgb<u8> {
        match self {
            Self::Greys => UNSEEN,
            Self::Diverging => NO_DIFFERENCE,
        }
    }

    /// Returns the legend entries of the colours.
    pub(super) fn entries(self, window: [f32; 2]) -> [Entry; 2] {
        match self {
            Self::Greys => [Entry::greys(window), Entry::unseen()],
            Self::Diverging => {
                let colours = (0..=u8::MAX).map(|step| self.colour(f32::from(step), [0.0, 255.0])).collect();
                let [low, high] = window.map(|end| short(f64::from(end)));
                [
                    Entry::Ramp { low: format!("first lower {low}"), high: format!("{high} higher"), colours },
                    Entry::Swatch { colour: NO_DIFFERENCE, label: "not in both" },
                ]
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filled_colour_differs_from_seen_and_unseen() {
        for value in 0..=255_u8 {
            let Rgb([r, g, b]) = Shades::Greys.of(VoxelValue::Filled(value.into()), [0.0, 255.0]);
            assert!(r >= g + 20 && g >= b + 20, "{value}: {r} {g} {b}");
            assert_eq!(Shades::Greys.of(VoxelValue::Seen(value.into()), [0.0, 255.0]), Rgb([value; 3]));
        }
        assert!(UNSEEN.0[2] > UNSEEN.0[0], "blue, not orange");
    }

    #[test]
    fn differences_are_blue_white_orange() {
        let colours =
            [-10.0, -3.0, 0.0, 3.0, 99.0].map(|value| Shades::Diverging.colour(value, [-10.0, 10.0]).0.map(i32::from));
        let [r, g, b] = colours[2];
        assert!(r.min(g).min(b) > 235, "white: {:?}", colours[2]);
        for (below, above) in [(0, 4), (1, 3)] {
            assert!(colours[below][2] > colours[below][0] + 40, "blue: {:?}", colours[below]);
            assert!(colours[above][0] > colours[above][2] + 40, "orange: {:?}", colours[above]);
        }
        // Darker with distance from 0, so that it is readable without colour.
        let sum = |at: usize| colours[at].iter().sum::<i32>();
        assert!(sum(0) < sum(1) && sum(1) < sum(2) && sum(4) < sum(3) && sum(3) < sum(2));
        let none = Shades::Diverging.nothing().0;
        assert!(colours.iter().all(|c| *c != none.map(i32::from)) && none != UNSEEN.0, "none is no difference's");
    }
}
