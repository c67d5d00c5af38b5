//! Weights of pixels by the shadows of bone, gas and stones.
//!
//! A strong reflector or absorber leaves its beam dark from there on. Another view of the same
//! place may be bright, and the mean of both is wrong. A pixel is therefore weighted by the mean
//! grey level of its own beam, from the pixel on: its *tail*. A vessel or a cyst is dark, too, but
//! bright behind, so that its weight stays. Tails are long for that reason: at 12 mm, the weights
//! of larger ones fell.
//!
//! With x, the tail's part of the picture's median grey, the weight is c² and no less than
//! [`LEAST`], where c = 1/(1 + e^((level − x)/width)). It multiplies the weight across the plane
//! of each voxel; the filtered values stay as they are. Where only one view has seen a place, its
//! value therefore stays, too, with little weight.
//!
//! A picture that is dark in most places, or at the end of all beams, tells nothing: there the
//! depth ends, or nothing echoes. All its pixels then count in full.

mod beams;
mod picture;

use serde::{Deserialize, Serialize};

pub(crate) use picture::PictureWeights;

/// Least weight of a pixel: less, and a place that one slice alone has seen, in shadow, would lie
/// below [`SEEN`](volume::read::SEEN).
pub const LEAST: f64 = 0.01;

/// The weights' settings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ShadowWeights {
    /// Length of the beam behind a pixel whose mean is taken, mm.
    pub tail_mm: f64,
    /// Neighbouring beams over which it is taken, out of [`BEAMS`]; an even number counts as the
    /// next odd one.
    pub beams: u32,
    /// The tail, as a part of the picture's median grey, at which c is a half.
    pub level: f64,
    /// Width of the transition, as a part of the picture's median grey.
    pub width: f64,
}

/// Number of beams that a picture is divided into.
pub const BEAMS: usize = 128;

impl Default for ShadowWeights {
    fn default() -> Self {
        Self { tail_mm: 50.0, beams: 3, level: 0.5, width: 0.08 }
    }
}

impl ShadowWeights {
    /// Returns the name and the bounds of a number that is out of them.
    pub(super) fn beyond(&self) -> Option<(&'static str, f64, [f64; 2])> {
        let Self { tail_mm, beams, level, width } = *self;
        let numbers = [
            ("the length of their tails, mm,", tail_mm, [0.1, 1e3]),
            ("the number of their beams", f64::from(beams), [1.0, BEAMS as f64]),
            ("their level", level, [0.01, 1.0]),
            ("the width of their transition", width, [0.001, 1.0]),
        ];
        // NaN is in no range.
        numbers.into_iter().find(|(_, value, [low, high])| !(low..=high).contains(&value))
    }

    /// Returns the weight of a pixel by its tail, as a part of the picture's median grey.
    pub(crate) fn weight(&self, tail: f64) -> f64 {
        let c = 1.0 / (1.0 + libm::exp((self.level - tail) / self.width));
        (c * c).max(LEAST)
    }
}

impl std::fmt::Display for ShadowWeights {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { tail_mm, beams, level, width } = self;
        write!(f, "tails of {tail_mm} mm over {beams} of {BEAMS} beams, level {level}, width {width}")
    }
}

#[cfg(test)]
mod tests;
