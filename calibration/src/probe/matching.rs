//! Assigns dots to wires.
//!
//! A plane cuts parallel wires in an affine image of their arrangement. So the matcher looks
//! for two N's: three dots in line each, with the four outer dots in the affine image of the
//! phantom's four posts. Four points hardly match by chance. Their map predicts the other
//! posts' dots and the lines on which the slanted wires' dots lie. Such a guess is then checked
//! in space. The dots must lie on a plane with nearly square pixels that cuts every wire
//! between its ends. The plane also predicts dots that were overlooked. The guess that explains
//! most dots wins.
//!
//! For N's in one plane the dots are in line, and a row of them is searched instead (`flat`).
//!
//! The pixel size follows from the match. The only assumption is an image size between a
//! fingertip and a torso.

mod flat;

use glam::{DAffine3, DMat2, DVec2};

use super::dots::Dot;
use super::layout::{Layout, Pair};
use super::plane::{ImagePlane, PlaneSum, Unit};

/// Range of the longer side of an image, mm: from the smallest transducers' near field to the
/// deepest abdomen.
pub const PICTURE_MM: [f64; 2] = [15.0, 450.0];
/// Largest distance of dots from their predicted places, mm. Wires sag and are off their holes'
/// centres by tenths, a dot's centre is off by as much, and an extrapolated guess doubles it.
const NEAR_MM: f64 = 0.8;
/// Largest distance of an N's middle dot from the line of the others, mm.
const IN_LINE_MM: f64 = 0.6;
/// Largest ratio of a pixel's sides as computed from one image. Scanners' pixels differ by a
/// few per cent, and the plane's angle to the posts is uncertain.
const ASPECT: f64 = 1.6;
/// Largest cosine between u and v as computed from one image.
const SKEW: f64 = 0.4;
/// The wires of a phantom are about equally bright. A dot fainter than the others' median by
/// this factor costs as much as a misfit of [`NEAR_MM`].
const FAINT: f64 = 4.0;
/// Usual tilt of the plane against the posts: standard deviation of its tangent.
const USUAL_TILT: f64 = 0.4;
/// A wire may be cut beyond its ends by this share of its length.
const BEYOND: f64 = 0.05;
/// Steepest cut, as the cosine between the plane's normal and the posts: beyond it a dot is a
/// streak.
pub(super) const STEEPEST: f64 = 0.4;
/// Number of guesses per frame that are checked in space.
const GUESSES: usize = 24;
/// Maximum number of lines of three dots: one per N, and accidental ones among noise.
const MOST_LINES: usize = 120;
/// Maximum number of candidates for an N's middle dot.
const MOST_MIDDLES: usize = 4;
/// Maximum number of combinations of middle dots.
const MOST_CHOICES: usize = 64;

/// A dot assigned to a wire.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mark {
    /// Index of the phantom's wire.
    pub wire: usize,
    /// Its centre, pixels.
    pub at_px: DVec2,
    /// Height above its surroundings, grey levels.
    pub contrast: f32,
}

/// The recognised dots of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct Match {
    /// The dots, by wire.
    pub marks: Vec<Mark>,
    /// The image plane in the phantom's frame, from these dots only.
    pub plane: ImagePlane,
    /// Root mean square of the dots' distances from their wires, mm.
    pub rms_mm: f64,
    /// Whether u points to the right as defined by the phantom's file.
    pub rightwards: bool,
    /// Cost for comparing readings of equally many dots: unusual misfit, pixels that are not
    /// square, and faint dots.
    cost: f64,
}

/// Recognises dots; reuses its memory from image to image.
#[derive(Debug, Default)]
pub struct Matcher {
    triples: Vec<Triple>,
    guesses: Vec<Guess>,
}

/// Three dots in line.
#[derive(Debug, Clone, Copy)]
struct Triple {
    outer: [usize; 2],
    middle: usize,
    length: f64,
}

/// A map from the plane perpendicular to the posts to the image.
#[derive(Debug, Clone)]
struct Guess {
    map: DMat2,
    shift: DVec2,
    explained: usize,
    misfit: f64,
}

/// The possible readings of an image: the better one, and the best one from the other side if
/// it explains as many dots.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// The reading that explains most dots, with the least cost.
    pub best: Match,
    /// A reading from the other side. If there is one, the dots alone do not decide.
    pub mirrored: Option<Match>,
}

/// An image's scale, and quantities that follow from it.
#[derive(Debug, Clone, Copy)]
struct Scale {
    unit: Unit,
    /// Smallest and largest pixel size, mm.
    pixel_mm: [f64; 2],
    /// Median contrast of the brightest dots, as many as there are wires.
    usual: f64,
}

impl Scale {
    /// Returns a dot's faintness, 1 at a factor of [`FAINT`]: echoes are faint.
    fn faint(&self, contrast: f32) -> f64 {
        (self.usual / f64::from(contrast)).ln().max(0.0) / FAINT.ln()
    }

    /// Returns the cost of a dot for a wire: distance over [`NEAR_MM`] plus faintness; `None`
    /// if farther away.
    fn against(&self, distance_mm: f64, dot: &Dot) -> Option<f64> {
        (distance_mm <= NEAR_MM).then(|| distance_mm / NEAR_MM + self.faint(dot.contrast))
    }
}

/// Returns the dot of the least cost.
fn best(dots: impl Iterator<Item = (usize, Option<f64>)>) -> Option<(usize, f64)> {
    dots.filter_map(|(dot, against)| Some((dot, against?))).min_by(|a, b| a.1.total_cmp(&b.1))
}

impl Matcher {
    /// Returns a matcher without state.
    pub fn new() -> Self {
        Self::default()
    }

    /// Recognises the dots of an image of this size. `None` if fewer than
    /// [`Layout::least_dots`] match the phantom's wires.
    pub fn read(&mut self, dots: &[Dot], size_px: [u32; 2], layout: &Layout) -> Option<Reading> {
        let longest = f64::from(size_px[0].max(size_px[1]).max(1));
        let middle = dots.len().min(layout.geometry().wires().len()) / 2;
        let usual = dots.get(middle).map_or(1.0, |dot| f64::from(dot.contrast));
        let scale = Scale { unit: Unit::of(size_px), pixel_mm: PICTURE_MM.map(|mm| mm / longest), usual };
        self.lines(dots, &scale, layout);
        let mut readings: Vec<Match> = if layout.is_flat() {
            flat::readings(&self.triples, dots, &scale, layout)
        } else {
            self.guess(dots, &scale, layout);
            self.guesses.iter().filter_map(|guess| guess.in_space(dots, &scale, layout)).collect()
        };
        readings.sort_by(|a, b| b.marks.len().cmp(&a.marks.len()).then(a.cost.total_cmp(&b.cost)));
        let mut readings = readings.into_iter();
        let best = readings.next()?;
        let as_many = |other: &Match| other.rightwards != best.rightwards && other.marks.len() >= best.marks.len();
        let mirrored = readings.find(as_many);
        Some(Reading { best, mirrored })
    }

    /// Finds triples of dots in line, as N's make them.
    fn lines(&mut self, dots: &[Dot], scale: &Scale, layout: &Layout) {
        self.triples.clear();
        let widths = layout.ns().iter().map(|n| n.width_mm);
        let (least, most) = widths.fold((f64::INFINITY, 0.0_f64), |(a, b), mm| (a.min(mm), b.max(mm)));
        let lengths = [least / (scale.pixel_mm[1] * ASPECT), most * ASPECT / (scale.pixel_mm[0] * STEEPEST)];
        let in_line = IN_LINE_MM / least;
        for (i, a) in dots.iter().enumerate() {
            for (j, b) in dots.iter().enumerate().skip(i + 1) {
                let way = b.at_px - a.at_px;
                let length = way.length();
                if !(lengths[0]..=lengths[1]).contains(&length) {
                    continue;
                }
                for (middle, dot) in dots.iter().enumerate() {
                    let from = dot.at_px - a.at_px;
                    let share = from.dot(way) / (length * length);
                    let is_between = middle != i && middle != j && share > 0.0 && share < 1.0;
                    if is_between && from.perp_dot(way).abs() <= in_line * length * length {
                        self.triples.push(Triple { outer: [i, j], middle, length });
                    }
                }
            }
        }
        // Dots are sorted by contrast, the highest first. A line is rated by the faintest of
        // its three.
        self.triples.sort_by_key(|t| t.outer[0].max(t.outer[1]).max(t.middle));
        self.triples.truncate(MOST_LINES);
    }

    /// Computes maps from pairs of lines.
    fn guess(&mut self, dots: &[Dot], scale: &Scale, layout: &Layout) {
        self.guesses.clear();
        for pair in layout.pairs() {
            for (at, first) in self.triples.iter().enumerate() {
                for second in self.triples[..at].iter().chain(&self.triples[at + 1..]) {
                    let own = [first.outer[0], first.outer[1], first.middle];
                    if [second.outer[0], second.outer[1], second.middle].iter().any(|dot| own.contains(dot)) {
                        continue;
                    }
                    for [a, b] in [[0, 1], [1, 0]] {
                        for [c, d] in [[0, 1], [1, 0]] {
                            let four = [first.outer[a], first.outer[b], second.outer[c], second.outer[d]];
                            let off = combined(&pair.test, &four, dots);
                            let near = NEAR_MM * first.length.max(second.length) / layout.ns()[pair.ns[0]].width_mm;
                            if off.length_squared() > near * near {
                                continue;
                            }
                            if let Some(guess) = Guess::of(pair, &four, dots, scale, layout) {
                                keep(&mut self.guesses, guess, layout);
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Returns a linear combination of four dots.
fn combined(weights: &[f64; 4], four: &[usize; 4], dots: &[Dot]) -> DVec2 {
    weights.iter().zip(four).map(|(weight, &dot)| *weight * dots[dot].at_px).sum()
}

/// Keeps the best guesses, each once.
fn keep(guesses: &mut Vec<Guess>, guess: Guess, layout: &Layout) {
    let better =
        |a: &Guess, b: &Guess| a.explained > b.explained || (a.explained == b.explained && a.misfit < b.misfit);
    let back = guess.map.inverse();
    let is_same = |other: &Guess| {
        layout.posts().iter().all(|post| (back * (other.at(post.at) - guess.at(post.at))).length() < NEAR_MM)
    };
    if let Some(same) = guesses.iter_mut().find(|other| is_same(other)) {
        if better(&guess, same) {
            *same = guess;
        }
    } else if guesses.len() < GUESSES {
        guesses.push(guess);
    } else if let Some(worst) = guesses.iter_mut().reduce(|a, b| if better(a, b) { b } else { a })
        && better(&guess, worst)
    {
        *worst = guess;
    }
}

impl Guess {
    /// Returns the map given by four dots, if a plane can produce it.
    fn of(pair: &Pair, four: &[usize; 4], dots: &[Dot], scale: &Scale, layout: &Layout) -> Option<Self> {
        let [x, y, shift] = [0, 1, 2].map(|i| combined(&pair.inverse[i], four, dots));
        let map = DMat2::from_cols(x, y);
        // A tilt shortens one direction across the posts by its cosine; a map to pixels is
        // longer there by as much.
        let (long, short) = singular(x.length_squared() + y.length_squared(), map.determinant());
        let pixel_mm = 1.0 / short;
        let fits = pixel_mm >= scale.pixel_mm[0] / ASPECT
            && pixel_mm <= scale.pixel_mm[1] * ASPECT
            && short >= long * STEEPEST / ASPECT;
        if !fits {
            return None;
        }
        let mut guess = Self { map, shift, explained: 0, misfit: 0.0 };
        let back = map.inverse();
        let explain = |found: Option<(usize, f64)>, guess: &mut Self| {
            if let Some((_, against)) = found {
                guess.explained += 1;
                guess.misfit += against;
            }
        };
        for post in layout.posts() {
            let there = guess.at(post.at);
            let of_dot = |dot: &Dot| scale.against((back * (dot.at_px - there)).length(), dot);
            explain(best(dots.iter().map(of_dot).enumerate()), &mut guess);
        }
        for n in layout.ns() {
            let [from, to] = n.outer.map(|post| layout.posts()[post].at);
            let of_dot = |dot: &Dot| scale.against(off_line(back * (dot.at_px - shift), from, to)?, dot);
            explain(best(dots.iter().map(of_dot).enumerate()), &mut guess);
        }
        (guess.explained >= layout.least_dots()).then_some(guess)
    }

    /// Returns the pixel of a position across the posts.
    fn at(&self, across: DVec2) -> DVec2 {
        self.map * across + self.shift
    }

    /// Returns the reading from this guess, if there is a matching plane.
    fn in_space(&self, dots: &[Dot], scale: &Scale, layout: &Layout) -> Option<Match> {
        let back = self.map.inverse();
        let mut used = vec![false; dots.len()];
        let mut posts = Vec::new();
        for post in layout.posts() {
            let there = self.at(post.at);
            let of_dot = |dot: &Dot| scale.against((back * (dot.at_px - there)).length(), dot);
            let free = dots.iter().map(of_dot).enumerate().filter(|(dot, _)| !used[*dot]);
            if let Some((dot, _)) = best(free) {
                used[dot] = true;
                posts.push(Mark::of(post.wire, &dots[dot]));
            }
        }
        // Each N's middle dot may be one of several, or none.
        let mut choices: Vec<Vec<Mark>> = vec![posts];
        for n in layout.ns() {
            let [from, to] = n.outer.map(|post| layout.posts()[post].at);
            let marks: Vec<Mark> = (0..dots.len())
                .filter(|&dot| !used[dot])
                .filter(|&dot| {
                    let off = off_line(back * (dots[dot].at_px - self.shift), from, to);
                    off.is_some_and(|off| off <= IN_LINE_MM)
                })
                .map(|dot| Mark::of(n.middle, &dots[dot]))
                .take(MOST_MIDDLES)
                .collect();
            if !marks.is_empty() {
                let with =
                    |choice: &Vec<Mark>| marks.iter().map(|mark| [&choice[..], &[*mark]].concat()).collect::<Vec<_>>();
                choices = choices.iter().flat_map(with).collect();
                choices.truncate(MOST_CHOICES);
            }
        }
        let readings = choices.into_iter().filter_map(|marks| settle(marks, dots, scale, layout));
        readings.reduce(|a, b| {
            let better = b.marks.len() > a.marks.len() || (b.marks.len() == a.marks.len() && b.cost < a.cost);
            if better { b } else { a }
        })
    }
}

impl Mark {
    fn of(wire: usize, dot: &Dot) -> Self {
        Self { wire, at_px: dot.at_px, contrast: dot.contrast }
    }
}

/// Returns the singular values of a 2×2 matrix, larger first, from its sum of squares and its
/// determinant.
fn singular(sum: f64, determinant: f64) -> (f64, f64) {
    let (plus, minus) = ((sum + 2.0 * determinant.abs()).sqrt(), (sum - 2.0 * determinant.abs()).max(0.0).sqrt());
    (0.5 * (plus + minus), 0.5 * (plus - minus))
}

/// Returns the distance of a point from the segment between two others, if its foot lies on the
/// segment.
fn off_line(at: DVec2, from: DVec2, to: DVec2) -> Option<f64> {
    let (way, own) = (to - from, at - from);
    let share = own.dot(way) / way.length_squared();
    (share > 0.0 && share < 1.0).then(|| own.perp_dot(way).abs() / way.length())
}

/// Fits a plane to the marks, then reassigns dots by that plane until nothing changes.
fn settle(marks: Vec<Mark>, dots: &[Dot], scale: &Scale, layout: &Layout) -> Option<Match> {
    let wires = layout.geometry().wires();
    let mut found = Match::of(marks, scale, layout)?;
    for _ in 0..4 {
        let mut marks: Vec<Mark> = Vec::new();
        for (number, wire) in wires.iter().enumerate() {
            let Some((px, share)) = found.plane.cut(wire) else { continue };
            if !(-BEYOND..=1.0 + BEYOND).contains(&share) {
                continue;
            }
            let of_dot = |dot: &Dot| scale.against(found.plane.point(dot.at_px).distance(found.plane.point(px)), dot);
            let free = |dot: usize| marks.iter().all(|mark| mark.at_px != dots[dot].at_px);
            let nearest = best(dots.iter().map(of_dot).enumerate().filter(|(dot, _)| free(*dot)));
            if let Some((dot, _)) = nearest {
                marks.push(Mark::of(number, &dots[dot]));
            }
        }
        if marks == found.marks {
            break;
        }
        found = Match::of(marks, scale, layout)?;
    }
    Some(found)
}

impl Match {
    /// Returns the plane of these marks, if a scanner can have it. Marks off the plane are left
    /// out.
    fn of(mut marks: Vec<Mark>, scale: &Scale, layout: &Layout) -> Option<Self> {
        let wires = layout.geometry().wires();
        let along = wires[layout.posts()[0].wire].direction();
        loop {
            if marks.len() < layout.least_dots() {
                return None;
            }
            let mut sum = PlaneSum::new(scale.unit);
            for mark in &marks {
                sum.add_dot(mark.at_px, &wires[mark.wire], &DAffine3::IDENTITY, 1.0);
            }
            // The slanted wires' dots may be in line or too few. Then only this prior fixes the
            // plane's angle to the posts.
            let across = sum.solve(true)?.pixel_mm();
            sum.add_tilt(along, USUAL_TILT * across[0].max(across[1]), NEAR_MM / 3.0);
            let plane =
                if layout.is_flat() { flat::plane(&sum.solve(true)?, &marks, along)? } else { sum.solve(false)? };
            let off: Vec<(f64, f64)> =
                marks.iter().map(|mark| wires[mark.wire].nearest(plane.point(mark.at_px))).collect();
            let is_on =
                |(distance, share): &(f64, f64)| *distance <= NEAR_MM && (-BEYOND..=1.0 + BEYOND).contains(share);
            if !off.iter().all(is_on) {
                let worst = (0..marks.len()).max_by(|&a, &b| off[a].0.total_cmp(&off[b].0))?;
                marks.remove(worst);
                continue;
            }
            let [u, v] = plane.pixel_mm();
            let sizes = scale.pixel_mm[0]..=scale.pixel_mm[1];
            let steep = plane.u.cross(plane.v).normalize_or_zero().dot(along).abs();
            let fits = sizes.contains(&u) && sizes.contains(&v) && u <= ASPECT * v && v <= ASPECT * u;
            if !fits || plane.skew().abs() > SKEW || steep < STEEPEST {
                return None;
            }
            let rightwards = plane.u.dot(layout.rightwards()) > 0.0;
            let squares: f64 = off.iter().map(|(distance, _)| distance * distance).sum();
            let rms_mm = (squares / marks.len() as f64).sqrt();
            let (misfit, aspect, skew) = (rms_mm / NEAR_MM, (u / v).ln() / ASPECT.ln(), plane.skew() / SKEW);
            let faint: f64 = marks.iter().map(|mark| scale.faint(mark.contrast).powi(2)).sum();
            let cost = misfit * misfit + aspect * aspect + skew * skew + faint;
            return Some(Self { marks, plane, rms_mm, rightwards, cost });
        }
    }
}
