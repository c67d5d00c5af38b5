//! Points of all slices, for the fit and outside of it, and how they differ from their predictions.

use glam::{DAffine3, DVec2};

use super::prediction::{Across, FARTHEST, Sums};
use super::sequence::Member;
use crate::crossings::scales::smoothed;
use crate::crossings::state::{State, slope_mm};
use crate::slices::Slices;

/// Distance of the points along u and v, mm.
const STEP_MM: f64 = 2.0;
/// Smoothing of the images, standard deviation, mm.
const SMOOTHING_MM: f64 = 0.5;

/// Points of the fit, and every second point, which is left out of it.
pub(super) const FIT: usize = 0;
pub(super) const LEFT_OUT: usize = 1;

/// A slice's own grey value, and its slope along the image, per mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Own {
    pub(super) grey: f64,
    pub(super) slope: DVec2,
}

/// Slices of sweeps, and their points.
pub(super) struct Scan<'a> {
    slices: &'a Slices,
    pub(super) members: Vec<Member>,
    /// The same for all slices, mm of the image about its middle: of the fit, and left out.
    pub(super) points: [Vec<DVec2>; 2],
    /// Values of each member at these.
    pub(super) own: [Vec<Vec<Own>>; 2],
    images: Vec<Vec<u16>>,
    pixel_from_picture: DAffine3,
}

impl<'a> Scan<'a> {
    pub(super) fn new(slices: &'a Slices, state: &State, members: Vec<Member>) -> Self {
        let images = smoothed(slices, SMOOTHING_MM);
        let pixel_from_picture = state.picture_from_pixel.inverse();
        let pixels = grid(slices, state);
        let own_at = |image: &[u16], [u, v]: [usize; 2]| {
            let at = v * slices.width + u;
            let step = |by: usize| (f64::from(image[at + by]) - f64::from(image[at - by])) / 512.0;
            let slope = slope_mm(&pixel_from_picture, DVec2::new(step(1), step(slices.width)));
            Own { grey: f64::from(image[at]) / 256.0, slope }
        };
        let own_of = |set: &Vec<[usize; 2]>| {
            let of = |member: &Member| set.iter().map(|at| own_at(&images[member.slice], *at)).collect();
            members.iter().map(of).collect()
        };
        let own = [FIT, LEFT_OUT].map(|set| own_of(&pixels[set]));
        let place = |[u, v]: &[usize; 2]| {
            let at = DVec2::new(*u as f64, *v as f64);
            state.picture_from_pixel.transform_point3(at.extend(0.0)).truncate()
        };
        let points = pixels.map(|set| set.iter().map(place).collect());
        Self { slices, members, points, own, images, pixel_from_picture }
    }

    /// Returns the predictions of each member's points, all by the same poses.
    pub(super) fn predictions(&self, poses: &[DAffine3], set: usize) -> Vec<Vec<Option<f64>>> {
        (0..self.members.len()).map(|member| self.prediction(member, &poses[member], poses, set)).collect()
    }

    /// Returns the predictions of a member's points, with the member at a pose of its own.
    pub(super) fn prediction(
        &self,
        member: usize,
        pose: &DAffine3,
        poses: &[DAffine3],
        set: usize,
    ) -> Vec<Option<f64>> {
        let Member { neighbours, width_mm, .. } = &self.members[member];
        let mut sums = vec![Sums::default(); self.points[set].len()];
        for other in neighbours.clone().filter(|other| *other != member) {
            let across = Across::of([pose, &poses[other]], &self.pixel_from_picture);
            let image = &self.images[self.members[other].slice];
            for (point, sums) in self.points[set].iter().zip(&mut sums) {
                let q = across.distance_mm(*point);
                let ratio = q / width_mm;
                if !(ratio.abs() < FARTHEST) {
                    continue;
                }
                if let Some(grey) = self.slices.grey(image, across.pixel(*point)) {
                    sums.add(q, (-0.5 * ratio * ratio).exp(), grey);
                }
            }
        }
        sums.iter().map(|sums| sums.predicted(*width_mm)).collect()
    }

    /// Returns the grey values of a member and of the next one, if it is of the same sweep, at
    /// points that were left out.
    pub(super) fn with_next(&self, member: usize, poses: &[DAffine3]) -> Vec<[f64; 2]> {
        let next = member + 1;
        if !self.members[member].neighbours.contains(&next) {
            return Vec::new();
        }
        let across = Across::of([&poses[member], &poses[next]], &self.pixel_from_picture);
        let image = &self.images[self.members[next].slice];
        let both = self.points[LEFT_OUT].iter().zip(&self.own[LEFT_OUT][member]);
        both.filter_map(|(point, own)| Some([own.grey, self.slices.grey(image, across.pixel(*point))?])).collect()
    }
}

/// Returns the pixels of the points: a grid, whose points belong to the fit by turns.
fn grid(slices: &Slices, state: &State) -> [Vec<[usize; 2]>; 2] {
    let Slices { width, height, is_data, bounds, .. } = slices;
    let m = state.picture_from_pixel.matrix3;
    let steps = [m.x_axis, m.y_axis].map(|side| (STEP_MM / side.length()).round().max(1.0) as usize);
    let [[left, right], [top, bottom]] = bounds.map(|ends| ends.map(|end| end as usize));
    // Slopes need the pixels beside.
    let is_inner = |u: usize, v: usize| {
        let at = v * width + u;
        (1..width - 1).contains(&u)
            && (1..height - 1).contains(&v)
            && [at, at - 1, at + 1, at - width, at + width].iter().all(|at| is_data[*at])
    };
    let mut sets = [Vec::new(), Vec::new()];
    for (row, v) in (top..=bottom).step_by(steps[1]).enumerate() {
        for (column, u) in (left..=right).step_by(steps[0]).enumerate() {
            if is_inner(u, v) {
                sets[(row + column) % 2].push([u, v]);
            }
        }
    }
    sets
}
