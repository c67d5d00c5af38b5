//! A sweep as Ultrasound Multi-frame Image Storage (DICOM PS3.3 A.7).
//!
//! Such images have no position in space. The frames' poses are in private elements of the
//! creator SONOWEAVE. Element (0009,1001) holds doubles, sixteen a frame, row by row: the matrix
//! from a pixel (column, row, 0, 1) to mm of the world, NaN if the frame has no pose. Element
//! (0009,1002) holds the world's name.

use std::path::Path;

use dicom_core::{PrimitiveValue, Tag, VR};
use dicom_dictionary_std::{tags, uids};

use sonoweave_core::NOTICE;

use super::dataset::{Dataset, Image, Pixels, write};
use super::{ExportError, Identifiers, bytes, edges};

/// Advice for a sweep that is too long.
const FEWER: &str = "write fewer frames";
/// Advice for frames that are too large.
const CROPPED: &str = "crop the frames";
/// Physical units of a region: cm.
const CENTIMETRES: u16 = 3;

/// Creator of the block of private elements from (0009,1000) on.
const CREATOR: Tag = Tag(0x0009, 0x0010);
/// The frames' poses.
const POSES: Tag = Tag(0x0009, 0x1001);
/// The name of the world.
const WORLD: Tag = Tag(0x0009, 0x1002);

/// A sweep to be written.
#[derive(Debug, Clone, Copy)]
pub struct Sweep<'a> {
    /// Columns and rows.
    pub size: [u32; 2],
    /// Grey levels of all frames, frame after frame, in MF orientation: u (to the right)
    /// fastest.
    pub pixels: &'a [u8],
    /// Acquisition time of each frame, ns.
    pub times_ns: &'a [i64],
    /// Matrices from pixels to mm of the world, row by row, one a frame; `None` if no pose is
    /// known. A frame without a pose has a matrix that is not finite.
    pub poses: Option<&'a [[f64; 16]]>,
    /// Pixel size along the directions of columns and rows, mm, if known.
    pub pixel_mm: Option<[f64; 2]>,
    /// Hash of the recording, known only to those who have it.
    pub recording: &'a str,
    /// Name of the world frame; empty if there is none.
    pub world: &'a str,
    /// Identifiers of the patient and the study.
    pub identifiers: &'a Identifiers,
}

impl Sweep<'_> {
    /// Returns the pixel bytes of `frames` frames of a size, if an image can hold them.
    ///
    /// # Errors
    /// [`ExportError::DicomTooLarge`] or [`ExportError::DicomTooLong`].
    pub fn bytes(frames: u64, size: [u32; 2]) -> Result<usize, ExportError> {
        bytes(frames, edges(size.map(u64::from), CROPPED)?, 1, FEWER)
    }

    /// Writes the sweep, whole or not at all.
    ///
    /// # Errors
    /// [`ExportError`]: it is too large, has no frames or an invalid identifier, or the file
    /// cannot be written.
    ///
    /// # Panics
    /// When pixels, times and poses differ in the number of frames: this is an error of the
    /// caller.
    pub fn write(&self, path: &Path) -> Result<(), ExportError> {
        self.identifiers.check()?;
        let frames = self.times_ns.len();
        let plane = edges(self.size.map(u64::from), CROPPED)?;
        let bytes = Self::bytes(frames as u64, self.size)?;
        if bytes == 0 {
            return Err(ExportError::NoFrame);
        }
        assert_eq!(self.pixels.len(), bytes, "pixels fill the frames");
        assert!(self.poses.is_none_or(|poses| poses.len() == frames), "a pose a frame");
        let dataset = self.dataset(plane);
        write(Pixels::U8(self.pixels.to_vec()).put(dataset, frames as u64, plane), path)
    }

    fn dataset(&self, [columns, rows]: [u16; 2]) -> Dataset {
        let poses: Vec<f64> = self.poses.unwrap_or_default().as_flattened().to_vec();
        let times: Vec<u8> = self.times_ns.iter().flat_map(|t| t.to_le_bytes()).collect();
        let places: Vec<u8> = poses.iter().flat_map(|v| v.to_le_bytes()).collect();
        let size: Vec<u8> = self.size.iter().flat_map(|n| n.to_le_bytes()).collect();
        let image = Image {
            class: uids::ULTRASOUND_MULTI_FRAME_IMAGE_STORAGE,
            series_number: "1",
            identifiers: self.identifiers,
            recording: self.recording,
            world: self.world,
            content: vec![&size, &times, &places, self.pixels],
        };
        let date_time = self.identifiers.acquired.as_ref().map(|_| self.identifiers.acquired());
        let (date, time) = date_time.unwrap_or(("", ""));
        // From the previous frame; 0 for the first, and for times that go back.
        let steps = self.times_ns.windows(2).map(|pair| (pair[1].saturating_sub(pair[0]) as f64 * 1e-6).max(0.0));
        let mut dataset = image
            .dataset()
            .texts(tags::IMAGE_TYPE, VR::CS, &["ORIGINAL", "PRIMARY"])
            .put(tags::IMAGE_COMMENTS, VR::LT, NOTICE)
            .put(tags::CONTENT_DATE, VR::DA, date)
            .put(tags::CONTENT_TIME, VR::TM, time)
            .put(tags::FRAME_INCREMENT_POINTER, VR::AT, PrimitiveValue::from(tags::FRAME_TIME_VECTOR))
            .decimals(tags::FRAME_TIME_VECTOR, std::iter::once(0.0).chain(steps));
        if let Some([x, y]) = self.pixel_mm {
            let region = Dataset::new()
                .put(tags::REGION_SPATIAL_FORMAT, VR::US, PrimitiveValue::from(1_u16))
                .put(tags::REGION_DATA_TYPE, VR::US, PrimitiveValue::from(1_u16))
                .put(tags::REGION_FLAGS, VR::UL, PrimitiveValue::from(0_u32))
                .put(tags::REGION_LOCATION_MIN_X0, VR::UL, PrimitiveValue::from(0_u32))
                .put(tags::REGION_LOCATION_MIN_Y0, VR::UL, PrimitiveValue::from(0_u32))
                .put(tags::REGION_LOCATION_MAX_X1, VR::UL, PrimitiveValue::from(u32::from(columns) - 1))
                .put(tags::REGION_LOCATION_MAX_Y1, VR::UL, PrimitiveValue::from(u32::from(rows) - 1))
                .put(tags::PHYSICAL_UNITS_X_DIRECTION, VR::US, PrimitiveValue::from(CENTIMETRES))
                .put(tags::PHYSICAL_UNITS_Y_DIRECTION, VR::US, PrimitiveValue::from(CENTIMETRES))
                .doubles(tags::PHYSICAL_DELTA_X, [0.1 * x])
                .doubles(tags::PHYSICAL_DELTA_Y, [0.1 * y]);
            dataset = dataset.sequence(tags::SEQUENCE_OF_ULTRASOUND_REGIONS, [region]);
        }
        if !poses.is_empty() {
            dataset = dataset.put(CREATOR, VR::LO, "SONOWEAVE").doubles(POSES, poses).put(WORLD, VR::LO, self.world);
        }
        dataset
    }
}
