//! The colour of an intensity.
//!
//! Colours are display values (sRGB) from 0 to 1; compositing uses these values directly.

use super::curve::{Curve, CurveError, Piecewise};
use super::error::TransferError;
use crate::real::{Number, dot};

/// Points of the perceptual map. Colours are interpolated between them in sRGB; steps stay even
/// to 2 %.
const MAP_POINTS: u32 = 33;
/// Weight of each primary in the brightness of a display (ITU-R BT.709).
const LUMA: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// The colour of an intensity.
#[derive(Debug, Clone, PartialEq)]
pub enum Colour {
    /// Grey of this brightness.
    Grey(Curve),
    /// Red, green and blue.
    Map(Piecewise<3>),
}

impl Colour {
    /// Creates a grey ramp, black at the window's low end, white at its high end.
    ///
    /// # Errors
    /// [`TransferError::Window`].
    pub fn grey(window: [f64; 2]) -> Result<Self, TransferError> {
        let [low, high] = window;
        Curve::new(&[(low, 0.0), (high, 1.0)]).map(Self::Grey).map_err(|_| TransferError::Window(window))
    }

    /// Creates a map from near black over violet, red and orange to pale yellow, along which
    /// equal steps of intensity look equal.
    ///
    /// In [OKLab](https://bottosson.github.io/posts/oklab/) lightness runs evenly from 0.15 to
    /// 0.97. The hue turns from 285° to 470°, and the chroma rises to 0.16 and back along a
    /// parabola. The points are then set at equal distances along that path.
    ///
    /// # Errors
    /// [`TransferError::Window`].
    pub fn perceptual(window: [f64; 2]) -> Result<Self, TransferError> {
        let [low, high] = window;
        let last = f64::from(MAP_POINTS - 1);
        let points: Vec<_> = (0..MAP_POINTS)
            .zip(even_path())
            .map(|(index, colour)| {
                let t = f64::from(index) / last;
                (low * (1.0 - t) + high * t, colour)
            })
            .collect();
        Piecewise::through(&points).map(Self::Map).map_err(|_| TransferError::Window(window))
    }

    /// Creates a map that interpolates linearly between (intensity, [red, green, blue]).
    ///
    /// # Errors
    /// [`CurveError`], in the same cases as [`Piecewise::through`].
    pub fn list(points: &[(f64, [f64; 3])]) -> Result<Self, CurveError> {
        Piecewise::through(points).map(Self::Map)
    }

    /// Returns whether every colour is a grey, so that one channel holds it.
    pub fn is_grey(&self) -> bool {
        match self {
            Self::Grey(_) => true,
            Self::Map(map) => map.channels_agree(),
        }
    }

    /// Returns the intensities of the first and the last colour.
    pub fn span(&self) -> [f64; 2] {
        match self {
            Self::Grey(curve) => curve.span(),
            Self::Map(map) => map.span(),
        }
    }

    /// Returns red, green and blue.
    #[inline(always)]
    pub fn at<T: Number>(&self, value: T) -> [T; 3] {
        match self {
            Self::Grey(curve) => [curve.value(value); 3],
            Self::Map(map) => map.at(value),
        }
    }

    /// Returns the brightness: the grey itself, or the luma of a colour.
    #[inline(always)]
    pub fn intensity<T: Number>(&self, value: T) -> T {
        match self {
            Self::Grey(curve) => curve.value(value),
            Self::Map(map) if map.channels_agree() => map.at(value)[0],
            Self::Map(map) => {
                let [red, green, blue] = LUMA;
                dot(map.at(value), [T::from_f64(red), T::from_f64(green), T::from_f64(blue)])
            }
        }
    }
}

/// Returns the perceptual map's path at `t` from 0 to 1, in OKLab.
fn path(t: f64) -> [f64; 3] {
    let hue = (285.0 + 185.0 * t).to_radians();
    let chroma = 0.16 * 4.0 * t * (1.0 - t);
    [0.15 + 0.82 * t, chroma * libm::cos(hue), chroma * libm::sin(hue)]
}

/// Returns [`MAP_POINTS`] colours at equal distances along the path, sRGB.
fn even_path() -> impl Iterator<Item = [f64; 3]> {
    /// Chords that approximate the arc; they are shorter than it by 1e-7.
    const CHORDS: u32 = 4096;
    let at = |chord: u32| f64::from(chord) / f64::from(CHORDS);
    let mut length = vec![0.0];
    for chord in 0..CHORDS {
        let ([l0, a0, b0], [l1, a1, b1]) = (path(at(chord)), path(at(chord + 1)));
        let (l, a, b) = (l1 - l0, a1 - a0, b1 - b0);
        length.push(length[length.len() - 1] + (l * l + a * a + b * b).sqrt());
    }
    let whole = length[length.len() - 1];
    (0..MAP_POINTS).map(move |point| {
        let target = whole * f64::from(point) / f64::from(MAP_POINTS - 1);
        let chord = length.partition_point(|reached| *reached < target).clamp(1, length.len() - 1);
        let share = (target - length[chord - 1]) / (length[chord] - length[chord - 1]);
        srgb(path((chord as f64 - 1.0 + share) / f64::from(CHORDS)))
    })
}

/// Converts OKLab to sRGB; both matrices are those of the colour space's definition.
fn srgb([lightness, a, b]: [f64; 3]) -> [f64; 3] {
    let cube = |x: f64| x * x * x;
    let l = cube(lightness + 0.396_337_777_4 * a + 0.215_803_757_3 * b);
    let m = cube(lightness - 0.105_561_345_8 * a - 0.063_854_172_8 * b);
    let s = cube(lightness - 0.089_484_177_5 * a - 1.291_485_548_0 * b);
    let linear = [
        4.076_741_662_1 * l - 3.307_711_591_3 * m + 0.230_969_929_2 * s,
        -1.268_438_004_6 * l + 2.609_757_401_1 * m - 0.341_319_396_5 * s,
        -0.004_196_086_3 * l - 0.703_418_614_7 * m + 1.707_614_701_0 * s,
    ];
    linear.map(|x| if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * libm::pow(x, 1.0 / 2.4) - 0.055 })
}
