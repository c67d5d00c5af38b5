//! Transfer functions by name.
//!
//! They are made for a range of intensities, black to white: 0 to 255 for 8 bit images.
//! Positions below are shares of that range, gradients shares of it per mm.

use super::error::TransferError;
use super::preset_names::PRESETS;
use super::{Colour, Curve, Opacity, Transfer};

/// Unit length of the opacities, mm.
const UNIT_MM: f64 = 1.0;
/// Window for surfaces. Most visible samples are no brighter than the surfaces themselves, so
/// black lies below the darkest and white among the brighter ones.
const SURFACES: [f64; 2] = [-0.2, 0.7];

impl Transfer {
    /// Name and purpose of every preset; the first is the default.
    pub const PRESETS: [(&'static str, &'static str); 5] = PRESETS;

    /// Returns a preset for intensities from `range[0]` (black) to `range[1]` (white).
    ///
    /// # Errors
    /// [`TransferError::Name`] for a name that is not in [`Self::PRESETS`],
    /// [`TransferError::Range`] for a range that is empty or not finite.
    pub fn preset(name: &str, range: [f64; 2]) -> Result<Self, TransferError> {
        let [low, high] = range;
        let width = high - low;
        if !(width > 0.0 && width.is_finite()) {
            return Err(TransferError::Range(range));
        }
        let level = |share: f64| low + share * width;
        let curve = |points: &[(f64, f64)]| {
            Curve::new(&points.iter().map(|&(share, opacity)| (level(share), opacity)).collect::<Vec<_>>())
        };
        let rising = |points: &[(f64, f64)]| {
            Curve::new(&points.iter().map(|&(share, factor)| (share * width, factor)).collect::<Vec<_>>())
        };
        let grey = |opacity, [black, white]: [f64; 2]| {
            Self::new(opacity, UNIT_MM, Colour::grey([level(black), level(white)])?)
        };
        let made = |opacity| grey(opacity, [0.0, 1.0]);
        match name {
            "tissue" => {
                let soft = grey(Opacity::Curve(curve(&[(0.24, 0.0), (0.36, 0.3), (0.46, 0.95)])?), SURFACES)?;
                soft.with_gradient(rising(&[(0.0, 0.3), (0.1, 1.0)])?)
            }
            "bone" => made(Opacity::Curve(curve(&[(0.45, 0.0), (0.65, 0.4), (0.85, 0.95)])?)),
            "surface" => grey(Opacity::Isovalue { value: level(0.5), thickness_mm: 0.7, opacity: 0.95 }, SURFACES),
            "xray" => made(Opacity::Curve(curve(&[(0.0, 0.02)])?)),
            "phantom" => made(Opacity::Curve(curve(&[(0.3, 0.0), (0.4, 0.15), (0.55, 0.7), (0.8, 0.95)])?)),
            _ => Err(TransferError::Name(name.to_owned())),
        }
    }
}
