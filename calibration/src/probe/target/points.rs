//! Start for a point target: the plane and the point's position from dots and poses, by linear
//! least squares.
//!
//! The probe has the pose R, t in the reference's frame. A dot at (u, v) gives u·**u** +
//! v·**v** + **o** − Rᵀ**p** = −Rᵀt: three equations, linear in the plane's nine numbers and
//! the point's three. The poses give the scale. It is unknown which of an image's spots is the
//! point, if any is. Guesses are computed from the brightest spots of a few images each. The
//! guess that half of all images fit best is chosen (least median; Rousseeuw, J. Am. Stat.
//! Assoc. 79, 1984). Then every image selects its best spot, and images that do not agree lose
//! their weight.

use glam::{DAffine3, DVec2, DVec3};

use super::detection::Detection;
use super::refine::Start;
use super::{Place, Target};
use crate::least_squares::Loss;
use crate::least_squares::loss::spread;
use crate::probe::plane::{ImagePlane, Unit, solve};
use crate::probe::track::Track;
use crate::statistics::median;

/// Count of numbers of the plane and the point.
const UNKNOWN: usize = 12;
/// Number of images per guess: four determine all numbers, more improve the accuracy.
const PICTURES: usize = 7;
/// Number of guesses. If 60 % of the brightest spots are the point, all guesses contain a wrong
/// one once in 10⁵ times.
const GUESSES: u64 = 400;
/// Number of an image's spots compared with a guess.
const SPOTS: usize = 5;
/// Images agree if their error is below this multiple of the median error.
const AGREES: f64 = 5.0;
/// Number of solutions per loss.
const ROUNDS: usize = 10;
/// Least spread, mm; smaller values are rounding errors.
const LEAST_SPREAD_MM: f64 = 1e-9;
/// Prior standard deviation of the point's distance from the probe, mm. It keeps the equations
/// solvable, and a degree of rotation outweighs it.
const ANYWHERE_MM: f64 = 1000.0;

/// Lags to try, if there are times, s: between two of them the probe moves by some mm.
const LAGS_S: [f64; 9] = [0.0, 0.1, -0.1, 0.2, -0.2, 0.3, -0.3, 0.4, -0.4];

/// Computes a start, and selects each detection's spot. `None` if the dots leave the plane open.
pub(super) fn start(
    target: Target,
    detections: &mut [Detection],
    track: &Track,
    size_px: [u32; 2],
    lag: bool,
) -> Option<Start> {
    let lags = if lag { &LAGS_S[..] } else { &LAGS_S[..1] };
    let mut best: Option<(f64, f64)> = None;
    for &lag_s in lags {
        let sums = Sums::new(target, detections, track, lag_s, size_px);
        let Some((score, ..)) = sums.guessed(detections) else { continue };
        if best.is_none_or(|(least, _)| score < least) {
            best = Some((score, lag_s));
        }
    }
    let (_, lag_s) = best?;
    let sums = Sums::new(target, detections, track, lag_s, size_px);
    let agreed = sums.agreeing(detections)?;
    let (mut weights, mut found) = (agreed.clone(), None);
    for round in 0..2 * ROUNDS {
        let (plane, point) = sums.solved(sums.posed.iter().map(|&i| (i, detections[i].marks[0], weights[i])))?;
        let mut off = vec![0.0; detections.len()];
        for &i in &sums.posed {
            detections[i].choose(|px| sums.off_mm(i, px, &plane, point));
            off[i] = sums.off_mm(i, detections[i].marks[0], &plane, point);
        }
        // The first rounds use the detections that agree with most others; the later rounds use
        // all.
        let is_used = |&i: &usize| round >= ROUNDS || agreed[i] > 0.0;
        let used: Vec<usize> = sums.posed.iter().copied().filter(is_used).collect();
        let spread_mm = spread(&used.iter().map(|&i| (3, off[i])).collect::<Vec<_>>()).max(LEAST_SPREAD_MM);
        let loss = if round < ROUNDS { Loss::Huber } else { Loss::Tukey }.of(3);
        weights.fill(0.0);
        used.iter().for_each(|&i| weights[i] = loss.weight(off[i] / spread_mm));
        let agrees = weights.iter().map(|weight| *weight > 0.0).collect();
        found = Some(Start { plane, place: Place::Point(point), lag_s, agrees });
    }
    found
}

/// Returns a random sample of the detections without repetition, reproducible for each guess
/// (Steele, Lea & Flood's SplitMix64).
fn sample(posed: &[usize], guess: u64) -> [usize; PICTURES] {
    let mut bits = guess.wrapping_mul(0xD1B5_4A32_D192_ED03);
    let mut taken = [usize::MAX; PICTURES];
    for k in 0..PICTURES {
        while taken[k] == usize::MAX {
            bits = bits.wrapping_add(0x9E37_79B9_7F4A_7C15);
            let mut z = bits;
            z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            let one = posed[((z ^ (z >> 31)) % posed.len() as u64) as usize];
            if !taken[..k].contains(&one) {
                taken[k] = one;
            }
        }
    }
    taken
}

/// The equations of all images.
struct Sums {
    /// Maps from the probe to the reference, by detection.
    maps: Vec<Option<DAffine3>>,
    /// Indices of the detections with a map.
    posed: Vec<usize>,
    unit: Unit,
    /// Prior position of the point, mm, and its standard deviation.
    about: DVec3,
    sd_mm: f64,
}

impl Sums {
    fn new(target: Target, detections: &[Detection], track: &Track, lag_s: f64, size_px: [u32; 2]) -> Self {
        let maps: Vec<Option<DAffine3>> =
            detections.iter().map(|detection| detection.reference_from_probe(track, lag_s)).collect();
        let posed: Vec<usize> = (0..maps.len()).filter(|&i| maps[i].is_some()).collect();
        let middle = maps.iter().flatten().map(|map| map.translation).sum::<DVec3>() / posed.len().max(1) as f64;
        let (about, sd_mm) = match target {
            Target::Tip { place_mm, error_mm } => (place_mm, error_mm),
            Target::Point | Target::Plane => (middle, ANYWHERE_MM),
        };
        Self { maps, posed, unit: Unit::of(size_px), about, sd_mm }
    }

    /// Returns the guess that most detections agree with, by any of their spots: the median
    /// error, mm, the plane and the point.
    fn guessed(&self, detections: &[Detection]) -> Option<(f64, ImagePlane, DVec3)> {
        if self.posed.len() < PICTURES {
            return None;
        }
        let mut best: Option<(f64, ImagePlane, DVec3)> = None;
        for guess in 0..GUESSES {
            let taken = sample(&self.posed, guess);
            let brightest = taken.iter().map(|&i| (i, detections[i].candidates[0], 1.0));
            let Some((plane, point)) = self.solved(brightest) else { continue };
            let nearest = |&i: &usize| {
                let spots = detections[i].candidates.iter().take(SPOTS);
                spots.map(|px| self.off_mm(i, *px, &plane, point)).fold(f64::INFINITY, f64::min)
            };
            let score = median(&mut self.posed.iter().map(nearest).collect::<Vec<_>>());
            if best.as_ref().is_none_or(|(least, ..)| score < *least) {
                best = Some((score, plane, point));
            }
        }
        best
    }

    /// Returns weights of 1 or 0 for agreement with most detections, and selects each detection's
    /// best spot.
    fn agreeing(&self, detections: &mut [Detection]) -> Option<Vec<f64>> {
        let (score, plane, point) = self.guessed(detections)?;
        let mut weights = vec![0.0; detections.len()];
        for &i in &self.posed {
            detections[i].choose(|px| self.off_mm(i, px, &plane, point));
            let off = self.off_mm(i, detections[i].marks[0], &plane, point);
            weights[i] = f64::from(u8::from(off <= AGREES * score.max(LEAST_SPREAD_MM)));
        }
        Some(weights)
    }

    /// Solves for the plane and the point from weighted dots, with 1 mm accuracy each. `None`
    /// if they leave the plane open.
    fn solved(&self, dots: impl Iterator<Item = (usize, DVec2, f64)>) -> Option<(ImagePlane, DVec3)> {
        let (mut matrix, mut right) = ([[0.0; UNKNOWN]; UNKNOWN], [0.0; UNKNOWN]);
        (9..UNKNOWN).for_each(|i| matrix[i][i] = self.sd_mm.powi(-2));
        for (i, px, weight) in dots {
            let Some(map) = self.maps[i].filter(|_| weight > 0.0) else { continue };
            let at = self.unit.brought(px);
            let back = map.matrix3.transpose();
            let there = back * (self.about - map.translation);
            for axis in 0..3 {
                let mut row = [0.0; UNKNOWN];
                (row[axis], row[3 + axis], row[6 + axis]) = (at.x, at.y, 1.0);
                (0..3).for_each(|k| row[9 + k] = -back.col(k)[axis]);
                for (k, entry) in row.iter().enumerate() {
                    (0..=k).for_each(|l| matrix[k][l] += weight * entry * row[l]);
                    right[k] += weight * entry * there[axis];
                }
            }
        }
        let x = solve(matrix, right)?;
        let vector = |first: usize| DVec3::from_slice(&x[first..]);
        Some((self.unit.plane(vector(0), vector(3), vector(6)), self.about + vector(9)))
    }

    /// Returns the distance of a dot from the point, mm.
    fn off_mm(&self, i: usize, px: DVec2, plane: &ImagePlane, point: DVec3) -> f64 {
        self.maps[i].map_or(f64::INFINITY, |map| map.transform_point3(plane.point(px)).distance(point))
    }
}
