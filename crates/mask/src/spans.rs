//! A set of pixels as spans of each row: cheap to walk, cheap to test, a few kilobytes for a
//! fan.

use serde::{Deserialize, Serialize};

use sonoweave_core::region::{ClipRect, Fan};

/// Columns `start..end` of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Span {
    /// First column inside.
    pub start: u32,
    /// First column after it.
    pub end: u32,
}

/// The pixels of a `width`×`height` frame (MF orientation) that are data.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(into = "Rows", try_from = "Rows")]
pub struct Mask {
    width: u32,
    height: u32,
    /// The point that the scanner's beams come from, u and v in pixels; `None` if they run down
    /// the columns, as far as is known.
    apex_px: Option<[f64; 2]>,
    /// Spans of all rows, top to bottom, left to right; never empty, never touching.
    spans: Vec<Span>,
    /// Row v's spans are `spans[first[v]..first[v + 1]]`.
    first: Vec<usize>,
}

/// A mask in a file: the width, the spans of each row, and the apex of the beams, if any.
#[derive(Serialize, Deserialize)]
struct Rows {
    width: u32,
    rows: Vec<Vec<Span>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    apex_px: Option<[f64; 2]>,
}

impl From<Mask> for Rows {
    fn from(mask: Mask) -> Self {
        let rows = (0..mask.height).map(|v| mask.row(v).to_vec()).collect();
        Self { width: mask.width, rows, apex_px: mask.apex_px }
    }
}

impl TryFrom<Rows> for Mask {
    type Error = &'static str;

    fn try_from(Rows { width, rows, apex_px }: Rows) -> Result<Self, Self::Error> {
        let is_ordered = |row: &Vec<Span>| {
            row.iter().all(|span| span.start < span.end && span.end <= width)
                && row.windows(2).all(|pair| pair[0].end < pair[1].start)
        };
        if !rows.iter().all(is_ordered) || u32::try_from(rows.len()).is_err() {
            return Err("a mask's spans must ascend within the width");
        }
        if apex_px.is_some_and(|apex| !apex.iter().all(|x| x.is_finite())) {
            return Err("a mask's apex must be finite");
        }
        Ok(Self { apex_px, ..Self::from_rows(width, rows) })
    }
}

impl Mask {
    /// Builds a mask from each row's spans: ascending, not overlapping, within the width. Empty
    /// ones are dropped and touching ones joined.
    ///
    /// # Panics
    /// When a row breaks these rules: the caller has just made it.
    pub fn from_rows<R: IntoIterator<Item = Span>>(width: u32, rows: impl IntoIterator<Item = R>) -> Self {
        let mut mask = Self { width, height: 0, apex_px: None, spans: Vec::new(), first: vec![0] };
        for row in rows {
            let begin = mask.spans.len();
            for span in row {
                assert!(span.end <= width, "a span leaves the picture");
                if span.start >= span.end {
                    continue;
                }
                match mask.spans[begin..].last_mut() {
                    Some(last) if span.start <= last.end => {
                        assert!(span.start == last.end, "spans overlap or descend");
                        last.end = span.end;
                    }
                    _ => mask.spans.push(span),
                }
            }
            mask.first.push(mask.spans.len());
            mask.height += 1;
        }
        mask
    }

    /// Builds a mask from a test of pixels (u, v).
    pub fn from_fn(width: u32, height: u32, mut inside: impl FnMut(u32, u32) -> bool) -> Self {
        Self::from_rows(
            width,
            (0..height).map(|v| {
                let mut row = Vec::new();
                let mut start = None;
                for u in 0..=width {
                    match (start, u < width && inside(u, v)) {
                        (None, true) => start = Some(u),
                        (Some(from), false) => {
                            row.push(Span { start: from, end: u });
                            start = None;
                        }
                        _ => {}
                    }
                }
                row
            }),
        )
    }

    /// Returns a mask of every pixel.
    pub fn full(width: u32, height: u32) -> Self {
        Self::from_rows(width, (0..height).map(|_| [Span { start: 0, end: width }]))
    }

    /// Returns the part of a rectangle that lies in the frame.
    pub fn rect(width: u32, height: u32, rect: ClipRect) -> Self {
        let columns = Span { start: rect.x.min(width), end: rect.x.saturating_add(rect.width).min(width) };
        let rows = rect.y..rect.y.saturating_add(rect.height);
        Self::from_rows(width, (0..height).map(|v| rows.contains(&v).then_some(columns)))
    }

    /// Returns the pixels whose centres lie in a fan. Its apex is that of the beams.
    pub fn fan(width: u32, height: u32, fan: &Fan) -> Self {
        let test = fan.test();
        Self::from_fn(width, height, |u, v| test.contains(f64::from(u), f64::from(v))).with_beams_of(fan)
    }

    /// Returns these pixels with the beams of a fan.
    pub fn with_beams_of(self, fan: &Fan) -> Self {
        Self { apex_px: Some(fan.origin_px()), ..self }
    }

    /// Returns the point that the scanner's beams come from, u and v in pixels; `None` if they run
    /// down the columns, as far as is known.
    pub fn apex_px(&self) -> Option<[f64; 2]> {
        self.apex_px
    }

    /// Pixels along u.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels along v.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Spans of row `v`, ascending; they neither overlap nor touch.
    ///
    /// # Panics
    /// When `v` is not below the height.
    #[inline]
    pub fn row(&self, v: u32) -> &[Span] {
        &self.spans[self.first[v as usize]..self.first[v as usize + 1]]
    }

    /// Whether pixel (u, v) is data; pixels outside the frame are not.
    #[inline]
    pub fn contains(&self, u: u32, v: u32) -> bool {
        v < self.height && self.row(v).iter().any(|span| span.start <= u && u < span.end)
    }

    /// Number of pixels that are data.
    pub fn area(&self) -> u64 {
        self.spans.iter().map(|span| u64::from(span.end - span.start)).sum()
    }

    /// Whether every pixel is data.
    pub fn is_full(&self) -> bool {
        self.area() == u64::from(self.width) * u64::from(self.height)
    }

    /// The smallest rectangle that holds all data; `None` when there is none.
    pub fn bounds(&self) -> Option<ClipRect> {
        let used = |v: &u32| !self.row(*v).is_empty();
        let top = (0..self.height).find(used)?;
        let bottom = (0..self.height).rev().find(used)?;
        let left = self.spans.iter().map(|span| span.start).min()?;
        let right = self.spans.iter().map(|span| span.end).max()?;
        ClipRect::new(left, top, right - left, bottom - top + 1).ok()
    }

    /// Returns the pixels that are data in both masks. The beams are those of a fan, if one of them
    /// is a fan's.
    ///
    /// # Panics
    /// When the masks differ in size.
    pub fn intersect(&self, other: &Self) -> Self {
        assert_eq!((self.width, self.height), (other.width, other.height), "masks of different pictures");
        let apex_px = self.apex_px.or(other.apex_px);
        let both = Self::from_rows(
            self.width,
            (0..self.height).map(|v| {
                let (mut a, mut b) = (self.row(v), other.row(v));
                let mut row = Vec::new();
                while let (Some(x), Some(y)) = (a.first(), b.first()) {
                    row.push(Span { start: x.start.max(y.start), end: x.end.min(y.end) });
                    if x.end <= y.end {
                        a = &a[1..];
                    } else {
                        b = &b[1..];
                    }
                }
                row
            }),
        );
        Self { apex_px, ..both }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn spans_match_pixel_test(
            width in 1_u32..20, height in 1_u32..8,
            a in prop::collection::vec(any::<bool>(), 160), b in prop::collection::vec(any::<bool>(), 160),
        ) {
            let at = |bits: &[bool], u: u32, v: u32| bits[(v * 20 + u) as usize];
            let first = Mask::from_fn(width, height, |u, v| at(&a, u, v));
            let second = Mask::from_fn(width, height, |u, v| at(&b, u, v));
            let both = first.intersect(&second);
            let mut area = 0;
            for v in 0..height {
                for u in 0..width {
                    prop_assert_eq!(first.contains(u, v), at(&a, u, v));
                    prop_assert_eq!(both.contains(u, v), at(&a, u, v) && at(&b, u, v));
                    area += u64::from(at(&a, u, v));
                }
                prop_assert!(first.row(v).windows(2).all(|pair| pair[0].end < pair[1].start));
                prop_assert!(both.row(v).windows(2).all(|pair| pair[0].end < pair[1].start));
            }
            prop_assert_eq!(first.area(), area);
            prop_assert!(!first.contains(width, 0) && !first.contains(0, height));
        }
    }

    #[test]
    fn beams_of_a_fan_stay_in_parts_and_files() {
        let fan = Fan::new([30.0, -12.5], [20.0, 60.0], [-30.0, 30.0]).unwrap();
        let part = Mask::rect(60, 50, ClipRect::new(5, 0, 40, 30).unwrap()).intersect(&Mask::fan(60, 50, &fan));
        assert_eq!((part.apex_px(), Mask::full(60, 50).apex_px()), (Some([30.0, -12.5]), None));
        let read = Mask::try_from(Rows::from(part.clone())).unwrap();
        assert_eq!(read, part);
        let rows = Rows { apex_px: Some([f64::NAN, 0.0]), ..Rows::from(part) };
        assert!(Mask::try_from(rows).is_err());
    }

    #[test]
    fn rect_clipped_to_frame() {
        let mask = Mask::rect(10, 8, ClipRect::new(7, 5, 100, u32::MAX).unwrap());
        assert_eq!(mask.area(), 9);
        assert_eq!(mask.bounds(), Some(ClipRect::new(7, 5, 3, 3).unwrap()));
        assert_eq!(mask.row(4), []);
        assert_eq!(Mask::rect(10, 8, ClipRect::new(10, 0, 1, 1).unwrap()).bounds(), None);
        assert!(Mask::full(10, 8).is_full());
    }
}
