//! A rectangle's sides, each by itself.

use sonoweave_core::region::ClipRect;

use super::edges::{EdgeFinder, Place, Segment, segments};
use super::outline::{Ends, Outline};

/// Pixels at the ends of a side that do not count: corners are blurred.
const CORNER: f64 = 6.0;
/// Reach of the measurements, pixels.
const REACHES: [usize; 3] = [8, 5, 4];

/// Sides of a rectangle, between pixels' centres: left, right, top, bottom.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sides(pub(super) [f64; 4]);

impl Sides {
    /// Returns the sides on which most of an outline's ends lie; a side beyond the frame's
    /// `size` is the frame's.
    pub(super) fn of_outline(outline: &Outline, size: [usize; 2]) -> Option<Self> {
        let side = |ends: &Ends, frame: f64, outwards: f64| {
            if ends.is_cut() {
                return Some(frame);
            }
            let places: Vec<f64> = ends.ends.iter().map(|[_, end]| *end as f64).collect();
            densest(&places).map(|place| place + outwards)
        };
        let sides = [
            side(&outline.left, -0.5, -0.5)?,
            side(&outline.right, size[0] as f64 - 0.5, 0.5)?,
            side(&outline.top, -0.5, -0.5)?,
            side(&outline.bottom, size[1] as f64 - 0.5, 0.5)?,
        ];
        (sides[0] < sides[1] && sides[2] < sides[3]).then_some(Self(sides))
    }

    /// Moves the sides to the edges that are seen.
    pub(super) fn fit(mut self, finder: &EdgeFinder<'_>) -> Self {
        for reach in REACHES {
            let segments = self.segments();
            for side in 0..4 {
                let outwards = if side % 2 == 0 { -1.0 } else { 1.0 };
                let places = segments.iter().filter(|segment| segment.edge == side);
                let places: Vec<f64> = places
                    .filter_map(|segment| match finder.locate(segment, reach) {
                        Place::At(away) => Some(self.0[side] + outwards * away),
                        Place::OffFrame | Place::Unseen => None,
                    })
                    .collect();
                self.0[side] = densest(&places).unwrap_or(self.0[side]);
            }
        }
        self
    }

    /// Returns the whole pixels inside, within the frame's `size`.
    pub(super) fn rect(&self, size: [usize; 2]) -> Option<ClipRect> {
        let whole = |side: f64, most: usize| (side + 0.5).round().clamp(0.0, most as f64) as u32;
        let [left, right] = [0, 1].map(|side| whole(self.0[side], size[0]));
        let [top, bottom] = [2, 3].map(|side| whole(self.0[side], size[1]));
        ClipRect::new(left, top, right.saturating_sub(left), bottom.saturating_sub(top)).ok()
    }

    /// Returns the outline as segments.
    pub(super) fn segments(&self) -> Vec<Segment> {
        let [left, right, top, bottom] = self.0;
        let along = |from: f64, to: f64| {
            let count = (to - from - 2.0 * CORNER).max(0.0) as usize;
            (0..count).map(move |at| from + CORNER + at as f64)
        };
        let vertical =
            |edge, u, normal| segments(edge, &along(top, bottom).map(|v| ([u, v], normal)).collect::<Vec<_>>());
        let level = |edge, v, normal| segments(edge, &along(left, right).map(|u| ([u, v], normal)).collect::<Vec<_>>());
        let mut all = vertical(0, left, [-1.0, 0.0]);
        all.extend(vertical(1, right, [1.0, 0.0]));
        all.extend(level(2, top, [0.0, -1.0]));
        all.extend(level(3, bottom, [0.0, 1.0]));
        all
    }
}

/// Returns the mean of the values in the densest window of 2; `None` without values. Among equal
/// windows, the first.
pub(super) fn densest(values: &[f64]) -> Option<f64> {
    let mut values = values.to_vec();
    values.sort_by(f64::total_cmp);
    let mut best: &[f64] = &[];
    let mut end = 0;
    for begin in 0..values.len() {
        while end < values.len() && values[end] - values[begin] <= 2.0 {
            end += 1;
        }
        if end - begin > best.len() {
            best = &values[begin..end];
        }
    }
    (!best.is_empty()).then(|| best.iter().sum::<f64>() / best.len() as f64)
}
