//! Positions of beams, ranges and pixels: the transducer's geometry, in f64.
//!
//! Face coordinates: mm, the origin at the face's middle, x to the right in the image, y down,
//! away from the transducer; z out of the slice. Lateral coordinate: the beam's angle from the
//! middle (rad) for a curvilinear transducer, x (mm) for a linear one. Range: mm from the face.

use glam::DVec2;

use mask::Mask;
use sonoweave_core::region::{ClipRect, Fan};

use super::Scanner;
use super::transducer::MARGIN;
pub use super::transducer::Transducer;
use crate::PhantomError;

/// Largest number of beams beside the outermost, to cover a beam's width.
pub(super) const MOST_SIDE_BEAMS: usize = 24;
/// Radius of the kernels, in σ.
pub(super) const REACH: f64 = 2.8;

/// Raster and image of a scanner. A raster has a row for each range and a column for each beam.
/// Extra rows and columns around the displayed ones supply the blur at their borders.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    pub(super) transducer: Transducer,
    pub(super) image_size: [u32; 2],
    pub(super) pixel_mm: [f64; 2],
    /// The face's middle, pixels.
    face_px: DVec2,
    /// Columns and rows of the raster.
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// Columns beside the outermost beams, rows above the face and below the depth.
    pub(super) side: usize,
    pub(super) above: usize,
    /// Lateral coordinate between beams, range between rows.
    pub(super) lateral_step: f64,
    pub(super) range_step: f64,
    depth_mm: f64,
}

impl Layout {
    /// Creates the layout of a scanner's images.
    ///
    /// # Errors
    /// [`PhantomError`] for invalid scanners or pixels, and for non-square pixels of a
    /// curvilinear transducer, whose field would not be a fan.
    pub fn new(scanner: &Scanner, image_size: [u32; 2], pixel_mm: [f64; 2]) -> Result<Self, PhantomError> {
        scanner.check()?;
        for mm in pixel_mm {
            PhantomError::check_length("the distance of pixels", mm)?;
        }
        let transducer = scanner.transducer;
        if matches!(transducer, Transducer::Curvilinear { .. }) && pixel_mm[0] != pixel_mm[1] {
            return Err(PhantomError::OblongPixels { pixel_mm });
        }
        let [width, height] = image_size.map(f64::from);
        let [_, high] = transducer.extent_mm(scanner.depth_mm);
        // The arc's rise separates the field's top edge from the face's middle.
        let rise = high - scanner.depth_mm;
        let face_v = MARGIN * height + rise / pixel_mm[1];
        let lateral_step = 2.0 * transducer.half_opening() / f64::from(scanner.beams - 1);
        // 3.5 rows to the echo's full width: finer rows show nothing more.
        let range_step = (scanner.axial_sigma_mm() * super::FWHM_PER_SIGMA / 3.5).min(scanner.depth_mm / 64.0);
        let shown = (scanner.depth_mm / range_step).floor() as usize + 1;
        let above = (REACH * scanner.axial_sigma_mm() / range_step).ceil() as usize + 2;
        let side = (0..shown)
            .step_by(8)
            .map(|row| {
                let range = row as f64 * range_step;
                REACH * scanner.lateral_sigma_mm(range) / (lateral_step * transducer.mm_per_lateral(range))
            })
            .fold(1.0, f64::max);
        let side = (side.ceil() as usize + 1).min(MOST_SIDE_BEAMS);
        Ok(Self {
            transducer,
            image_size,
            pixel_mm,
            face_px: DVec2::new(0.5 * (width - 1.0), face_v),
            columns: scanner.beams as usize + 2 * side,
            rows: shown + 2 * above,
            side,
            above,
            lateral_step,
            range_step,
            depth_mm: scanner.depth_mm,
        })
    }

    /// Returns the position of the face's middle, pixels.
    pub fn face_px(&self) -> [f64; 2] {
        self.face_px.to_array()
    }

    /// Returns the position of the face's middle below the image's middle, mm; negative, as it
    /// lies above.
    pub fn face_below_middle_mm(&self) -> f64 {
        (self.face_px.y - 0.5 * (f64::from(self.image_size[1]) - 1.0)) * self.pixel_mm[1]
    }

    /// Returns a pixel's position in face coordinates, mm.
    pub fn face_from_pixel(&self, pixel: DVec2) -> DVec2 {
        (pixel - self.face_px) * DVec2::from_array(self.pixel_mm)
    }

    /// Returns the pixel of a beam at a range.
    pub fn pixel(&self, lateral: f64, range: f64) -> DVec2 {
        self.transducer.place(lateral, range) / DVec2::from_array(self.pixel_mm) + self.face_px
    }

    /// Returns column and row of the raster at a pixel.
    pub fn raster(&self, pixel: DVec2) -> [f64; 2] {
        let [lateral, range] = self.transducer.locate(self.face_from_pixel(pixel));
        [self.column(lateral), range / self.range_step + self.above as f64]
    }

    /// Returns the column of a lateral coordinate.
    pub(super) fn column(&self, lateral: f64) -> f64 {
        (lateral + self.transducer.half_opening()) / self.lateral_step + self.side as f64
    }

    /// Returns the lateral coordinate of a column.
    pub(super) fn lateral(&self, column: usize) -> f64 {
        (column as f64 - self.side as f64) * self.lateral_step - self.transducer.half_opening()
    }

    /// Returns the range of a row, mm.
    pub(super) fn range(&self, row: usize) -> f64 {
        (row as f64 - self.above as f64) * self.range_step
    }

    /// Returns the rows that pixels need: from the face to one row beyond the depth, as pixels
    /// lie between rows.
    pub(super) fn detected(&self) -> std::ops::Range<usize> {
        self.above..self.rows - self.above + 1
    }

    /// Returns the distance between beams at a range, mm.
    pub(super) fn beam_distance(&self, range: f64) -> f64 {
        // Above the face of a small arc this distance would vanish.
        self.lateral_step * self.transducer.mm_per_lateral(range).max(1.0)
    }

    /// Returns the sector of data of a curvilinear transducer.
    pub fn fan(&self) -> Option<Fan> {
        let Transducer::Curvilinear { radius_mm, opening_deg } = self.transducer else { return None };
        let pixel = self.pixel_mm[0];
        let apex = self.face_px - DVec2::new(0.0, radius_mm / pixel);
        let radii = [radius_mm / pixel, (radius_mm + self.depth_mm) / pixel];
        Fan::new(apex.to_array(), radii, [-0.5 * opening_deg, 0.5 * opening_deg]).ok()
    }

    /// Returns the rectangle of data of a linear transducer: the pixels whose centres lie in
    /// the field.
    pub fn clip(&self) -> Option<ClipRect> {
        let Transducer::Linear { width_mm } = self.transducer else { return None };
        let half = 0.5 * width_mm / self.pixel_mm[0];
        let [width, height] = self.image_size.map(f64::from);
        let first = [(self.face_px.x - half).max(0.0), self.face_px.y.max(0.0)].map(f64::ceil);
        let deepest = self.face_px.y + self.depth_mm / self.pixel_mm[1];
        let last = [(self.face_px.x + half).min(width - 1.0), deepest.min(height - 1.0)].map(f64::floor);
        let size = [0, 1].map(|i| (last[i] - first[i] + 1.0).max(0.0) as u32);
        ClipRect::new(first[0] as u32, first[1] as u32, size[0], size[1]).ok()
    }

    /// Returns the mask of data pixels; it is empty if the field lies beside the image.
    pub fn mask(&self) -> Mask {
        let [width, height] = self.image_size;
        match (self.fan(), self.clip()) {
            (Some(fan), _) => Mask::fan(width, height, &fan),
            (None, Some(clip)) => Mask::rect(width, height, clip),
            (None, None) => Mask::from_fn(width, height, |_, _| false),
        }
    }
}
