//! A grey image in memory.

use sonoweave_core::region::ClipRect;

use crate::error::CalibrationError;

/// A grey image in 8 bits, row by row; u is the column, v the row, and pixel centres are at
/// whole numbers ([`Image`](sonoweave_core::frames::Image)).
#[derive(Debug, Clone, Copy)]
pub struct GreyView<'a> {
    width: usize,
    height: usize,
    stride: usize,
    pixels: &'a [u8],
}

impl<'a> GreyView<'a> {
    /// Views pixels with `stride` bytes from a row's first pixel to the next row's.
    ///
    /// # Errors
    /// [`CalibrationError::Picture`] unless there is a pixel, rows do not overlap, and `pixels`
    /// holds all of the last row.
    pub fn new(width: usize, height: usize, stride: usize, pixels: &'a [u8]) -> Result<Self, CalibrationError> {
        let needed = stride.checked_mul(height.saturating_sub(1)).and_then(|bytes| bytes.checked_add(width));
        if width == 0 || height == 0 || stride < width || needed.is_none_or(|needed| pixels.len() < needed) {
            return Err(CalibrationError::Picture { width, height, stride, bytes: pixels.len() });
        }
        Ok(Self { width, height, stride, pixels })
    }

    /// Views pixels without gaps between rows.
    ///
    /// # Errors
    /// [`CalibrationError::Picture`] unless there is a pixel, and the number of bytes matches the
    /// size.
    pub fn packed([width, height]: [usize; 2], pixels: &'a [u8]) -> Result<Self, CalibrationError> {
        match width.checked_mul(height) {
            Some(count) if count == pixels.len() => Self::new(width, height, width, pixels),
            _ => Err(CalibrationError::Picture { width, height, stride: width, bytes: pixels.len() }),
        }
    }

    /// Returns its part within a rectangle; `None` if they do not overlap.
    pub fn part(&self, clip: ClipRect) -> Option<Self> {
        let [x, y] = [clip.x, clip.y].map(|n| n as usize);
        let width = (clip.width as usize).min(self.width.checked_sub(x)?);
        let height = (clip.height as usize).min(self.height.checked_sub(y)?);
        let from = y.checked_mul(self.stride)?.checked_add(x)?;
        Self::new(width, height, self.stride, self.pixels.get(from..)?).ok()
    }

    /// Returns the number of pixels along u.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the number of pixels along v.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Returns the number of pixels along u and v.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// Returns all rows, from the top.
    pub fn rows(&self) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        self.pixels.chunks(self.stride).take(self.height).map({
            let width = self.width;
            move |row| &row[..width]
        })
    }

    /// Returns the pixels of a row.
    ///
    /// # Panics
    /// Panics below the last row.
    pub fn row(&self, v: usize) -> &'a [u8] {
        assert!(v < self.height, "row {v} of {}", self.height);
        &self.pixels[v * self.stride..][..self.width]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn part_is_clipped_to_whole() {
        let bytes: Vec<u8> = (0..12).collect();
        let view = GreyView::packed([4, 3], &bytes).unwrap();
        let part = |x, y, width, height| view.part(ClipRect { x, y, width, height });
        let rows = |part: Option<GreyView<'_>>| part.unwrap().rows().map(<[u8]>::to_vec).collect::<Vec<_>>();
        assert_eq!(rows(part(1, 1, 2, 2)), [[5, 6], [9, 10]]);
        assert_eq!(rows(part(2, 2, 100, 100)), [[10, 11]]);
        assert!(part(4, 0, 2, 2).is_none() && part(0, 3, 1, 1).is_none() && part(9, 9, 1, 1).is_none());
    }

    #[test]
    fn rows_are_stride_apart_and_last_may_be_short() {
        let bytes: Vec<u8> = (0..11).collect();
        let view = GreyView::new(3, 3, 4, &bytes).unwrap();
        assert_eq!((view.row(0), view.row(2)), (&[0, 1, 2][..], &[8, 9, 10][..]));
        assert_eq!(view.rows().collect::<Vec<_>>(), (0..3).map(|v| view.row(v)).collect::<Vec<_>>());
        assert!(GreyView::new(3, 3, 4, &bytes[..10]).is_err());
        assert!(GreyView::new(5, 2, 4, &bytes).is_err() && GreyView::new(0, 2, 4, &bytes).is_err());
        assert!(GreyView::packed([3, 3], &bytes[..9]).is_ok() && GreyView::packed([3, 3], &bytes).is_err());
        let error = GreyView::new(3, usize::MAX, 4, &bytes).unwrap_err();
        assert_eq!(error, CalibrationError::Picture { width: 3, height: usize::MAX, stride: 4, bytes: 11 });
    }
}
