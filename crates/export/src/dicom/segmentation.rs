//! A region as a binary Segmentation (DICOM PS3.3 A.51).

use std::path::Path;

use dicom_core::{PrimitiveValue, VR};
use dicom_dictionary_std::{tags, uids};
use glam::DVec3;

use sonoweave_core::NOTICE;
use volume::Grid;

use super::dataset::{Dataset, Image, Pixels, write};
use super::{ExportError, Identifiers, bytes, edges};

/// Advice for a region that is too large.
const SMALLER: &str = "crop the volume, or choose a coarser spacing";
/// Category and type of the segment: no more is known than that it is of the body.
const CATEGORY: [&str; 3] = ["123037004", "SCT", "Anatomical Structure"];
const TYPE: [&str; 3] = ["85756007", "SCT", "Tissue"];

/// A region to be written. Planes without any of its voxels are left out.
#[derive(Debug, Clone, Copy)]
pub struct Segmentation<'a> {
    /// Place and size of its voxels.
    pub grid: &'a Grid,
    /// The settings in words.
    pub settings: &'a str,
    /// Hash of the recording, or another text unique to it. Images of one recording share their
    /// study and frame of reference.
    pub recording: &'a str,
    /// Name of the world frame.
    pub world: &'a str,
    /// Identifiers of the patient and the study.
    pub identifiers: &'a Identifiers,
}

impl Segmentation<'_> {
    /// Writes the region, whole or not at all. `row(y, z, inside)` says which voxels of a row
    /// belong to it.
    ///
    /// # Errors
    /// [`ExportError`] for an invalid identifier or size, a region without voxels, and file system
    /// errors.
    pub fn write(&self, path: &Path, mut row: impl FnMut(u64, u64, &mut [bool])) -> Result<(), ExportError> {
        self.identifiers.check()?;
        let [nx, ny, nz] = self.grid.size;
        let plane = edges([nx, ny], SMALLER)?;
        bytes(nz, plane, 1, SMALLER)?;
        let mut bits = Vec::new();
        let (mut planes, mut inside) = (Vec::new(), vec![false; (nx * ny) as usize]);
        for z in 0..nz {
            inside.chunks_exact_mut(nx as usize).zip(0..).for_each(|(inside, y)| row(y, z, inside));
            if inside.contains(&true) {
                planes.push(z);
                bits.extend_from_slice(&inside);
            }
        }
        if planes.is_empty() {
            return Err(ExportError::NoFrame);
        }
        // Frames follow each other without a gap, also within a byte.
        let byte = |bits: &[bool]| bits.iter().zip(0..).fold(0, |byte, (bit, at)| byte | (u8::from(*bit) << at));
        let pixels: Vec<u8> = bits.chunks(8).map(byte).collect();
        let dataset = self.dataset(&planes, &pixels);
        let dataset = Pixels::U8(pixels).put(dataset, planes.len() as u64, plane);
        // Eight pixels a byte, the first in its lowest bit.
        let bits = [(tags::BITS_ALLOCATED, 1_u16), (tags::BITS_STORED, 1), (tags::HIGH_BIT, 0)];
        let put = |dataset: Dataset, (tag, bits)| dataset.put(tag, VR::US, PrimitiveValue::from(bits));
        write(bits.into_iter().fold(dataset, put), path)
    }

    fn dataset(&self, planes: &[u64], pixels: &[u8]) -> Dataset {
        let grid = self.grid;
        let numbers = [grid.origin, grid.spacing, grid.direction.x_axis, grid.direction.y_axis, grid.direction.z_axis];
        let place = numbers.iter().flat_map(|v| v.to_array()).flat_map(f64::to_le_bytes);
        let place: Vec<u8> = place.chain(grid.size.iter().chain(planes).flat_map(|n| n.to_le_bytes())).collect();
        let image = Image {
            class: uids::SEGMENTATION_STORAGE,
            series_number: "3",
            identifiers: self.identifiers,
            recording: self.recording,
            world: self.world,
            content: vec![self.settings.as_bytes(), &place, pixels],
        };
        let (date, time) = self.identifiers.acquired();
        let comments = format!(
            "{NOTICE} Frame of reference: {} of the recording (mm, not a patient's). {}. Voxels that no slice reached are not in the segment.",
            self.world, self.settings
        );
        let dimensions = super::uid::uid(["segment dimensions", &image.frame_of_reference()].map(str::as_bytes));
        let dimension = |pointer, group| {
            Dataset::new()
                .put(tags::DIMENSION_ORGANIZATION_UID, VR::UI, dimensions.clone())
                .put(tags::DIMENSION_INDEX_POINTER, VR::AT, PrimitiveValue::from(pointer))
                .put(tags::FUNCTIONAL_GROUP_POINTER, VR::AT, PrimitiveValue::from(group))
        };
        let segment = Dataset::new()
            .put(tags::SEGMENT_NUMBER, VR::US, PrimitiveValue::from(1_u16))
            .put(tags::SEGMENT_LABEL, VR::LO, "region")
            .put(tags::SEGMENT_ALGORITHM_TYPE, VR::CS, "SEMIAUTOMATIC")
            .put(tags::SEGMENT_ALGORITHM_NAME, VR::LO, "sonoweave")
            .code(tags::SEGMENTED_PROPERTY_CATEGORY_CODE_SEQUENCE, CATEGORY)
            .code(tags::SEGMENTED_PROPERTY_TYPE_CODE_SEQUENCE, TYPE);
        // A side is only allowed to paired parts of the body, and the part is not known.
        image
            .dataset()
            .without(tags::LATERALITY)
            .put(tags::MODALITY, VR::CS, "SEG")
            .texts(tags::IMAGE_TYPE, VR::CS, &["DERIVED", "PRIMARY"])
            .put(tags::CONTENT_DATE, VR::DA, date)
            .put(tags::CONTENT_TIME, VR::TM, time)
            .put(tags::IMAGE_COMMENTS, VR::LT, comments)
            .put(tags::CONTENT_LABEL, VR::CS, "REGION")
            .put(tags::CONTENT_DESCRIPTION, VR::LO, "")
            .put(tags::CONTENT_CREATOR_NAME, VR::PN, "")
            .put(tags::SEGMENTATION_TYPE, VR::CS, "BINARY")
            .put(tags::SEGMENTS_OVERLAP, VR::CS, "NO")
            .sequence(tags::SEGMENT_SEQUENCE, [segment])
            .sequence(
                tags::DIMENSION_ORGANIZATION_SEQUENCE,
                [Dataset::new().put(tags::DIMENSION_ORGANIZATION_UID, VR::UI, dimensions.clone())],
            )
            .sequence(
                tags::DIMENSION_INDEX_SEQUENCE,
                [
                    dimension(tags::REFERENCED_SEGMENT_NUMBER, tags::SEGMENT_IDENTIFICATION_SEQUENCE),
                    dimension(tags::IMAGE_POSITION_PATIENT, tags::PLANE_POSITION_SEQUENCE),
                ],
            )
            .sequence(tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE, [self.shared()])
            .sequence(
                tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE,
                planes.iter().zip(1..).map(|(z, number)| self.frame(*z, number)),
            )
    }

    /// Returns the attributes that all planes share.
    fn shared(&self) -> Dataset {
        let grid = self.grid;
        let [x, y] = [grid.direction.x_axis, grid.direction.y_axis].map(|axis| axis.to_array());
        Dataset::new()
            .sequence(tags::PIXEL_MEASURES_SEQUENCE, [super::dataset::pixel_measures(grid)])
            .sequence(
                tags::PLANE_ORIENTATION_SEQUENCE,
                [Dataset::new().decimals(tags::IMAGE_ORIENTATION_PATIENT, x.into_iter().chain(y))],
            )
            .sequence(
                tags::SEGMENT_IDENTIFICATION_SEQUENCE,
                [Dataset::new().put(tags::REFERENCED_SEGMENT_NUMBER, VR::US, PrimitiveValue::from(1_u16))],
            )
    }

    /// Returns the attributes of one plane, with its position.
    fn frame(&self, z: u64, number: u32) -> Dataset {
        let position = self.grid.world_from_volume().point(DVec3::new(0.0, 0.0, z as f64));
        let indices = PrimitiveValue::U32([1, number].into_iter().collect());
        Dataset::new()
            .sequence(tags::FRAME_CONTENT_SEQUENCE, [Dataset::new().put(tags::DIMENSION_INDEX_VALUES, VR::UL, indices)])
            .sequence(
                tags::PLANE_POSITION_SEQUENCE,
                [Dataset::new().decimals(tags::IMAGE_POSITION_PATIENT, position.to_array())],
            )
    }
}
