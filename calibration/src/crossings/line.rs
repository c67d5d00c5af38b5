//! Grey values of two slices along their line, and derivatives by the nine numbers.
//!
//! A change of one slice displaces its plane, and the line with it. A change of the calibration is
//! the same change of both: its derivatives are the sums of those by each slice. Let n and m be
//! their normals, and γ the angle between these. The dual vectors are
//! c = (n − m cos γ) / sin² γ and d = (m − n cos γ) / sin² γ. Where the planes move by a and b
//! along their normals, the line moves by c a + d b. A point of the line is then read in each
//! image at its place less the displacement of the image itself.

use glam::{DAffine3, DVec2, DVec3};

use super::scales::blurred;
use super::state::{COUNT, Change, Placed, Placing, State, displacements, slope_mm};
use crate::slices::Slices;
use crate::statistics::{correlation, median};

/// Points along a line, and how many of them both images must show.
const POINTS: usize = 48;
const LEAST_POINTS: usize = 16;
/// Blur of the images that slopes are taken from, in that of the others.
const SLOPES: f64 = 2.0;
/// Largest change of the lag, s.
pub(super) const END_MARGIN_S: f64 = 0.1;

/// Difference of two slices at a point, grey levels, less the line's mean, with its derivatives.
pub(super) type Point = (f64, Change);

/// The same with its derivatives by a change of the first slice alone, and of the second.
pub(crate) type PointBySlice = (f64, [Change; 2]);

/// Lines of crossing slices, with images of one blur.
pub(crate) struct Lines<'a> {
    slices: &'a Slices,
    pub(crate) pairs: &'a [[usize; 2]],
    pub(crate) images: Vec<Vec<u16>>,
    /// Images that the slopes are taken from. They are blurred more: noise of slopes adds to their
    /// squares, as if the slices determined the numbers better than they do.
    pub(crate) smooth: Vec<Vec<u16>>,
}

/// Grey values of two slices along a line.
#[derive(Default)]
struct Greys {
    /// Those of either slice, and the derivatives of their difference by each slice's change.
    at: Vec<([f64; 2], [Change; 2])>,
}

impl<'a> Lines<'a> {
    pub(crate) fn new(slices: &'a Slices, pairs: &'a [[usize; 2]], blur_mm: f64) -> Self {
        let [images, smooth] = [1.0, SLOPES].map(|factor| blurred(slices, blur_mm, factor));
        Self { slices, pairs, images, smooth }
    }

    /// Returns the points of all lines by a calibration; none of a line that two slices no longer
    /// show.
    pub(super) fn points(&self, state: &State) -> Vec<Vec<Point>> {
        let both = |(difference, [a, b]): PointBySlice| (difference, a + b);
        let points = self.points_by_slice(&state.placing(self.slices));
        points.into_iter().map(|line| line.into_iter().map(both).collect()).collect()
    }

    /// Returns the points of all lines with the slices at these places.
    pub(crate) fn points_by_slice(&self, placing: &Placing) -> Vec<Vec<PointBySlice>> {
        self.greys(placing).iter().map(differences).collect()
    }

    /// Returns the median amount of the differences by a calibration, grey levels; 0 without lines.
    pub(super) fn scale(&self, state: &State) -> f64 {
        let mut amounts: Vec<f64> =
            self.points(state).iter().flatten().map(|(difference, _)| difference.abs()).collect();
        median(&mut amounts)
    }

    /// Returns Cauchy's mean loss of the differences by a calibration; infinite without lines.
    pub(super) fn cost(&self, state: &State, scale: f64) -> f64 {
        let loss = |difference: f64| (difference / scale.max(f64::MIN_POSITIVE)).powi(2).ln_1p();
        let points = self.points(state);
        let (sum, count) = points.iter().flatten().fold((0.0, 0.0), |(sum, n), (d, _)| (sum + loss(*d), n + 1.0));
        if count > 0.0 { sum / count } else { f64::INFINITY }
    }

    /// Returns the median of the correlations along the lines.
    pub(crate) fn correlation(&self, placing: &Placing) -> f64 {
        let mut all: Vec<f64> = self.correlations(placing).into_iter().flatten().collect();
        median(&mut all)
    }

    /// Returns the correlation along each line; none of a line that two slices do not show, or of
    /// constant grey values.
    pub(crate) fn correlations(&self, placing: &Placing) -> Vec<Option<f64>> {
        self.greys(placing).iter().map(Greys::correlation).collect()
    }

    fn greys(&self, placing: &Placing) -> Vec<Greys> {
        let of = |pair: &[usize; 2]| match pair.map(|slice| placing.slices[slice]) {
            [Some(a), Some(b)] => self.along(*pair, &placing.picture_from_pixel, [a, b]).unwrap_or_default(),
            _ => Greys::default(),
        };
        self.pairs.iter().map(of).collect()
    }

    /// Returns the grey values along the line of two slices; `None` if they do not show enough of
    /// it.
    fn along(&self, pair: [usize; 2], picture_from_pixel: &DAffine3, placed: [Placed; 2]) -> Option<Greys> {
        let of_pixel = placed.map(|placed| placed.world_from_picture * *picture_from_pixel);
        let ends = self.slices.line([&of_pixel[0], &of_pixel[1]])?;
        let greys = self.between(ends, pair, &Side::both(picture_from_pixel, placed));
        (greys.at.len() >= LEAST_POINTS).then_some(greys)
    }

    /// Returns the grey values at points between two ends of a line.
    fn between(&self, [from, to]: [DVec3; 2], pair: [usize; 2], sides: &[Side; 2]) -> Greys {
        let mut greys = Greys::default();
        for k in 0..POINTS {
            let place = from.lerp(to, (k as f64 + 0.5) / POINTS as f64);
            let points = [0, 1].map(|s| sides[s].point(place));
            let read = [0, 1].map(|s| self.grey(pair[s], sides[s].pixel(points[s])));
            let [Some(a), Some(b)] = read else { continue };
            let slopes = [(0, a.1), (1, b.1)].map(|(s, slope)| slope_mm(&sides[s].pixel_from_picture, slope));
            let moved = [0, 1].map(|s| sides[s].moved(points[s]));
            // Each slice moves the line in both images, and its own image.
            let by = [0, 1].map(|s| {
                Change::from_fn(|number, _| {
                    let moved = moved[s][number];
                    let line = [0, 1].map(|image| slopes[image].dot(sides[image].duals[s] * moved.z));
                    let own = slopes[s].dot(moved.truncate());
                    line[0] - line[1] - if s == 0 { own } else { -own }
                })
            });
            greys.at.push(([a.0, b.0], by));
        }
        greys
    }

    /// Returns a grey value and its slope per pixel; `None` outside of the data.
    fn grey(&self, slice: usize, at: DVec2) -> Option<(f64, DVec2)> {
        let grey = self.slices.grey(&self.images[slice], at)?;
        Some((grey, self.slices.grey_and_slope(&self.smooth[slice], at)?.1))
    }
}

/// Returns the differences of two slices, less their mean.
fn differences(greys: &Greys) -> Vec<PointBySlice> {
    let count = greys.at.len() as f64;
    let all = greys.at.iter().map(|([a, b], by)| (a - b, *by));
    let none = (0.0, [Change::zeros(); 2]);
    let (sum, [first, second]) = all.clone().fold(none, |(s, [a, b]), (d, [of, with])| (s + d, [a + of, b + with]));
    let means = [first / count, second / count];
    all.map(|(difference, [a, b])| (difference - sum / count, [a - means[0], b - means[1]])).collect()
}

impl Greys {
    fn correlation(&self) -> Option<f64> {
        correlation(self.at.iter().map(|(greys, _)| *greys))
    }
}

/// One of two slices that cross.
struct Side {
    /// From the world to mm of the image.
    back: DAffine3,
    pixel_from_picture: DAffine3,
    /// Displacements of the line in this image, where the planes of both move along their normals
    /// by 1.
    duals: [DVec2; 2],
    /// Velocity of the image in its own frame, by mm of the image, per s.
    rate: DAffine3,
}

impl Side {
    fn both(picture_from_pixel: &DAffine3, placed: [Placed; 2]) -> [Self; 2] {
        let normals = placed.map(|placed| placed.world_from_picture.matrix3.z_axis);
        let cosine = normals[0].dot(normals[1]);
        let square = 1.0 - cosine * cosine;
        let pixel_from_picture = picture_from_pixel.inverse();
        let duals = [0, 1].map(|s| (normals[s] - normals[1 - s] * cosine) / square);
        [0, 1].map(|s| {
            let Placed { world_from_picture, rate } = placed[s];
            let back = world_from_picture.inverse();
            Self {
                back,
                pixel_from_picture,
                duals: duals.map(|dual| back.transform_vector3(dual).truncate()),
                rate: DAffine3 { matrix3: back.matrix3 * rate.matrix3, translation: back.matrix3 * rate.translation },
            }
        })
    }

    /// Returns a point of the world in the image, mm.
    fn point(&self, world: DVec3) -> DVec3 {
        let p = self.back.transform_point3(world);
        DVec3::new(p.x, p.y, 0.0)
    }

    fn pixel(&self, point: DVec3) -> DVec2 {
        self.pixel_from_picture.transform_point3(point).truncate()
    }

    /// Returns the displacements of a point of the image by each number, in its frame.
    fn moved(&self, p: DVec3) -> [DVec3; COUNT] {
        let by_image = displacements(p);
        std::array::from_fn(|number| by_image.get(number).copied().unwrap_or_else(|| self.rate.transform_point3(p)))
    }
}

#[cfg(test)]
impl Lines<'_> {
    /// Returns the points of a pair's line at places of the slices. The ends are the nearest points
    /// on the line to the ends at other places.
    pub(crate) fn differences_moved(&self, pair: [usize; 2], before: &Placing, after: &Placing) -> Vec<PointBySlice> {
        let placed = |placing: &Placing| pair.map(|slice| placing.slices[slice].unwrap());
        let [a, b] = placed(before).map(|placed| placed.world_from_picture * before.picture_from_pixel);
        let ends = self.slices.line([&a, &b]).unwrap();
        let planes = placed(after).map(|placed| placed.world_from_picture);
        let [n, m] = planes.map(|plane| plane.matrix3.z_axis);
        let across = n.cross(m);
        let nearest = |end: DVec3| {
            let [h, k] = planes.map(|plane| plane.matrix3.z_axis.dot(plane.translation - end));
            end + (h * m.cross(across) + k * across.cross(n)) / across.length_squared()
        };
        differences(&self.between(ends.map(nearest), pair, &Side::both(&after.picture_from_pixel, placed(after))))
    }
}
