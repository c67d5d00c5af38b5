//! Pairs of slices that are compared: long lines first, few of one slice.

use super::line::END_MARGIN_S;
use super::state::State;
use crate::slices::Slices;

/// Length that two slices have in common, mm, and as a share of the image's smaller side, of which
/// the lesser counts.
const LEAST_MM: f64 = 12.0;
const LEAST_SHARE: f64 = 0.3;
/// Lines of one slice, which are not independent, and lines of all slices.
const MOST_OF_ONE: usize = 30;
const MOST: usize = 1500;

/// Returns the chosen pairs, the earlier slice first. They do not depend on the slices' order in
/// memory.
pub(crate) fn chosen(slices: &Slices, state: &State) -> Vec<[usize; 2]> {
    let n = slices.pixels.len();
    let at = |lag_s: f64, slice: usize| slices.poses.at(slices.pixels[slice].0 + lag_s);
    let pose = |slice: usize| {
        // The lag may change.
        at(-END_MARGIN_S, slice)?;
        at(END_MARGIN_S, slice)?;
        Some(at(0.0, slice)? * state.probe_from_pixel())
    };
    let mut poses: Vec<_> = (0..n).filter_map(|slice| Some((slice, pose(slice)?))).collect();
    poses.sort_by(|a, b| slices.pixels[a.0].0.total_cmp(&slices.pixels[b.0].0));
    let m = state.picture_from_pixel.matrix3;
    let sides = [0, 1].map(|axis| (slices.bounds[axis][1] - slices.bounds[axis][0]) * m.col(axis).length());
    let least_mm = LEAST_MM.min(LEAST_SHARE * sides[0].min(sides[1]));
    let mut found = Vec::new();
    for (rank, (i, a)) in poses.iter().enumerate() {
        for (j, b) in &poses[rank + 1..] {
            let Some([from, to]) = slices.line([a, b]) else { continue };
            let mm = (to - from).length();
            if mm >= least_mm {
                found.push((mm, [*i, *j]));
            }
        }
    }
    // A stable sort makes the choice the same on every machine.
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut of_one = vec![0; n];
    let mut chosen = Vec::new();
    for (_, pair) in found {
        if chosen.len() < MOST && pair.iter().all(|slice| of_one[*slice] < MOST_OF_ONE) {
            pair.iter().for_each(|slice| of_one[*slice] += 1);
            chosen.push(pair);
        }
    }
    chosen
}
