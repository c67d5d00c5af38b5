//! Which colours values have in pictures of planes.

use image::Rgb;

use super::legend::{Entry, short};
use super::panel::grey;
use super::planes::UNSEEN;

/// Which colours values have.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Shades {
    /// From black to white.
    #[default]
    Greys,
    /// Of differences, with a window that has 0 in its middle: blue below, white at 0, orange above, darker the farther. Told apart whatever the eye's colour vision,
    /// and in grey by how dark they are that there is one. Voxels without a difference are grey.
    Diverging,
}

/// The diverging colours from the lowest value to the highest, between which colours are mixed.
const DIVERGING: [[u8; 3]; 5] = [[12, 44, 116], [70, 146, 206], [247, 247, 247], [238, 142, 50], [124, 48, 4]];
/// Where there is no difference: a grey, which no difference has.
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

    pub(super) fn nothing(self) -> Rgb<u8> {
        match self {
            Self::Greys => UNSEEN,
            Self::Diverging => NO_DIFFERENCE,
        }
    }

    /// What the colours mean.
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
    fn differences_are_blue_below_white_at_zero_and_orange_above_and_none_is_grey() {
        let colours =
            [-10.0, -3.0, 0.0, 3.0, 99.0].map(|value| Shades::Diverging.colour(value, [-10.0, 10.0]).0.map(i32::from));
        let [r, g, b] = colours[2];
        assert!(r.min(g).min(b) > 235, "white: {:?}", colours[2]);
        for (below, above) in [(0, 4), (1, 3)] {
            assert!(colours[below][2] > colours[below][0] + 40, "blue: {:?}", colours[below]);
            assert!(colours[above][0] > colours[above][2] + 40, "orange: {:?}", colours[above]);
        }
        // Darker the farther, so that it reads without colour, too.
        let sum = |at: usize| colours[at].iter().sum::<i32>();
        assert!(sum(0) < sum(1) && sum(1) < sum(2) && sum(4) < sum(3) && sum(3) < sum(2));
        let none = Shades::Diverging.nothing().0;
        assert!(colours.iter().all(|c| *c != none.map(i32::from)) && none != UNSEEN.0, "none is no difference's");
    }
}
