//! Assigns dots to wires.
//!
//! A plane cuts parallel wires in an affine image of their arrangement. So the matcher
//! searches two N's: three dots in line each, with the four outer dots in the affine image of the
//! phantom's four posts. Four points hardly match by chance. Their map predicts the other
//! posts' dots and the lines on which the slanted wires' dots lie. Such a guess is then checked
//! in space. The dots must lie on a plane with nearly square pixels that cuts every wire
//! between its ends. The plane also predicts dots that were missed. The guess that explains
//! most dots wins.
//!
//! For N's in one plane the dots are in line, and a row of them is searched instead (`flat`).
//!
//! The pixel size follows from the match. The only assumption is an image size between a
//! fingertip and a torso.

mod flat;
mod guess;
mod lines;
mod marks;
mod scale;

use super::dots::Dot;
use super::layout::Layout;
use super::plane::Unit;
use guess::{Guess, combined, keep};
use lines::Triple;
pub use marks::{Mark, Match};
pub use scale::PICTURE_MM;
pub(super) use scale::STEEPEST;
use scale::{NEAR_MM, Scale};

/// Recognises dots; reuses its memory from image to image.
#[derive(Debug, Default)]
pub struct Matcher {
    triples: Vec<Triple>,
    guesses: Vec<Guess>,
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
        lines::find(&mut self.triples, dots, &scale, layout);
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
