//! The automatic mask: separates the scanner's image from the dead border around it.
//!
//! A frame grabber delivers the scanner's whole screen or a black canvas around the image.
//! Pixels that are zero in all of the first frames are either that border or dark tissue. Shape
//! distinguishes the two. An image is one connected region, filled nearly everywhere, with a
//! convex outline except for its top, which a curved transducer makes concave. In MF
//! orientation the transducer is at the top. If no such region is found, a side of the frame is
//! cut only where the image's edge on that side is plain. Data lost to a wrong mask is worse
//! than a black margin kept.

use sonoweave_core::slice::{Image, Pixels};

use super::shape::{Run, hull_rows, largest_component, opened, runs};
use super::{Mask, Span};

/// Frames that are examined.
pub const FRAMES: u8 = 8;

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

/// Examines the first frames and then reports which part of them is image.
#[derive(Debug)]
pub struct AutoMask {
    width: u32,
    height: u32,
    /// Number, from 1, of the frame in which a pixel first differed from zero; 0 for never.
    first_live: Vec<u8>,
    frames: u8,
}

/// The automatic mask and its origin.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Found {
    /// The pixels that are data.
    pub mask: Mask,
    /// Whether a whole image was recognised; otherwise the sides were judged one by one.
    pub recognised: bool,
    /// Notes for the user: sentences.
    pub notes: Vec<String>,
}

impl AutoMask {
    /// Returns a detector for frames of `width`×`height` pixels.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, first_live: vec![0; width as usize * height as usize], frames: 0 }
    }

    /// Examines one more frame. After [`FRAMES`] of them it returns the mask and restarts.
    /// Frames of another size are ignored: the pairing stage refuses them.
    pub fn push(&mut self, image: &Image) -> Option<Found> {
        if (image.width(), image.height()) != (self.width, self.height) {
            return None;
        }
        self.frames += 1;
        match image.pixels() {
            Pixels::U8(p) => mark(&mut self.first_live, p, 0, self.frames),
            Pixels::U16(p) => mark(&mut self.first_live, p, 0, self.frames),
            Pixels::F32(p) => mark(&mut self.first_live, p, 0.0, self.frames),
        }
        (self.frames == FRAMES).then(|| self.finish())
    }

    /// Returns the mask after fewer frames, when the stream ends early, and restarts. Without
    /// any frame, everything is data.
    pub fn finish(&mut self) -> Found {
        let found = self.find();
        self.first_live.fill(0);
        self.frames = 0;
        found
    }

    fn find(&self) -> Found {
        let width = self.width as usize;
        let live: Vec<bool> = self.first_live.iter().map(|&first| first != 0).collect();
        let all = runs(&live, width);
        if let Some(mask) = self.picture(&all) {
            return Found { mask, recognised: true, notes: Vec::new() };
        }
        self.sides(&live, &all)
    }

    /// Returns the region of a recognised image.
    fn picture(&self, all: &[Run]) -> Option<Mask> {
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
        Some(mask)
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
    fn sides(&self, live: &[bool], all: &[Run]) -> Found {
        let (width, height) = (self.width as usize, self.height as usize);
        let (Some(first), Some(last)) = (all.first(), all.last()) else {
            let note = "the first frames are all black: the whole frame counts as data; set a clip otherwise".into();
            return Found { mask: Mask::full(self.width, self.height), recognised: false, notes: vec![note] };
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
        let open: Vec<&str> =
            sides.iter().filter(|(_, at_frame, edge)| !at_frame && !edge).map(|side| side.0).collect();
        let notes = if open.is_empty() {
            Vec::new()
        } else {
            vec![format!(
                "no picture edge found on the {}: the frame's edge counts; set a clip, or none, otherwise",
                open.join(", ")
            )]
        };
        let cut = |side: usize, edge: usize, frame: usize| if sides[side].2 { edge } else { frame };
        let columns = Span {
            start: u32::try_from(cut(0, left, 0)).unwrap_or(0),
            end: u32::try_from(cut(1, right, width)).unwrap_or(self.width),
        };
        let rows = cut(2, top, 0)..cut(3, bottom, height);
        let mask = Mask::from_rows(self.width, (0..height).map(|row| rows.contains(&row).then_some(columns)));
        Found { mask, recognised: false, notes }
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

#[cfg(test)]
mod tests;
