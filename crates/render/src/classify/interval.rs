//! Skips bricks in which every sample is transparent because of the intensities seen there.
//!
//! The intensity of a sample is c / s, where c = Σ seen · intensity and s = Σ seen over the eight
//! voxels about it. It is a mean of the seen voxels and lies between the brick's least and
//! largest intensity. A brick is skipped if all of these lie below the isovalue, or on one side
//! of the transfer function's visible interval: all its samples are transparent.
//!
//! This must hold for the samples as they are computed, to the bit. Each of three interpolations
//! in single precision rounds by at most 3·2⁻²⁴ of the largest number. The error of c is 9·2⁻²⁴
//! of the largest intensity M, and of s 9·2⁻²⁴. The error of c / s is then 37·2⁻²⁴ M if s is one
//! half or more. Voxels therefore count as outside the interval only at a distance of 2⁻¹⁸ of a
//! [largest intensity](REACH). Intensities beyond that largest one never count as outside. An
//! isosurface is evaluated only for s of one half or more.
//!
//! A classified sample may have been seen by any share. In a brick that was seen completely s is
//! one. Otherwise rounding decides when most of the weight lies on unseen voxels. Sample places
//! about voxels are multiples of 2⁻²¹, because the first coordinate is 8. Each interpolation
//! therefore gives a seen voxel a weight of at least 2⁻²¹, or none. One interpolation can raise
//! |c| / s from 1 to at most (1 + 2⁻³) / (1 − 2⁻³) = 9/7; three can raise it to 2.13 M. Voxels
//! count as [far](FAR) below the interval by that factor. Bricks that hold only far voxels are
//! skipped, whatever share of them was seen.

use volume::brick::EDGE;

use crate::classify::shade::Lit;
use crate::mode::VoxelData;
use crate::settings::RenderSettings;

/// Largest intensity that can count as outside an interval, in units of the larger of its ends,
/// or of [`LEAST`] grey levels.
const REACH: f32 = 64.0;
const LEAST: f32 = 16.0;
/// Rounding of a sample's intensity, in units of the largest intensity about it; more than
/// 37·2⁻²⁴.
const ROUNDING: f32 = 1.0 / (1 << 18) as f32;

/// Intensities smaller than the interval's lower end by this factor are far below it; more than
/// (9/7)³.
const FAR: f32 = 2.25;

/// Position of a voxel's intensity relative to the interval.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Side {
    /// The voxel is transparent, or unseen.
    Clear,
    /// In the interval, or not certainly outside.
    Inside,
    /// Below it.
    Under,
    /// So far below it that samples are too, however small a share of them was seen.
    Far,
    /// Above it.
    Over,
}

/// Number of variants of [`Side`].
pub(crate) const SIDES: usize = 5;

/// The interval of visible intensities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Interval {
    /// Least and largest of the intensities that are certainly below it, and certainly above it.
    under: [f32; 2],
    over: [f32; 2],
    /// Largest magnitude that is far below it.
    far: f32,
    /// Whether samples seen by less than half can be visible.
    faint: bool,
    /// See [`Self::reach`].
    reach: Option<i64>,
}

/// The empty range of intensities.
const NONE: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

impl Interval {
    /// No intensity counts as outside: all samples that are not transparent are evaluated.
    pub(crate) const ALL: Self = Self { under: NONE, over: NONE, far: f32::NEG_INFINITY, faint: false, reach: None };

    /// Returns the interval of the intensities that samples are made of.
    pub(crate) fn of(settings: &RenderSettings) -> Self {
        debug_assert_eq!(settings.mode.voxel_data(), VoxelData::SampleClassifier, "what voxels keep is an intensity");
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

    /// Returns the side of a voxel that keeps its intensity. Voxels that keep lit colours always
    /// use [all](Self::ALL), for which no voxel lies outside.
    #[inline(always)]
    pub(crate) fn side<const C: usize>(&self, voxel: &Lit<f32, C>) -> Side {
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
            Side::Inside
        }
    }

    /// Returns whether a sample between these numbers of voxels of each side can be anything but
    /// transparent.
    pub(crate) fn may_show(&self, sides: [u16; SIDES]) -> bool {
        let any = |side: Side| sides[side as usize] > 0;
        let (under, over) = (any(Side::Under) || any(Side::Far), any(Side::Over));
        let in_part = self.faint && any(Side::Clear) && (any(Side::Under) || over);
        any(Side::Inside) || under && over || in_part
    }

    /// Returns the distance, in bricks, to which samples depend on a brick's voxels; `None` if
    /// unknown, or if all bricks are visible.
    pub(crate) fn reach(&self) -> Option<i64> {
        self.reach
    }
}

/// A sample lies within a voxel of the voxels it is made of. The surface between it and the
/// previous sample lies within a step of it.
fn reach(step: f64) -> Option<i64> {
    // One voxel more than needed, in case a sample is rounded into the next brick.
    (step + 2.0 <= EDGE as f64).then_some(1)
}
