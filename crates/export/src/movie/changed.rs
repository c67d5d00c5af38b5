//! The part of a picture that differs from the one before it.

use image::RgbImage;

/// A rectangle of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Area {
    /// Its first pixel: column, row.
    pub(super) at: [u32; 2],
    /// Columns and rows; at least one each.
    pub(super) size: [u32; 2],
}

impl Area {
    /// Returns the smallest area with all pixels that differ from `before`; a single pixel if none
    /// does, the whole picture if there is none before it.
    pub(super) fn changed(before: Option<&RgbImage>, picture: &RgbImage) -> Self {
        let Some(before) = before else {
            return Self { at: [0, 0], size: [picture.width(), picture.height()] };
        };
        let rows = before.rows().zip(picture.rows()).zip(0..);
        let mut area: Option<[[u32; 2]; 2]> = None;
        for ((old, new), y) in rows {
            let mut differing = old.zip(new).zip(0..).filter(|((old, new), _)| old != new).map(|(_, x)| x);
            let Some(first) = differing.next() else { continue };
            let last = differing.last().unwrap_or(first);
            let [low, high] = area.get_or_insert([[first, y], [last, y]]);
            *low = [low[0].min(first), low[1]];
            *high = [high[0].max(last), y];
        }
        let [low, high] = area.unwrap_or_default();
        Self { at: low, size: [high[0] - low[0] + 1, high[1] - low[1] + 1] }
    }

    /// Returns its pixels, row by row: red, green, blue.
    pub(super) fn pixels(&self, picture: &RgbImage) -> Vec<u8> {
        let ([x, y], [width, height]) = (self.at.map(|n| n as usize), self.size.map(|n| n as usize));
        let row = 3 * picture.width() as usize;
        let rows = picture.as_raw().chunks_exact(row).skip(y).take(height);
        rows.flat_map(|pixels| &pixels[3 * x..3 * (x + width)]).copied().collect()
    }
}
