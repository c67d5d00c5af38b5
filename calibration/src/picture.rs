//! A grey picture as it lies in memory.

use crate::region::ClipRect;

/// A grey picture in 8 bits, row by row; u is the column, v the row, and a pixel's centre is at whole numbers ([`Image`](crate::frames::Image)).
#[derive(Debug, Clone, Copy)]
pub struct GreyView<'a> {
    width: usize,
    height: usize,
    stride: usize,
    pixels: &'a [u8],
}

impl<'a> GreyView<'a> {
    /// `stride` bytes lie from a row's first pixel to the next row's.
    ///
    /// # Errors
    /// [`BadView`] unless there is a pixel, rows do not overlap, and `pixels` holds all of the last row.
    pub fn new(width: usize, height: usize, stride: usize, pixels: &'a [u8]) -> Result<Self, BadView> {
        let needed = stride.checked_mul(height.saturating_sub(1)).and_then(|bytes| bytes.checked_add(width));
        if width == 0 || height == 0 || stride < width || needed.is_none_or(|needed| pixels.len() < needed) {
            return Err(BadView { width, height, stride, bytes: pixels.len() });
        }
        Ok(Self { width, height, stride, pixels })
    }

    /// Of pixels without gaps between rows.
    ///
    /// # Errors
    /// [`BadView`] unless there is a pixel, and as many as the size says.
    pub fn packed([width, height]: [usize; 2], pixels: &'a [u8]) -> Result<Self, BadView> {
        match width.checked_mul(height) {
            Some(count) if count == pixels.len() => Self::new(width, height, width, pixels),
            _ => Err(BadView { width, height, stride: width, bytes: pixels.len() }),
        }
    }

    /// The part of it within a rectangle; `None` where there is none.
    pub fn part(&self, clip: ClipRect) -> Option<Self> {
        let [x, y] = [clip.x, clip.y].map(|n| n as usize);
        let width = (clip.width as usize).min(self.width.checked_sub(x)?);
        let height = (clip.height as usize).min(self.height.checked_sub(y)?);
        let from = y.checked_mul(self.stride)?.checked_add(x)?;
        Self::new(width, height, self.stride, self.pixels.get(from..)?).ok()
    }

    /// Pixels along u.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Pixels along v.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Pixels along u and v.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// All rows, from the top.
    pub fn rows(&self) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        self.pixels.chunks(self.stride).take(self.height).map({
            let width = self.width;
            move |row| &row[..width]
        })
    }

    /// The pixels of a row.
    ///
    /// # Panics
    /// Below the last.
    pub fn row(&self, v: usize) -> &'a [u8] {
        assert!(v < self.height, "row {v} of {}", self.height);
        &self.pixels[v * self.stride..][..self.width]
    }
}

/// Why bytes are no picture.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{bytes} bytes are no picture of {width}×{height} pixels whose rows lie {stride} bytes apart")]
pub struct BadView {
    /// Pixels along u.
    pub width: usize,
    /// Pixels along v.
    pub height: usize,
    /// Bytes from row to row.
    pub stride: usize,
    /// Bytes given.
    pub bytes: usize,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_is_of_its_own_rows_and_no_larger_than_the_whole() {
        let bytes: Vec<u8> = (0..12).collect();
        let view = GreyView::packed([4, 3], &bytes).unwrap();
        let part = |x, y, width, height| view.part(ClipRect { x, y, width, height });
        let rows = |part: Option<GreyView<'_>>| part.unwrap().rows().map(<[u8]>::to_vec).collect::<Vec<_>>();
        assert_eq!(rows(part(1, 1, 2, 2)), [[5, 6], [9, 10]]);
        assert_eq!(rows(part(2, 2, 100, 100)), [[10, 11]]);
        assert!(part(4, 0, 2, 2).is_none() && part(0, 3, 1, 1).is_none() && part(9, 9, 1, 1).is_none());
    }

    #[test]
    fn rows_are_a_stride_apart_and_the_last_may_end_early() {
        let bytes: Vec<u8> = (0..11).collect();
        let view = GreyView::new(3, 3, 4, &bytes).unwrap();
        assert_eq!((view.row(0), view.row(2)), (&[0, 1, 2][..], &[8, 9, 10][..]));
        assert_eq!(view.rows().collect::<Vec<_>>(), (0..3).map(|v| view.row(v)).collect::<Vec<_>>());
        assert!(GreyView::new(3, 3, 4, &bytes[..10]).is_err());
        assert!(GreyView::new(5, 2, 4, &bytes).is_err() && GreyView::new(0, 2, 4, &bytes).is_err());
        assert!(GreyView::packed([3, 3], &bytes[..9]).is_ok() && GreyView::packed([3, 3], &bytes).is_err());
        let error = GreyView::new(3, usize::MAX, 4, &bytes).unwrap_err().to_string();
        assert!(error.starts_with("11 bytes are no picture of 3×"), "{error}");
    }
}
