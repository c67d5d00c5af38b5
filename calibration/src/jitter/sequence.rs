//! Slices in the order of time, with their neighbours in one sweep.

use std::ops::Range;

use glam::DAffine3;

use crate::crossings::directions::Directions;
use crate::crossings::state::State;
use crate::slices::Slices;
use crate::statistics::median;

/// Neighbours on either side, in the order of time.
pub(super) const REACH: usize = 6;
/// Slices over which a sweep's gap is measured: noise of the poses counts by a twelfth.
const FAR: usize = 12;

/// A slice of a sweep.
#[derive(Debug, Clone)]
pub(super) struct Member {
    /// Its number in the order of [`Slices::push`].
    pub(super) slice: usize,
    /// Rigid: from mm of the image, about its middle, to the world, by the pose as measured.
    pub(super) world_from_picture: DAffine3,
    /// The members of its sweep.
    pub(super) sweep: Range<usize>,
    /// Those that predict it, with itself among them.
    pub(super) neighbours: Range<usize>,
    /// Standard deviation of the neighbours' weights, mm across the plane.
    pub(super) width_mm: f64,
}

/// Returns the slices of all sweeps in the order of time; `across_mm` is the noise of planes along
/// their normals.
pub(super) fn members(slices: &Slices, state: &State, across_mm: f64) -> Vec<Member> {
    let directions = Directions::of(slices, state);
    let placed = |slice: usize| Some((directions.sweep[slice]?, slice, state.world_from_picture(slices, slice)?));
    let mut all: Vec<(usize, usize, DAffine3)> = (0..slices.pixels.len()).filter_map(placed).collect();
    let time_s = |slice: usize| slices.pixels[slice].0;
    all.sort_by(|a, b| a.0.cmp(&b.0).then(time_s(a.1).total_cmp(&time_s(b.1))));
    let mut members: Vec<Member> = Vec::new();
    for sweep in all.chunk_by(|a, b| a.0 == b.0) {
        let (first, end) = (members.len(), members.len() + sweep.len());
        // Planes are displaced by noise, so that neighbours on both sides lie farther than a gap.
        let width_mm = gap_mm(sweep).hypot(across_mm);
        members.extend(sweep.iter().enumerate().map(|(at, (_, slice, world_from_picture))| Member {
            slice: *slice,
            world_from_picture: *world_from_picture,
            sweep: first..end,
            neighbours: (first + at).saturating_sub(REACH).max(first)..(first + at + REACH + 1).min(end),
            width_mm,
        }));
    }
    members
}

/// Returns the typical distance of a sweep's successive planes, mm.
fn gap_mm(sweep: &[(usize, usize, DAffine3)]) -> f64 {
    let far = FAR.min(sweep.len() - 1).max(1);
    let gap = |((_, _, a), (_, _, b)): (&(usize, usize, DAffine3), &(usize, usize, DAffine3))| {
        a.matrix3.z_axis.dot(b.translation - a.translation).abs() / far as f64
    };
    let mut gaps: Vec<f64> = sweep.iter().zip(sweep.iter().skip(far)).map(gap).collect();
    median(&mut gaps)
}
