//! Three dots in line, as the wires of an N make them.

use super::scale::{ASPECT, IN_LINE_MM, STEEPEST, Scale};
use crate::probe::dots::Dot;
use crate::probe::layout::Layout;

/// Maximum number of lines of three dots: one per N, and accidental ones among noise.
const MOST_LINES: usize = 120;

/// Three dots in line.
#[derive(Debug, Clone, Copy)]
pub(super) struct Triple {
    pub(super) outer: [usize; 2],
    pub(super) middle: usize,
    pub(super) length: f64,
}

/// Finds triples of dots in line, as N's make them.
pub(super) fn find(triples: &mut Vec<Triple>, dots: &[Dot], scale: &Scale, layout: &Layout) {
    triples.clear();
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
                    triples.push(Triple { outer: [i, j], middle, length });
                }
            }
        }
    }
    // Dots are sorted by contrast, the highest first. A line is rated by the faintest of
    // its three.
    triples.sort_by_key(|t| t.outer[0].max(t.outer[1]).max(t.middle));
    triples.truncate(MOST_LINES);
}
