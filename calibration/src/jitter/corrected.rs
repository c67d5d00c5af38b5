//! The result of a correction by neighbours, and reasons not to use it.

use glam::DAffine3;

use super::fit::{Fit, Prior, Within, differences};
use super::points::{LEFT_OUT, Scan};
use crate::crossings::state::State;
use crate::error::JitterError;
use crate::slices::Slices;
use crate::statistics::{correlation, median};

/// Fall of the differences at points that were left out. In a body of shapes it is below 1 % with
/// exact poses, and 8 % to 17 % with smoothed ones. White noise of 0.1 mm and 0.1° makes it 28 % to
/// 37 %.
const LEAST_FALL: f64 = 0.15;
/// Correlation of successive slices. Images of noise have 0.
const LEAST_CORRELATION: f64 = 0.75;
/// Mean square of the displacements by the noise. It is 0.4 to 0.9 with the right noise, and 2 with
/// noise that is stated half as large as it is.
const MOST_CHI2: f64 = 1.5;
/// Displacement of an image's corner, mm. White noise of 0.3 mm and 0.3° reaches 2.5 mm in 600
/// slices.
const MOST_MM: f64 = 3.0;
/// Share of the points without a prediction.
const MOST_UNPREDICTED: f64 = 0.2;
/// Share of the images that may be uniform.
const MOST_FLAT: f64 = 0.5;

/// Corrections of slices within their planes, with evidence.
#[derive(Debug, Clone, PartialEq)]
pub struct Jitter {
    /// Number of slices in sweeps.
    pub slices: usize,
    /// Number of these that are corrected. The first and the last of a sweep have neighbours on one
    /// side only, and keep their poses.
    pub corrected: usize,
    /// Median differences from the prediction at points that were left out of the fit, before and
    /// after, grey levels.
    pub differences: [f64; 2],
    /// Median correlation of successive slices, after.
    pub correlation: f64,
    /// Mean square of the displacements by the poses' noise, per degree of freedom.
    pub chi2: f64,
    /// Largest displacement of an image's corner, mm.
    pub largest_mm: f64,
    /// Root mean square of the displacements over the corrected images, mm.
    pub rms_mm: f64,
    /// Share of the points that have no prediction.
    pub unpredicted: f64,
    /// Number of uniform images.
    pub flat: usize,
    /// In the order of [`Slices::push`].
    within: Vec<Option<Within>>,
    /// From pixels of the full images to mm of the image about its middle, and back.
    picture_from_image: [DAffine3; 2],
}

impl Jitter {
    pub(super) fn new(slices: &Slices, state: &State, scan: &Scan<'_>, fit: &Fit, prior: &Prior) -> Self {
        let measured: Vec<DAffine3> = scan.members.iter().map(|member| member.world_from_picture).collect();
        let poses = fit.poses(scan);
        let [before, after] = [&measured, &poses].map(|poses| differences(scan, poses, LEFT_OUT));
        // The same points before and after.
        let both = before.iter().flatten().zip(after.iter().flatten()).filter_map(|(a, b)| Some([(*a)?, (*b)?]));
        let both: Vec<[f64; 2]> = both.collect();
        let medians = [0, 1].map(|k| median(&mut both.iter().map(|pair| pair[k].abs()).collect::<Vec<_>>()));
        let all = after.iter().map(Vec::len).sum::<usize>();
        let predicted = after.iter().flatten().flatten().count();
        let pairs: Vec<Vec<[f64; 2]>> = (0..poses.len()).map(|member| scan.with_next(member, &poses)).collect();
        let mut correlations: Vec<f64> = pairs.iter().filter_map(|pairs| correlation(pairs.iter().copied())).collect();
        let corners = State::points(slices).map(|pixel| state.picture_from_pixel.transform_point3(pixel));
        let found: Vec<&Within> = fit.within.iter().flatten().collect();
        let count = found.len().max(1) as f64;
        let displaced: Vec<[f64; 2]> = found.iter().map(|within| within.displaced_mm(&corners)).collect();
        let mut within = vec![None; slices.pixels.len()];
        scan.members.iter().zip(&fit.within).for_each(|(member, found)| within[member.slice] = *found);
        let picture_from_image = state.picture_from_pixel * slices.image_from_pixel.inverse();
        Self {
            slices: scan.members.len(),
            corrected: found.len(),
            differences: medians,
            correlation: median(&mut correlations),
            chi2: found.iter().map(|within| prior.chi2(within)).sum::<f64>() / count,
            largest_mm: displaced.iter().map(|of| of[0]).fold(0.0, f64::max),
            rms_mm: (displaced.iter().map(|of| of[1]).sum::<f64>() / count).sqrt(),
            unpredicted: 1.0 - predicted as f64 / all.max(1) as f64,
            flat: (0..poses.len()).filter(|member| is_flat(scan, *member)).count(),
            within,
            picture_from_image: [picture_from_image, picture_from_image.inverse()],
        }
    }

    /// Returns the fall of the differences at points that were left out of the fit, as a share.
    pub fn fall(&self) -> f64 {
        let [before, after] = self.differences;
        if before > 0.0 { 1.0 - after / before } else { 0.0 }
    }

    /// Returns a slice's correction: its displacement along u, v and the normal, mm, and its turns
    /// about these, rad. Slices are counted in the order of [`Slices::push`]. Those across the
    /// plane are 0. `None` of a slice that keeps its pose.
    ///
    /// The corrected map from mm of the image, about the middle of its data, to the world is the
    /// map by the pose times the turn, then the displacement.
    pub fn numbers(&self, slice: usize) -> Option<[f64; 6]> {
        let Within { shift_mm, turn } = (*self.within.get(slice)?)?;
        Some([shift_mm.x, shift_mm.y, 0.0, 0.0, 0.0, turn])
    }

    /// Returns a slice's map from pixels of its full image to the world, mm, after the correction;
    /// `world_from_image` is that by its pose, in any frame of the world. Slices are counted in the
    /// order of [`Slices::push`].
    pub fn corrected(&self, slice: usize, world_from_image: DAffine3) -> DAffine3 {
        let [to, back] = self.picture_from_image;
        let within = self.within.get(slice).copied().flatten();
        within.map_or(world_from_image, |within| world_from_image * back * within.rigid() * to)
    }

    /// Returns the reason why the corrections are not to be used, if there is one.
    pub(super) fn unfit(&self) -> Option<JitterError> {
        let Self { slices, flat, correlation, chi2, largest_mm: mm, .. } = *self;
        if !(self.unpredicted <= MOST_UNPREDICTED) {
            let [percent, most_percent] = [self.unpredicted, MOST_UNPREDICTED].map(|share| 100.0 * share);
            return Some(JitterError::Unpredicted { percent, most_percent });
        }
        if !(flat as f64 <= MOST_FLAT * slices as f64) {
            return Some(JitterError::Flat { flat, slices });
        }
        if !(correlation >= LEAST_CORRELATION) {
            return Some(JitterError::Unrelated { correlation, least: LEAST_CORRELATION });
        }
        if !(chi2 <= MOST_CHI2) {
            return Some(JitterError::Unlikely { ratio: chi2, most_ratio: MOST_CHI2 });
        }
        if !(mm <= MOST_MM) {
            return Some(JitterError::Large { mm, most_mm: MOST_MM });
        }
        let [percent, least_percent] = [self.fall(), LEAST_FALL].map(|share| 100.0 * share);
        (!(percent >= least_percent)).then_some(JitterError::NoBetter { percent, least_percent })
    }
}

/// Whether a member's grey values vary by no more than their rounding.
fn is_flat(scan: &Scan<'_>, member: usize) -> bool {
    correlation(scan.own.iter().flat_map(|own| &own[member]).map(|own| [own.grey; 2])).is_none()
}
