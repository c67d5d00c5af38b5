//! Which bricks of matter need no look: those of which every sample is transparent because of the intensities that were seen there.
//!
//! The intensity of a sample is c / s, of c = Σ seen · intensity and s = Σ seen over the eight voxels about it: a mean of those that were seen, and it lies
//! between the least and the largest of a brick. So where all of these lie below the isovalue, or all on one side of the interval that the transfer function
//! shows, every sample of the brick is transparent, and need not be taken.
//!
//! That must hold of the samples as they are computed, to the bit. Each of three interpolations in single precision rounds by 3·2⁻²⁴ of the largest
//! number at most: c by 9·2⁻²⁴ of the largest intensity M, s by 9·2⁻²⁴, and so c / s by 37·2⁻²⁴ M where s is one half or more. Voxels therefore count as beside
//! the interval only at a distance of 2⁻¹⁸ of a [largest intensity](REACH), beyond which they do not count as beside it at all. Of an isosurface s is one half or
//! more wherever it is looked at.
//!
//! A sample that is classified may have been seen by any share. Of a brick that was seen whole s is 1; else all depends on what is rounded off when most of the
//! weight lies on what was not seen. Places about voxels are multiples of 2⁻²¹, as the first has the coordinate 8; so each interpolation gives a voxel that was seen a
//! weight of 2⁻²¹ or none, and of |c| / s no more than (1 + 2⁻³) / (1 − 2⁻³) = 9/7 becomes of 1: 2.13 M after three. Voxels count as [far](FAR) below the
//! interval by that, and bricks that hold but these are passed over however much of them was seen.

use super::mode::Keeps;
use super::settings::RenderSettings;
use super::shade::Lit;
use crate::volume::brick::EDGE;

/// The largest intensity that is taken for beside an interval, in the larger of its ends, or of [`LEAST`] grey levels.
const REACH: f32 = 64.0;
const LEAST: f32 = 16.0;
/// Rounding of a sample's intensity, in the largest intensity about it; more than 37·2⁻²⁴.
const ROUNDING: f32 = 1.0 / (1 << 18) as f32;

/// Intensities so many times smaller than the interval's lower end are far below it; more than (9/7)³.
const FAR: f32 = 2.25;

/// Where a voxel's intensity lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    /// Nowhere: the voxel is transparent, or was not seen.
    Clear,
    /// In the interval, or not certainly beside it.
    Shown,
    /// Below it.
    Under,
    /// So far below it that samples are, by however small a share of them was seen.
    Far,
    /// Above it.
    Over,
}

/// Of these there are so many.
pub(super) const SIDES: usize = 5;

/// The intensities of which anything is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Interval {
    /// Intensities that are certainly below and above it, least and largest.
    under: [f32; 2],
    over: [f32; 2],
    /// The largest that is far below it, of either sign.
    far: f32,
    /// Whether samples that were seen by less than half may be seen.
    faint: bool,
    /// See [`Self::reach`].
    reach: Option<i64>,
}

/// No intensity.
const NONE: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

impl Interval {
    /// Of which nothing lies beside it: all that is not transparent is looked at.
    pub(super) const ALL: Self = Self { under: NONE, over: NONE, far: f32::NEG_INFINITY, faint: false, reach: None };

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

    fn between(ends: [f64; 2], faint: bool) -> Self {
        let [low, high] = ends.map(|end| end as f32);
        let most = [low, high].into_iter().map(f32::abs).filter(|end| end.is_finite()).fold(LEAST, f32::max) * REACH;
        let margin = most * ROUNDING;
        let under = [-most, low - margin];
        Self { under, over: [high + margin, most], far: under[1].min(low / FAR), faint, reach: None }
    }

    /// On which side of it a voxel lies that keeps its intensity; of voxels that keep their light there are none beside [all](Self::ALL).
    #[inline(always)]
    pub(super) fn side<const C: usize>(&self, voxel: &Lit<f32, C>) -> Side {
        let (value, seen) = (voxel.colour[0], voxel.alpha > 0.0);
        if !seen {
            Side::Clear
        } else if value.abs() <= self.far {
            Side::Far
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
        let (under, over) = (any(Side::Under) || any(Side::Far), any(Side::Over));
        let in_part = self.faint && any(Side::Clear) && (any(Side::Under) || over);
        any(Side::Shown) || under && over || in_part
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
