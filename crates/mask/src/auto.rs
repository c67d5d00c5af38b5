//! The automatic mask: separates the scanner's picture from the border around it.
//!
//! A frame grabber delivers the scanner's whole screen or a canvas around the picture. Where the
//! border is exactly zero, the pixels that are not zero give the mask (`exact`). A border of an
//! analogue grabber has noise and a level: then a rectangle or a fan is searched for whose edges
//! stand out from it (`border`). Data lost to a wrong mask is worse than a border kept, so the
//! whole frame counts when nothing is recognised. Only zeros are cut even then, at sides where a
//! plain edge ends everything that is not zero: no data were there in any of the frames.

use std::sync::Arc;

use sonoweave_core::region::ClipRect;
use sonoweave_core::slice::Image;

use super::Mask;
use super::border::{self, FrameSums};
use super::exact::ExactSearch;
use super::found::{MaskFound, MaskShape};

/// Frames that are examined.
pub const FRAMES: u8 = 8;

/// Share of the frame that is a border of exact zeros, if there is one. Less is the blanking of
/// a grabber, around a border with noise.
const ZERO_BORDER: f64 = 1.0 / 16.0;
/// Share of a rectangle's pixels that differ from zero, if it has a border with noise inside.
const FULL: f64 = 0.999;
/// Least overlap of a fan or rectangle with the outline that it describes.
const SAME: f64 = 0.98;

/// Examines the first frames and then reports which part of them is picture.
#[derive(Debug)]
pub struct AutoMask {
    size: [u32; 2],
    exact: ExactSearch,
    /// Sums for borders with noise; `None` if those are not searched for.
    sums: Option<FrameSums>,
}

impl AutoMask {
    /// Returns a detector for frames of `width`×`height` pixels.
    pub fn new(width: u32, height: u32) -> Self {
        let sums = Some(FrameSums::new(width as usize * height as usize));
        Self { size: [width, height], exact: ExactSearch::new(width, height), sums }
    }

    /// Returns the detector that knows exactly zero borders only, as that of earlier versions.
    pub fn of_zero_borders(width: u32, height: u32) -> Self {
        Self { sums: None, ..Self::new(width, height) }
    }

    /// Examines one more frame. After [`FRAMES`] of them it returns the mask and restarts.
    /// Frames of another size are ignored: the pairing stage refuses them.
    pub fn push(&mut self, image: &Image) -> Option<MaskFound> {
        if [image.width(), image.height()] != self.size {
            return None;
        }
        if let Some(sums) = &mut self.sums {
            sums.push(image);
        }
        (self.exact.push(image) == FRAMES).then(|| self.finish())
    }

    /// Returns the mask after fewer frames, when the stream ends early, and restarts. Without
    /// any frame, everything is data.
    pub fn finish(&mut self) -> MaskFound {
        let found = self.find();
        self.exact.clear();
        self.sums.iter_mut().for_each(FrameSums::clear);
        found
    }

    fn find(&self) -> MaskFound {
        let exact = self.exact.find();
        let (Some(sums), Some(part)) = (&self.sums, self.exact.live_bounds()) else { return exact };
        let [width, height] = self.size;
        let in_part = self.exact.live_pixels() as f64 / (f64::from(part.width) * f64::from(part.height));
        let has_zero_border = self.exact.dead_share() >= ZERO_BORDER;
        let has_inner_border = exact.recognised && exact.shape == MaskShape::Rectangle(part) && in_part >= FULL;
        let search = border::search(sums, self.size, part);
        match (search.picture, search.border) {
            (Ok((shape, confidence)), Some(border)) => {
                let found = border::found(self.size, part, shape, confidence, border);
                if !has_zero_border || has_inner_border {
                    return found;
                }
                // The outline's pixels stay; the shape only describes them.
                let common = found.mask.intersect(&exact.mask).area() as f64;
                let is_same = exact.recognised
                    && exact.shape == MaskShape::Outline
                    && common >= SAME * found.mask.area().max(exact.mask.area()) as f64;
                match shape {
                    MaskShape::Fan(fan) if is_same => {
                        let mask = Arc::new((*exact.mask).clone().with_beams_of(&fan));
                        MaskFound { shape, mask, ..exact }
                    }
                    _ if is_same => MaskFound { shape, ..exact },
                    _ => exact,
                }
            }
            (Err(_), _) if has_zero_border || search.border.is_none() => exact,
            // Zeros around an even border are the blanking of video. They do not make a picture of
            // the rest, if none was recognised in it.
            (Err(reason), border) if part != whole(self.size) => {
                MaskFound { recognised: false, confidence: 0.0, border, reasons: vec![reason], ..exact }
            }
            (Err(reason), border) => MaskFound {
                mask: Arc::new(Mask::full(width, height)),
                shape: MaskShape::Whole,
                recognised: false,
                confidence: 0.0,
                border,
                reasons: vec![reason],
            },
            (Ok(_), None) => exact,
        }
    }
}

fn whole([width, height]: [u32; 2]) -> ClipRect {
    ClipRect { x: 0, y: 0, width, height }
}

#[cfg(test)]
mod tests;
