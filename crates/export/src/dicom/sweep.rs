//! A sweep as Ultrasound Multi-frame Image Storage (DICOM PS3.3 A.7).
//!
//! Such images have no position in space. The frames' poses, their status, times and numbers are
//! in private elements ([`formats::image::dicom::private`]), from which the sequence is read back
//! to the bit.

use std::path::Path;

use dicom_core::{PrimitiveValue, VR};
use dicom_dictionary_std::{tags, uids};

use formats::image::dicom::private;
use sonoweave_core::NOTICE;
use sonoweave_core::reading::Stamp;

use super::block::PrivateBlock;
use super::dataset::{Dataset, Image, Pixels, decimals, write};
use super::{ExportError, Identifiers, bytes, edges};

/// Advice for a sweep that is too long.
const FEWER: &str = "write fewer frames";
/// Advice for frames that are too large.
const CROPPED: &str = "crop the frames";
/// Physical units of a region: cm.
const CENTIMETRES: u16 = 3;

/// Largest length of an attribute of decimal strings, bytes: it is stored in 16 bits, and even.
const LONGEST: usize = 0xfffe;

/// A frame's data beside its pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepFrame {
    /// Acquisition time, ns.
    pub time_ns: i64,
    /// The source's times.
    pub stamp: Stamp,
    /// The source's number of the frame.
    pub number: Option<u64>,
    /// Matrix from pixels to mm of the world, row by row; the source's word if it has no pose.
    pub pose: Result<[f64; 16], String>,
}

/// A sweep to be written.
#[derive(Debug, Clone, Copy)]
pub struct Sweep<'a> {
    /// Columns and rows.
    pub size: [u32; 2],
    /// Grey levels of all frames, frame after frame, in MF orientation: u (to the right)
    /// fastest.
    pub pixels: &'a [u8],
    /// Times and poses of the frames.
    pub frames: &'a [SweepFrame],
    /// Pixel size along the directions of columns and rows, mm, if known.
    pub pixel_mm: Option<[f64; 2]>,
    /// Hash of the recording, known only to those who have it.
    pub recording: &'a str,
    /// Name of the world frame; empty if no pose is known.
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
    /// When there are other pixels than the frames': this is an error of the caller.
    pub fn write(&self, path: &Path) -> Result<(), ExportError> {
        self.identifiers.check()?;
        let frames = self.frames.len();
        let plane = edges(self.size.map(u64::from), CROPPED)?;
        let bytes = Self::bytes(frames as u64, self.size)?;
        if bytes == 0 {
            return Err(ExportError::NoFrame);
        }
        assert_eq!(self.pixels.len(), bytes, "pixels fill the frames");
        let dataset = self.dataset(plane);
        write(Pixels::U8(self.pixels.to_vec()).put(dataset, frames as u64, plane), path)
    }

    fn dataset(&self, [columns, rows]: [u16; 2]) -> Dataset {
        let own = self.private();
        let own_bytes = own.bytes();
        let times: Vec<u8> = self.frames.iter().flat_map(|frame| frame.time_ns.to_le_bytes()).collect();
        let size: Vec<u8> = self.size.iter().flat_map(|n| n.to_le_bytes()).collect();
        let image = Image {
            class: uids::ULTRASOUND_MULTI_FRAME_IMAGE_STORAGE,
            series_number: "1",
            identifiers: self.identifiers,
            recording: self.recording,
            world: self.world,
            content: vec![&size, &times, &own_bytes, self.pixels],
        };
        let date_time = self.identifiers.acquired.as_ref().map(|_| self.identifiers.acquired());
        let (date, time) = date_time.unwrap_or(("", ""));
        // From the previous frame; 0 for the first, and for times that go back.
        let step = |pair: &[SweepFrame]| (pair[1].time_ns.saturating_sub(pair[0].time_ns) as f64 * 1e-6).max(0.0);
        let steps: Vec<f64> = std::iter::once(0.0).chain(self.frames.windows(2).map(step)).collect();
        let mut dataset = image
            .dataset()
            .texts(tags::IMAGE_TYPE, VR::CS, &["ORIGINAL", "PRIMARY"])
            .put(tags::IMAGE_COMMENTS, VR::LT, NOTICE)
            .put(tags::CONTENT_DATE, VR::DA, date)
            .put(tags::CONTENT_TIME, VR::TM, time);
        let vector = decimals(&steps);
        // A long sweep states the mean step; our own element has all times.
        dataset = if vector.len() <= LONGEST {
            dataset.put(tags::FRAME_INCREMENT_POINTER, VR::AT, PrimitiveValue::from(tags::FRAME_TIME_VECTOR)).put(
                tags::FRAME_TIME_VECTOR,
                VR::DS,
                vector,
            )
        } else {
            let mean = steps.iter().sum::<f64>() / (steps.len() - 1).max(1) as f64;
            dataset.put(tags::FRAME_INCREMENT_POINTER, VR::AT, PrimitiveValue::from(tags::FRAME_TIME)).put(
                tags::FRAME_TIME,
                VR::DS,
                decimals(&[mean]),
            )
        };
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
        own.put(dataset)
    }

    /// Returns our private elements.
    fn private(&self) -> PrivateBlock {
        let frames = self.frames;
        let times = |time: fn(&Stamp) -> Option<f64>| -> Vec<f64> {
            frames.iter().map(|frame| time(&frame.stamp).unwrap_or(f64::NAN)).collect()
        };
        let lines = |line: fn(&SweepFrame) -> String| frames.iter().map(line).collect::<Vec<_>>().join("\n");
        let mut own = PrivateBlock::default();
        if !self.world.is_empty() {
            let poses = frames.iter().flat_map(|frame| frame.pose.as_ref().map_or([f64::NAN; 16], |pose| *pose));
            own.doubles(private::POSES, poses.collect());
            own.text(private::WORLD, VR::LO, self.world);
            own.text(
                private::STATUSES,
                VR::UT,
                &lines(|frame| frame.pose.clone().map_or_else(|word| word, |_| "OK".into())),
            );
        }
        own.doubles(private::TIMES, times(|stamp| stamp.source_s));
        if frames.iter().any(|frame| frame.stamp.unfiltered_s.is_some()) {
            own.doubles(private::UNFILTERED_TIMES, times(|stamp| stamp.unfiltered_s));
        }
        if frames.iter().any(|frame| frame.number.is_some()) {
            let number = |frame: &SweepFrame| frame.number.map_or_else(String::new, |number| number.to_string());
            own.text(private::NUMBERS, VR::UT, &lines(number));
        }
        own
    }
}
