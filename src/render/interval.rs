//! Which bricks of matter need no look: those of which every sample is transparent because of the intensities that were seen there.
//!
//! The intensity of a sample is c / s, of c = Σ seen · intensity and s = Σ seen over the eight voxels about it: a mean of those that were seen, and it lies
//! between the least and the largest of a brick. So where all of these lie below the isovalue, or all on one side of the interval that the transfer function
//! shows, every sample of the brick is transparent, and need not be taken.
//!
//! That must hold of the samples as they are computed, to the bit. Each of three interpolations in single precision rounds by 3·2⁻²⁴ of the largest
//! number at most: c by 9·2⁻²⁴ of the largest intensity M, s by 9·2⁻²⁴, and so c / s by 37·2⁻²⁴ M where s is one half or more. Voxels therefore count as beside
//! the interval only at a distance of 2⁻¹⁸ of a [largest intensity](REACH), beyond which they do not count as beside it at all. Of an isosurface s is one half or
//! more wherever it is looked at. A sample that is classified may have been seen by any share, and the error of c / s then has no bound that is of use: there
//! only bricks count that were seen whole.

use super::mode::Keeps;
use super::settings::RenderSettings;
use super::shade::Lit;
use crate::volume::brick::EDGE;

/// The largest intensity that is taken for beside an interval, in the larger of its ends, or of [`LEAST`] grey levels.
const REACH: f32 = 64.0;
const LEAST: f32 = 16.0;
/// Rounding of a sample's intensity, in the largest intensity about it; more than 37·2⁻²⁴.
const ROUNDING: f32 = 1.0 / (1 << 18) as f32;

/// Where a voxel's intensity lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    /// Nowhere: the voxel is transparent, or was not seen.
    Clear,
    /// In the interval, or not certainly beside it.
    Shown,
    /// Below it.
    Under,
    /// Above it.
    Over,
}

/// Of these there are so many.
pub(super) const SIDES: usize = 4;

/// The intensities of which anything is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Interval {
    /// Intensities that are certainly below and above it, least and largest.
    under: [f32; 2],
    over: [f32; 2],
    /// Whether only bricks count that were seen whole.
    whole: bool,
    /// See [`Self::reach`].
    reach: Option<i64>,
}

/// No intensity.
const NONE: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

impl Interval {
    /// Of which nothing lies beside it: all that is not transparent is looked at.
    pub(super) const ALL: Self = Self { under: NONE, over: NONE, whole: false, reach: None };

    /// Of the intensities that matter of which samples are made.
    pub(super) fn of(settings: &RenderSettings) -> Self {
        debug_assert_eq!(settings.mode.keeps(), Keeps::Matter, "what voxels keep is an intensity");
        let reach = reach(settings.step);
        match settings.mode.isovalue() {
            Some(isovalue) => Self { reach, ..Self::between([isovalue, f64::INFINITY], false) },
            None => match settings.transfer.visible() {
                Some(interval) => Self { reach, ..Self::between(interval, true) },
                None => Self { under: [f32::NEG_INFINITY, f32::INFINITY], reach, ..Self::ALL },
            },
        }
    }

    fn between(ends: [f64; 2], whole: bool) -> Self {
        let [low, high] = ends.map(|end| end as f32);
        let most = [low, high].into_iter().map(f32::abs).filter(|end| end.is_finite()).fold(LEAST, f32::max) * REACH;
        let margin = most * ROUNDING;
        Self { under: [-most, low - margin], over: [high + margin, most], whole, reach: None }
    }

    /// On which side of it a voxel lies that keeps its intensity; of voxels that keep their light there are none beside [all](Self::ALL).
    #[inline(always)]
    pub(super) fn side<const C: usize>(&self, voxel: &Lit<f32, C>) -> Side {
        let (value, seen) = (voxel.colour[0], voxel.alpha > 0.0);
        if !seen {
            Side::Clear
        } else if self.under[0] <= value && value <= self.under[1] {
            Side::Under
        } else if self.over[0] <= value && value <= self.over[1] {
            Side::Over
        } else {
            Side::Shown
        }
    }

    /// Whether a sample between so many voxels of each side may be anything but transparent.
    pub(super) fn may_show(&self, sides: [u16; SIDES]) -> bool {
        let any = |side: Side| sides[side as usize] > 0;
        let beside = any(Side::Under) || any(Side::Over);
        any(Side::Shown) || any(Side::Under) && any(Side::Over) || self.whole && beside && any(Side::Clear)
    }

    /// Bricks to each side of a brick in which a sample that depends on its voxels can lie; `None` where that is not to be known, or all of them are seen.
    pub(super) fn reach(&self) -> Option<i64> {
        self.reach
    }
}

/// A sample lies within a voxel of those that it is made of, and the surface between it and the sample before within a step of it.
fn reach(step: f64) -> Option<i64> {
    // A voxel more than is needed, lest a sample be rounded into the next brick.
    (step + 2.0 <= EDGE as f64).then_some(1)
}
