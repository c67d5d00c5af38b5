//! The mask of frames whose border is exactly zero.
//!
//! Pixels that are zero in all of the first frames are either that border or dark tissue. Shape
//! distinguishes the two. A picture is one connected region, filled nearly everywhere, with a
//! convex outline except for its top, which a curved transducer makes concave. In MF
//! orientation the transducer is at the top. If no such region is found, a side of the frame is
//! cut only where the picture's edge on that side is plain.

use std::sync::Arc;

use sonoweave_core::region::ClipRect;
use sonoweave_core::slice::{Image, Pixels};

use super::border::Map;
use super::found::{MaskFound, MaskShape, UnsureReason};
use super::shape::{Run, hull_rows, largest_component, opened, runs};
use super::{Mask, Span};

/// Least fraction of all live pixels that the image's component must hold. Burned-in text and
/// rulers hold less than the rest.
const MIN_COMPONENT: f64 = 0.90;
/// Least fraction of the region that live pixels must fill: tissue with dark parts passes,
/// bright dots in water do not.
const MIN_FILL: f64 = 0.80;
/// Least fraction of the frame that the region must cover.
const MIN_AREA: f64 = 0.10;
/// Least area of the first half of the frames' region, relative to the final one. An image's
/// outline is static; a bright object's outline grows and shrinks as the sweep passes it.
const MIN_STEADY: f64 = 0.97;
/// Lines at a side of the live pixels' box that must be live, and the fraction of each that
/// must be.
const EDGE_LINES: usize = 3;
const MIN_EDGE: f64 = 0.50;

/// Radius of the smallest square of zeros that is a border, pixels. Noise about zero has zeros,
/// too.
const BORDER: usize = 3;

/// Pixels that have differed from zero.
#[derive(Debug)]
pub(super) struct ExactSearch {
    width: u32,
    height: u32,
    /// Number, from 1, of the frame in which a pixel first differed from zero; 0 for never.
    first_live: Vec<u8>,
    frames: u8,
}

impl ExactSearch {
    pub(super) fn new(width: u32, height: u32) -> Self {
        Self { width, height, first_live: vec![0; width as usize * height as usize], frames: 0 }
    }

    /// Examines a frame; returns the number of frames so far.
    pub(super) fn push(&mut self, image: &Image) -> u8 {
        self.frames += 1;
        match image.pixels() {
            Pixels::U8(p) => mark(&mut self.first_live, p, 0, self.frames),
            Pixels::U16(p) => mark(&mut self.first_live, p, 0, self.frames),
            Pixels::F32(p) => mark(&mut self.first_live, p, 0.0, self.frames),
        }
        self.frames
    }

    /// Removes all frames.
    pub(super) fn clear(&mut self) {
        self.first_live.fill(0);
        self.frames = 0;
    }

    fn live(&self) -> Vec<bool> {
        self.first_live.iter().map(|&first| first != 0).collect()
    }

    /// Returns the number of pixels that have differed from zero.
    pub(super) fn live_pixels(&self) -> usize {
        self.first_live.iter().filter(|&&first| first != 0).count()
    }

    /// Returns the smallest rectangle around pixels that have differed from zero.
    pub(super) fn live_bounds(&self) -> Option<ClipRect> {
        let all = runs(&self.live(), self.width as usize);
        let [first, last] = [all.first()?.row, all.last()?.row];
        let left = all.iter().map(|run| run.start).min()?;
        let right = all.iter().map(|run| run.end).max()?;
        let [x, y, width, height] = [left, first, right - left, last + 1 - first].map(|n| u32::try_from(n).ok());
        ClipRect::new(x?, y?, width?, height?).ok()
    }

    /// Returns the share of the frame that squares of zeros cover.
    pub(super) fn dead_share(&self) -> f64 {
        let (width, height) = (self.width as usize, self.height as usize);
        let set = self.first_live.iter().map(|&first| first == 0).collect();
        let dead = Map { width, height, set }.opened(BORDER);
        fraction(dead.set.iter().filter(|dead| **dead).count(), self.first_live.len())
    }

    /// Returns the mask of the frames so far.
    pub(super) fn find(&self) -> MaskFound {
        let (mask, certain, reasons) = self.mask();
        let rect = mask.bounds().filter(|rect| u64::from(rect.width) * u64::from(rect.height) == mask.area());
        let shape = match rect {
            _ if mask.is_full() => MaskShape::Whole,
            Some(rect) => MaskShape::Rectangle(rect),
            None => MaskShape::Outline,
        };
        let (recognised, confidence) = (certain.is_some(), certain.unwrap_or(0.0));
        MaskFound { mask: Arc::new(mask), shape, recognised, confidence, border: None, reasons }
    }

    /// Returns the mask, the confidence in a recognised picture, and reasons.
    fn mask(&self) -> (Mask, Option<f64>, Vec<UnsureReason>) {
        let live = self.live();
        let all = runs(&live, self.width as usize);
        if let Some((mask, confidence)) = self.picture(&all) {
            return (mask, Some(confidence), Vec::new());
        }
        let (mask, reasons) = self.sides(&live, &all);
        (mask, None, reasons)
    }

    /// Returns the region of a recognised picture, and the share of all live pixels that it holds.
    fn picture(&self, all: &[Run]) -> Option<(Mask, f64)> {
        let live: usize = all.iter().map(Run::len).sum();
        let component = largest_component(all);
        let held: usize = component.iter().map(Run::len).sum();
        if live == 0 || fraction(held, live) < MIN_COMPONENT {
            return None;
        }
        let mask = self.region(&component);
        let area = usize::try_from(mask.area()).unwrap_or(usize::MAX);
        if fraction(area, self.first_live.len()) < MIN_AREA || fraction(inside(&mask, all), area) < MIN_FILL {
            return None;
        }
        if self.frames >= 4 {
            let half: Vec<bool> = self.first_live.iter().map(|&first| first != 0 && first <= self.frames / 2).collect();
            let early = largest_component(&runs(&half, self.width as usize));
            let early = if early.is_empty() { 0 } else { self.region(&early).area() };
            if fraction(usize::try_from(early).unwrap_or(usize::MAX), area) < MIN_STEADY {
                return None;
            }
        }
        Some((mask, fraction(held, live)))
    }

    /// Returns the component's convex hull, without the part above its top edge.
    fn region(&self, component: &[Run]) -> Mask {
        let (width, height) = (self.width as usize, self.height as usize);
        let mut top = vec![height; width];
        for run in component {
            for first in &mut top[run.start..run.end] {
                *first = (*first).min(run.row);
            }
        }
        // The component reaches every column between its outermost ones.
        let from = top.iter().position(|&row| row < height).unwrap_or(0);
        let to = top.iter().rposition(|&row| row < height).map_or(0, |last| last + 1);
        // A column that is dark at its top for a few pixels is speckle or a dead element, not
        // an edge; an arc bends less than a pixel over this window.
        top.splice(from..to, opened(&top[from..to], (width / 128).max(2)));
        let (first_row, hull) = hull_rows(component);
        Mask::from_rows(
            self.width,
            (0..height).map(|row| {
                let (start, end) = row.checked_sub(first_row).and_then(|at| hull.get(at)).copied().unwrap_or((0, 0));
                let mut spans: Vec<Span> = Vec::new();
                for column in (start..end).filter(|&column| top[column] <= row) {
                    let column = u32::try_from(column).unwrap_or(u32::MAX);
                    match spans.last_mut() {
                        Some(last) if last.end == column => last.end = column + 1,
                        _ => spans.push(Span { start: column, end: column + 1 }),
                    }
                }
                spans
            }),
        )
    }

    /// Returns the fallback without a recognised image: the frame, less the sides where the
    /// live pixels end in a plain edge.
    fn sides(&self, live: &[bool], all: &[Run]) -> (Mask, Vec<UnsureReason>) {
        let (width, height) = (self.width as usize, self.height as usize);
        let (Some(first), Some(last)) = (all.first(), all.last()) else {
            return (Mask::full(self.width, self.height), vec![UnsureReason::Black]);
        };
        let (top, bottom) = (first.row, last.row + 1);
        let left = all.iter().map(|run| run.start).min().unwrap_or(0);
        let right = all.iter().map(|run| run.end).max().unwrap_or(width);

        let row_live =
            |row: usize| fraction(live[row * width..][left..right].iter().filter(|p| **p).count(), right - left);
        let column_live =
            |column: usize| fraction((top..bottom).filter(|row| live[row * width + column]).count(), bottom - top);
        let plain =
            |mut lines: std::ops::Range<usize>, part: &dyn Fn(usize) -> f64| lines.all(|line| part(line) >= MIN_EDGE);
        // A smaller region is an object in the image, however straight its edges.
        let large = fraction((bottom - top) * (right - left), live.len()) >= MIN_AREA;
        let tall = large && bottom - top >= EDGE_LINES;
        let broad = large && right - left >= EDGE_LINES;
        let sides = [
            ("left", left == 0, broad && plain(left..left + EDGE_LINES, &column_live)),
            ("right", right == width, broad && plain(right - EDGE_LINES.min(right)..right, &column_live)),
            ("top", top == 0, tall && plain(top..top + EDGE_LINES, &row_live)),
            ("bottom", bottom == height, tall && plain(bottom - EDGE_LINES.min(bottom)..bottom, &row_live)),
        ];
        let open: Vec<&'static str> =
            sides.iter().filter(|(_, at_frame, edge)| !at_frame && !edge).map(|side| side.0).collect();
        let reasons = if open.is_empty() { Vec::new() } else { vec![UnsureReason::OpenSides(open)] };
        let cut = |side: usize, edge: usize, frame: usize| if sides[side].2 { edge } else { frame };
        let columns = Span {
            start: u32::try_from(cut(0, left, 0)).unwrap_or(0),
            end: u32::try_from(cut(1, right, width)).unwrap_or(self.width),
        };
        let rows = cut(2, top, 0)..cut(3, bottom, height);
        let mask = Mask::from_rows(self.width, (0..height).map(|row| rows.contains(&row).then_some(columns)));
        (mask, reasons)
    }
}

fn mark<T: Copy + PartialEq>(first_live: &mut [u8], pixels: &[T], dead: T, frame: u8) {
    for (first, &pixel) in first_live.iter_mut().zip(pixels) {
        // No branch, so that the loop vectorises.
        let now = if pixel == dead { 0 } else { frame };
        *first = if *first == 0 { now } else { *first };
    }
}

/// Live pixels inside the mask.
fn inside(mask: &Mask, all: &[Run]) -> usize {
    let overlap =
        |run: &Run, span: &Span| (span.end as usize).min(run.end).saturating_sub((span.start as usize).max(run.start));
    all.iter()
        .map(|run| {
            let row = u32::try_from(run.row).unwrap_or(u32::MAX);
            mask.row(row).iter().map(|span| overlap(run, span)).sum::<usize>()
        })
        .sum()
}

fn fraction(part: usize, whole: usize) -> f64 {
    if whole == 0 { 0.0 } else { part as f64 / whole as f64 }
}
