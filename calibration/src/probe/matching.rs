//! Which dot is which wire's.
//!
//! A plane cuts parallel wires in an affine image of how they lie to each other. So two N's are looked for: three dots in line each, the outer ones of both in the affine image of the phantom's four
//! posts, which four points are not by chance. The map that they give says where the other posts are to be, and on which lines the slanted wires. Such a
//! guess is then held against space: the dots have to lie on a plane with pixels that are square, or nearly so, that cuts every wire between its ends; and the plane says where dots are that were
//! overlooked. The guess that explains most dots is taken.
//!
//! Of N's in one plane the dots lie in line, and a row of them is looked for instead (`flat`).
//!
//! How large a pixel is comes out of it. What is asked beforehand is only that the picture shows something between a fingertip and a torso.

mod flat;

use glam::{DAffine3, DMat2, DVec2};

use super::dots::Dot;
use super::layout::{Layout, Pair};
use super::plane::{ImagePlane, PlaneSum, Unit};

/// What the longer side of a picture shows, mm: from the smallest transducers' near field to the deepest abdomen.
pub const PICTURE_MM: [f64; 2] = [15.0, 450.0];
/// How far dots may be from where the phantom has them, mm: wires sag and are off their holes' middles by tenths, a dot's centre is off its wire's by as much, and an extrapolated
/// guess doubles it.
const NEAR_MM: f64 = 0.8;
/// How far an N's middle dot may lie from the line of the others, mm.
const IN_LINE_MM: f64 = 0.6;
/// A pixel's sides differ by this factor at most, as one picture's dots have them: scanners' differ by a few per cent, and the turn of the plane towards the posts is uncertain.
const ASPECT: f64 = 1.6;
/// The cosine between u and v at most, as one picture's dots have it.
const SKEW: f64 = 0.4;
/// Wires of one phantom are about as bright as each other: a dot fainter than the median of the others by this factor costs as much as a misfit of [`NEAR_MM`].
const FAINT: f64 = 4.0;
/// Usual tilt of the plane towards the posts: its tangent's standard deviation.
const USUAL_TILT: f64 = 0.4;
/// A cut lies between a wire's ends, or beyond by this part of its length.
const BEYOND: f64 = 0.05;
/// Steepest cut, as the cosine between the plane's normal and the posts: beyond it a dot is a streak.
pub(super) const STEEPEST: f64 = 0.4;
/// Guesses of a frame that are looked at in space.
const GUESSES: usize = 24;
/// Lines of three that are looked at: an N each in pictures of phantoms, and their like among noise.
const MOST_LINES: usize = 120;
/// Dots that an N's middle one may be.
const MOST_MIDDLES: usize = 4;
/// Ways of choosing one for each N.
const MOST_CHOICES: usize = 64;

/// A dot, and the wire that it shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mark {
    /// Among the phantom's wires.
    pub wire: usize,
    /// Its centre, pixels.
    pub at_px: DVec2,
    /// How far it stands out, grey levels.
    pub contrast: f32,
}

/// A picture's dots, recognised.
#[derive(Debug, Clone, PartialEq)]
pub struct Match {
    /// By wire.
    pub marks: Vec<Mark>,
    /// Where the picture lies in the phantom, by these dots alone.
    pub plane: ImagePlane,
    /// Root mean square of the dots' distances from their wires, mm.
    pub rms_mm: f64,
    /// Whether u points to where the phantom's file has the right, as seen in the picture.
    pub rightwards: bool,
    /// What tells readings of as many dots apart: misfit against what is usual, pixels that are not square, and dots that are faint.
    cost: f64,
}

/// Recognises dots. Memory is kept from picture to picture.
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

/// A map from across the posts to the picture.
#[derive(Debug, Clone)]
struct Guess {
    map: DMat2,
    shift: DVec2,
    explained: usize,
    misfit: f64,
}

/// What a picture's dots may be: the better reading, and the best one from the other side where it explains as many dots.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// The one that explains most dots, and those best.
    pub best: Match,
    /// One that sees the phantom from the other side. Where it is there, the dots alone do not tell.
    pub mirrored: Option<Match>,
}

/// A picture's scale, and what follows from it.
#[derive(Debug, Clone, Copy)]
struct Scale {
    unit: Unit,
    /// Least and largest size of a pixel, mm.
    pixel_mm: [f64; 2],
    /// Contrast of the median one of as many dots as there are wires, the brightest.
    usual: f64,
}

impl Scale {
    /// How faint a dot is, 1 where it is so by [`FAINT`]: echoes are.
    fn faint(&self, contrast: f32) -> f64 {
        (self.usual / f64::from(contrast)).ln().max(0.0) / FAINT.ln()
    }

    /// What speaks against a dot for a wire: distance over [`NEAR_MM`] and faintness; `None` farther away.
    fn against(&self, distance_mm: f64, dot: &Dot) -> Option<f64> {
        (distance_mm <= NEAR_MM).then(|| distance_mm / NEAR_MM + self.faint(dot.contrast))
    }
}

/// The dot that least speaks against, of those that anything is to be said of.
fn best(dots: impl Iterator<Item = (usize, Option<f64>)>) -> Option<(usize, f64)> {
    dots.filter_map(|(dot, against)| Some((dot, against?))).min_by(|a, b| a.1.total_cmp(&b.1))
}

impl Matcher {
    /// One that has seen no picture.
    pub fn new() -> Self {
        Self::default()
    }

    /// Reads the dots of a picture of that size. `None` where no [`Layout::least_dots`] or more of them lie as the phantom's wires do.
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

    /// Three dots in line, as N's make them.
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
        // Dots come with most contrast first: the faintest of three says how much a line is worth.
        self.triples.sort_by_key(|t| t.outer[0].max(t.outer[1]).max(t.middle));
        self.triples.truncate(MOST_LINES);
    }

    /// Maps from two lines at a time.
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

/// A combination of four dots.
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
    /// The map that four dots give, if it is one that a plane makes.
    fn of(pair: &Pair, four: &[usize; 4], dots: &[Dot], scale: &Scale, layout: &Layout) -> Option<Self> {
        let [x, y, shift] = [0, 1, 2].map(|i| combined(&pair.inverse[i], four, dots));
        let map = DMat2::from_cols(x, y);
        // Across the posts a plane is shortened along one direction, by the cosine of its tilt; a map to pixels is as much longer there.
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

    /// The pixel of a place across the posts.
    fn at(&self, across: DVec2) -> DVec2 {
        self.map * across + self.shift
    }

    /// The reading that the guess leads to, if there is a plane that makes it.
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

/// The singular values of a 2×2 matrix, larger first, by the sum of its squares and its determinant.
fn singular(sum: f64, determinant: f64) -> (f64, f64) {
    let (plus, minus) = ((sum + 2.0 * determinant.abs()).sqrt(), (sum - 2.0 * determinant.abs()).max(0.0).sqrt());
    (0.5 * (plus + minus), 0.5 * (plus - minus))
}

/// How far a place lies from the way between two others, if it lies between them.
fn off_line(at: DVec2, from: DVec2, to: DVec2) -> Option<f64> {
    let (way, own) = (to - from, at - from);
    let share = own.dot(way) / way.length_squared();
    (share > 0.0 && share < 1.0).then(|| own.perp_dot(way).abs() / way.length())
}

/// The plane of the marks; then the dots that the plane says are wires', until nothing changes.
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
    /// The plane that these marks lie on, if it is one that a scanner may have. Marks that do not, few as they may be, are left out.
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
            // The slanted wires' dots may be in line or too few: then nothing else says how the plane is turned towards the posts.
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
