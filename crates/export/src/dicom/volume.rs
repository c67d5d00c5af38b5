//! A volume as Enhanced US Volume Storage (DICOM PS3.3 A.59).

use std::path::Path;

use dicom_core::{PrimitiveValue, VR};
use dicom_dictionary_std::{tags, uids};
use glam::DVec3;

use formats::image::dicom::private;
use sonoweave_core::NOTICE;
use volume::Grid;

use super::block::PrivateBlock;
use super::dataset::{Dataset, Image, Pixels, pixel_measures, write};
use super::{ExportError, Identifiers, bytes, edges};
use crate::volume::Scalar;

/// Advice for a volume that is too large.
const SMALLER: &str = "crop the volume, or choose a coarser spacing";
/// Code for unrecorded attributes.
const UNKNOWN: [&str; 3] = ["261665006", "SCT", "Unknown"];

/// A volume to be written.
#[derive(Debug, Clone, Copy)]
pub struct VolumeImage<'a> {
    /// Its position and size.
    pub grid: &'a Grid,
    /// Voxel type: 8 or 16 bit unsigned.
    pub scalar: Scalar,
    /// Value of unseen voxels.
    pub unseen: f32,
    /// Hash of the recording, known only to those who have it. Images of one recording share
    /// their study and frame of reference.
    pub recording: &'a str,
    /// Name of the world frame.
    pub world: &'a str,
    /// Further fields that are read back with the volume. They must not tell whose it is.
    pub fields: &'a [(String, String)],
    /// Identifiers of the patient and the study.
    pub identifiers: &'a Identifiers,
}

impl VolumeImage<'_> {
    /// Checks that the volume can be written.
    ///
    /// # Errors
    /// [`ExportError`] for an invalid type, size or identifier.
    pub fn check(&self) -> Result<(), ExportError> {
        self.identifiers.check()?;
        self.layout().map(drop)
    }

    /// Returns columns and rows of a plane, and bytes of all planes.
    fn layout(&self) -> Result<([u16; 2], usize), ExportError> {
        let each = match self.scalar {
            Scalar::U8 => 1,
            Scalar::U16 => 2,
            Scalar::F32 => return Err(ExportError::FloatingPoint),
        };
        let [nx, ny, nz] = self.grid.size;
        if nx == 0 || ny == 0 || nz == 0 {
            return Err(ExportError::NoFrame);
        }
        let plane = edges([nx, ny], SMALLER)?;
        Ok((plane, bytes(nz, plane, each, SMALLER)?))
    }

    /// Writes the volume, whole or not at all. `row(y, z, values)` gives the values of a row to
    /// be written: whole numbers in the type's range.
    ///
    /// # Errors
    /// The errors of [`Self::check`], and file system errors.
    pub fn write(&self, path: &Path, mut row: impl FnMut(u64, u64, &mut [f32])) -> Result<(), ExportError> {
        self.identifiers.check()?;
        let (plane, bytes) = self.layout()?;
        let [nx, ny, nz] = self.grid.size;
        let mut values = vec![0.0; nx as usize];
        let mut pixels = match self.scalar {
            Scalar::U16 => Pixels::U16(Vec::with_capacity(bytes / 2)),
            _ => Pixels::U8(Vec::with_capacity(bytes)),
        };
        for z in 0..nz {
            for y in 0..ny {
                row(y, z, &mut values);
                match &mut pixels {
                    Pixels::U8(to) => to.extend(values.iter().map(|v| *v as u8)),
                    Pixels::U16(to) => to.extend(values.iter().map(|v| *v as u16)),
                }
            }
        }
        let dataset = self.dataset(&pixels);
        write(pixels.put(dataset, nz, plane), path)
    }

    fn dataset(&self, pixels: &Pixels) -> Dataset {
        let grid = self.grid;
        let numbers = [grid.origin, grid.spacing, grid.direction.x_axis, grid.direction.y_axis, grid.direction.z_axis];
        let mut own = PrivateBlock::default();
        own.text(private::WORLD, VR::LO, self.world);
        own.doubles(private::PLACE, numbers.iter().flat_map(|v| v.to_array()).collect());
        let lines: Vec<String> = self.fields.iter().map(|(name, value)| format!("{name} = {value}")).collect();
        own.text(private::FIELDS, VR::UT, &lines.join("\n"));
        let own_bytes = own.bytes();
        let size: Vec<u8> = grid.size.iter().flat_map(|n| n.to_le_bytes()).collect();
        let words: Vec<u8>;
        let voxels = match pixels {
            Pixels::U8(values) => values.as_slice(),
            Pixels::U16(values) => {
                words = values.iter().flat_map(|v| v.to_le_bytes()).collect();
                &words
            }
        };
        let image = Image {
            class: uids::ENHANCED_US_VOLUME_STORAGE,
            series_number: "2",
            identifiers: self.identifiers,
            recording: self.recording,
            world: self.world,
            content: vec![&own_bytes, &size, voxels],
        };
        let (date, time) = self.identifiers.acquired();
        let comments = format!(
            "{NOTICE} Frame of reference: {} of the recording (mm, not a patient's). Voxels that no slice reached have the value {}.",
            self.world, self.unseen
        );
        let dimensions = super::uid::uid(["dimensions", &image.frame_of_reference()].map(str::as_bytes));
        let identity = (0..16).map(|i| f64::from(u8::from(i % 5 == 0)));
        let mut dataset = image
            .dataset()
            .texts(tags::IMAGE_TYPE, VR::CS, &["ORIGINAL", "PRIMARY", "VOLUME", "NONE"])
            .put(tags::CONTENT_DATE, VR::DA, date)
            .put(tags::CONTENT_TIME, VR::TM, time)
            .put(tags::ACQUISITION_DATE_TIME, VR::DT, format!("{date}{time}"))
            .doubles(tags::ACQUISITION_DURATION, [0.0])
            .put(tags::IMAGE_COMMENTS, VR::LT, comments)
            // Ultrasound frame of reference: that of the world, in which the transducer was
            // moved by hand.
            .put(tags::VOLUME_FRAME_OF_REFERENCE_UID, VR::UI, image.frame_of_reference())
            .put(tags::ULTRASOUND_ACQUISITION_GEOMETRY, VR::CS, "FREEHAND")
            .put(tags::VOLUME_TO_TRANSDUCER_RELATIONSHIP, VR::CS, "VARIABLE")
            .doubles(tags::VOLUME_TO_TRANSDUCER_MAPPING_MATRIX, identity)
            .put(
                tags::SYNCHRONIZATION_FRAME_OF_REFERENCE_UID,
                VR::UI,
                super::uid::uid(["clock", self.recording].map(str::as_bytes)),
            )
            .put(tags::SYNCHRONIZATION_TRIGGER, VR::CS, "NO TRIGGER")
            .put(tags::ACQUISITION_TIME_SYNCHRONIZED, VR::CS, "N")
            .put(tags::POSITION_MEASURING_DEVICE_USED, VR::CS, "RIGID")
            .put(tags::BURNED_IN_ANNOTATION, VR::CS, "NO")
            .put(tags::PRESENTATION_LUT_SHAPE, VR::CS, "IDENTITY")
            .decimals(tags::RESCALE_INTERCEPT, [0.0])
            .decimals(tags::RESCALE_SLOPE, [1.0])
            .code(tags::ANATOMIC_REGION_SEQUENCE, ["123037004", "SCT", "Body structure"])
            .code(tags::TRANSDUCER_SCAN_PATTERN_CODE_SEQUENCE, ["125241", "DCM", "Plane scan pattern"])
            .doubles(tags::DEPTHS_OF_FOCUS, [0.0])
            .put(tags::DEPTH_OF_SCAN_FIELD, VR::IS, "0")
            .sequence(tags::ACQUISITION_CONTEXT_SEQUENCE, []);
        for index in [
            tags::MECHANICAL_INDEX,
            tags::BONE_THERMAL_INDEX,
            tags::CRANIAL_THERMAL_INDEX,
            tags::SOFT_TISSUE_THERMAL_INDEX,
        ] {
            dataset = dataset.decimals(index, [0.0]);
        }
        for unknown in [
            tags::VIEW_CODE_SEQUENCE,
            tags::TRANSDUCER_GEOMETRY_CODE_SEQUENCE,
            tags::TRANSDUCER_BEAM_STEERING_CODE_SEQUENCE,
            tags::TRANSDUCER_APPLICATION_CODE_SEQUENCE,
        ] {
            dataset = dataset.code(unknown, UNKNOWN);
        }
        own.put(dataset)
            .put(tags::DIMENSION_ORGANIZATION_TYPE, VR::CS, "3D")
            .sequence(
                tags::DIMENSION_ORGANIZATION_SEQUENCE,
                [Dataset::new().put(tags::DIMENSION_ORGANIZATION_UID, VR::UI, dimensions.clone())],
            )
            .sequence(
                tags::DIMENSION_INDEX_SEQUENCE,
                [Dataset::new()
                    .put(tags::DIMENSION_ORGANIZATION_UID, VR::UI, dimensions)
                    .put(tags::DIMENSION_INDEX_POINTER, VR::AT, PrimitiveValue::from(tags::IMAGE_POSITION_VOLUME))
                    .put(
                        tags::FUNCTIONAL_GROUP_POINTER,
                        VR::AT,
                        PrimitiveValue::from(tags::PLANE_POSITION_VOLUME_SEQUENCE),
                    )
                    .put(tags::DIMENSION_DESCRIPTION_LABEL, VR::LO, "Image Position (Volume)")],
            )
            .sequence(tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE, [self.shared()])
            .sequence(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE, (0..self.grid.size[2]).map(|z| self.frame(z)))
    }

    /// Returns the attributes that all planes share.
    fn shared(&self) -> Dataset {
        let grid = self.grid;
        let [x, y] = [grid.direction.x_axis, grid.direction.y_axis].map(|axis| axis.to_array());
        let top = f64::from(self.scalar.top());
        Dataset::new()
            .sequence(tags::PIXEL_MEASURES_SEQUENCE, [pixel_measures(grid)])
            .sequence(
                tags::PLANE_ORIENTATION_VOLUME_SEQUENCE,
                [Dataset::new().doubles(tags::IMAGE_ORIENTATION_VOLUME, x.into_iter().chain(y))],
            )
            .sequence(
                tags::FRAME_VOILUT_SEQUENCE,
                // From 0 to the type's largest value.
                [Dataset::new()
                    .decimals(tags::WINDOW_CENTER, [0.5 * (top + 1.0)])
                    .decimals(tags::WINDOW_WIDTH, [top + 1.0])],
            )
            .sequence(
                tags::IMAGE_DATA_TYPE_SEQUENCE,
                [Dataset::new().put(tags::DATA_TYPE, VR::CS, "TISSUE_INTENSITY").put(
                    tags::ALIASED_DATA_TYPE,
                    VR::CS,
                    "NO",
                )],
            )
            .sequence(
                tags::US_IMAGE_DESCRIPTION_SEQUENCE,
                [Dataset::new()
                    .texts(tags::FRAME_TYPE, VR::CS, &["ORIGINAL", "PRIMARY", "VOLUME", "NONE"])
                    .put(tags::VOLUMETRIC_PROPERTIES, VR::CS, "VOLUME")
                    .put(tags::VOLUME_BASED_CALCULATION_TECHNIQUE, VR::CS, "NONE")],
            )
    }

    /// Returns the attributes of one plane, with its position.
    fn frame(&self, z: u64) -> Dataset {
        let (date, time) = self.identifiers.acquired();
        let number = u32::try_from(z + 1).unwrap_or(u32::MAX);
        let position = self.grid.world_from_volume().point(DVec3::new(0.0, 0.0, z as f64));
        Dataset::new()
            .sequence(
                tags::FRAME_CONTENT_SEQUENCE,
                [Dataset::new()
                    .put(tags::DIMENSION_INDEX_VALUES, VR::UL, PrimitiveValue::from(number))
                    .put(tags::STACK_ID, VR::SH, "1")
                    .put(tags::IN_STACK_POSITION_NUMBER, VR::UL, PrimitiveValue::from(number))
                    .put(tags::FRAME_ACQUISITION_DATE_TIME, VR::DT, format!("{date}{time}"))
                    .put(tags::FRAME_REFERENCE_DATE_TIME, VR::DT, format!("{date}{time}"))
                    .doubles(tags::FRAME_ACQUISITION_DURATION, [0.0])],
            )
            .sequence(
                tags::PLANE_POSITION_VOLUME_SEQUENCE,
                [Dataset::new().doubles(tags::IMAGE_POSITION_VOLUME, position.to_array())],
            )
            .sequence(
                tags::TEMPORAL_POSITION_SEQUENCE,
                [Dataset::new().doubles(tags::TEMPORAL_POSITION_TIME_OFFSET, [0.0])],
            )
    }
}
