//! A guessed map from the plane across the posts to the image, and the reading that it gives.

use glam::{DMat2, DVec2};

use super::marks::{Mark, Match, settle};
use super::scale::{ASPECT, IN_LINE_MM, NEAR_MM, STEEPEST, Scale, best};
use crate::probe::dots::Dot;
use crate::probe::layout::{Layout, Pair};

/// Number of guesses per frame that are checked in space.
const GUESSES: usize = 24;
/// Maximum number of candidates for an N's middle dot.
const MOST_MIDDLES: usize = 4;
/// Maximum number of combinations of middle dots.
const MOST_CHOICES: usize = 64;

/// A map from the plane perpendicular to the posts to the image.
#[derive(Debug, Clone)]
pub(super) struct Guess {
    map: DMat2,
    shift: DVec2,
    explained: usize,
    misfit: f64,
}

impl Guess {
    /// Returns the map given by four dots, if a plane can produce it.
    pub(super) fn of(pair: &Pair, four: &[usize; 4], dots: &[Dot], scale: &Scale, layout: &Layout) -> Option<Self> {
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
    pub(super) fn in_space(&self, dots: &[Dot], scale: &Scale, layout: &Layout) -> Option<Match> {
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

/// Keeps the best guesses, each once.
pub(super) fn keep(guesses: &mut Vec<Guess>, guess: Guess, layout: &Layout) {
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

/// Returns a linear combination of four dots.
pub(super) fn combined(weights: &[f64; 4], four: &[usize; 4], dots: &[Dot]) -> DVec2 {
    weights.iter().zip(four).map(|(weight, &dot)| *weight * dots[dot].at_px).sum()
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
