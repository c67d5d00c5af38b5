//! Modules common to volumes and sweeps, and the writing of files.

use std::io;
use std::path::Path;

use dicom_core::value::DataSetSequence;
use dicom_core::{DataElement, PrimitiveValue, Tag, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::{FileMetaTableBuilder, InMemDicomObject};

use super::uid::uid;
use super::{ExportError, Identifiers};
use formats::whole::write_whole;
use volume::Grid;

/// Elements of a data set, or of an item of a sequence.
#[derive(Debug, Clone)]
pub(super) struct Dataset(InMemDicomObject);

/// Characters of a decimal string.
const DECIMALS: usize = 16;

/// Formats a number as a decimal string of at most 16 characters.
pub(super) fn decimal(value: f64) -> String {
    let shortest = value.to_string();
    if shortest.len() <= DECIMALS {
        return shortest;
    }
    let texts = (0..DECIMALS).rev().map(|digits| format!("{value:.digits$e}"));
    texts.into_iter().find(|text| text.len() <= DECIMALS).unwrap_or(shortest)
}

/// Formats numbers as the value of several decimal strings.
pub(super) fn decimals(values: &[f64]) -> String {
    values.iter().copied().map(decimal).collect::<Vec<_>>().join("\\")
}

impl Dataset {
    pub(super) fn new() -> Self {
        Self(InMemDicomObject::new_empty())
    }

    pub(super) fn put(mut self, tag: Tag, vr: VR, value: impl Into<PrimitiveValue>) -> Self {
        self.0.put(DataElement::new(tag, vr, value.into()));
        self
    }

    /// Removes an element.
    pub(super) fn without(mut self, tag: Tag) -> Self {
        self.0.remove_element(tag);
        self
    }

    /// Adds an element of several texts.
    pub(super) fn texts(self, tag: Tag, vr: VR, texts: &[&str]) -> Self {
        self.put(tag, vr, texts.join("\\"))
    }

    /// Adds an element of several decimal strings.
    pub(super) fn decimals(self, tag: Tag, values: impl IntoIterator<Item = f64>) -> Self {
        self.put(tag, VR::DS, decimals(&values.into_iter().collect::<Vec<_>>()))
    }

    /// Adds an element of several doubles.
    pub(super) fn doubles(self, tag: Tag, values: impl IntoIterator<Item = f64>) -> Self {
        self.put(tag, VR::FD, PrimitiveValue::F64(values.into_iter().collect()))
    }

    pub(super) fn sequence(mut self, tag: Tag, items: impl IntoIterator<Item = Self>) -> Self {
        let items: Vec<InMemDicomObject> = items.into_iter().map(|item| item.0).collect();
        self.0.put(DataElement::new(tag, VR::SQ, DataSetSequence::from(items)));
        self
    }

    /// Adds a code as the only item of a sequence.
    pub(super) fn code(self, tag: Tag, [value, scheme, meaning]: [&str; 3]) -> Self {
        let item = Self::new()
            .put(tags::CODE_VALUE, VR::SH, value)
            .put(tags::CODING_SCHEME_DESIGNATOR, VR::SH, scheme)
            .put(tags::CODE_MEANING, VR::LO, meaning);
        self.sequence(tag, [item])
    }
}

/// Description of an image, for the modules that all images have.
pub(super) struct Image<'a> {
    pub(super) class: &'static str,
    /// Differs between the images of one recording.
    pub(super) series_number: &'static str,
    pub(super) identifiers: &'a Identifiers,
    /// Text from which the study and the frame of reference are derived: the recording's hash,
    /// or another text unique to it.
    pub(super) recording: &'a str,
    /// Name of the frame in which the image lies.
    pub(super) world: &'a str,
    /// All data that distinguishes the instance from others, apart from the identifiers.
    pub(super) content: Vec<&'a [u8]>,
}

impl Image<'_> {
    fn study(&self) -> String {
        let ids = self.identifiers;
        let text = |text: &Option<String>| text.clone().unwrap_or_default();
        let [patient, name, study] = [&ids.patient_id, &ids.patient_name, &ids.study_description].map(text);
        let derive = || {
            let parts = ["study", self.recording, &patient, &name, &study];
            uid(parts.map(str::as_bytes))
        };
        ids.study_uid.clone().unwrap_or_else(derive)
    }

    /// Returns the identifier of the frame of reference.
    pub(super) fn frame_of_reference(&self) -> String {
        uid(["frame of reference", self.recording, self.world].map(str::as_bytes))
    }

    /// Returns the patient, study, series, equipment, frame of reference and SOP common modules.
    pub(super) fn dataset(&self) -> Dataset {
        let ids = self.identifiers;
        let given = |text: &Option<String>| text.clone().unwrap_or_default();
        let (date, time) = match &ids.acquired {
            Some(_) => ids.acquired(),
            None => ("", ""),
        };
        let (study, description) = (self.study(), given(&ids.series_description));
        let series = uid(["series", &study, self.class, &description].map(str::as_bytes));
        let acquired = given(&ids.acquired);
        let own = ["instance", &series, &acquired, &given(&ids.patient_name), &given(&ids.patient_id)];
        let instance = uid(own.map(str::as_bytes).into_iter().chain(self.content.iter().copied()));
        let mut dataset = Dataset::new()
            .put(tags::SPECIFIC_CHARACTER_SET, VR::CS, "ISO_IR 192")
            .put(tags::SOP_CLASS_UID, VR::UI, self.class)
            .put(tags::SOP_INSTANCE_UID, VR::UI, instance)
            .put(tags::PATIENT_NAME, VR::PN, given(&ids.patient_name))
            .put(tags::PATIENT_ID, VR::LO, given(&ids.patient_id))
            .put(tags::PATIENT_BIRTH_DATE, VR::DA, "")
            .put(tags::PATIENT_SEX, VR::CS, "")
            .put(tags::STUDY_INSTANCE_UID, VR::UI, study)
            .put(tags::STUDY_DATE, VR::DA, date)
            .put(tags::STUDY_TIME, VR::TM, time)
            .put(tags::REFERRING_PHYSICIAN_NAME, VR::PN, "")
            .put(tags::STUDY_ID, VR::SH, "")
            .put(tags::ACCESSION_NUMBER, VR::SH, "")
            .put(tags::MODALITY, VR::CS, "US")
            .put(tags::SERIES_INSTANCE_UID, VR::UI, series)
            .put(tags::SERIES_NUMBER, VR::IS, self.series_number)
            .put(tags::LATERALITY, VR::CS, "")
            .put(tags::MANUFACTURER, VR::LO, "sonoweave")
            .put(tags::MANUFACTURER_MODEL_NAME, VR::LO, "sonoweave")
            .put(tags::DEVICE_SERIAL_NUMBER, VR::LO, "none")
            .put(tags::SOFTWARE_VERSIONS, VR::LO, env!("CARGO_PKG_VERSION"))
            .put(tags::FRAME_OF_REFERENCE_UID, VR::UI, self.frame_of_reference())
            .put(tags::POSITION_REFERENCE_INDICATOR, VR::LO, "")
            .put(tags::INSTANCE_NUMBER, VR::IS, "1")
            .put(tags::PATIENT_ORIENTATION, VR::CS, "")
            .put(tags::LOSSY_IMAGE_COMPRESSION, VR::CS, "00")
            .put(tags::CONTENT_QUALIFICATION, VR::CS, "RESEARCH");
        let descriptions =
            [(tags::STUDY_DESCRIPTION, &ids.study_description), (tags::SERIES_DESCRIPTION, &ids.series_description)];
        for (tag, text) in descriptions.into_iter().filter_map(|(tag, text)| Some((tag, text.clone()?))) {
            dataset = dataset.put(tag, VR::LO, text);
        }
        dataset
    }
}

/// Returns the distances of a volume's voxels.
pub(super) fn pixel_measures(grid: &Grid) -> Dataset {
    // Spacing between rows, then between columns.
    Dataset::new()
        .decimals(tags::PIXEL_SPACING, [grid.spacing.y, grid.spacing.x])
        .decimals(tags::SLICE_THICKNESS, [grid.spacing.z])
        .decimals(tags::SPACING_BETWEEN_SLICES, [grid.spacing.z])
}

/// Frames of grey values, and their storage type.
pub(super) enum Pixels {
    U8(Vec<u8>),
    U16(Vec<u16>),
}

impl Pixels {
    /// Adds the image pixel and multi-frame modules, for an image with these columns and rows.
    pub(super) fn put(self, dataset: Dataset, frames: u64, [columns, rows]: [u16; 2]) -> Dataset {
        let bits: u16 = match self {
            Self::U8(_) => 8,
            Self::U16(_) => 16,
        };
        let dataset = dataset
            .put(tags::SAMPLES_PER_PIXEL, VR::US, PrimitiveValue::from(1_u16))
            .put(tags::PHOTOMETRIC_INTERPRETATION, VR::CS, "MONOCHROME2")
            .put(tags::NUMBER_OF_FRAMES, VR::IS, frames.to_string())
            .put(tags::ROWS, VR::US, PrimitiveValue::from(rows))
            .put(tags::COLUMNS, VR::US, PrimitiveValue::from(columns))
            .put(tags::BITS_ALLOCATED, VR::US, PrimitiveValue::from(bits))
            .put(tags::BITS_STORED, VR::US, PrimitiveValue::from(bits))
            .put(tags::HIGH_BIT, VR::US, PrimitiveValue::from(bits - 1))
            .put(tags::PIXEL_REPRESENTATION, VR::US, PrimitiveValue::from(0_u16));
        match self {
            Self::U8(mut values) => {
                // DICOM requires an even length.
                if values.len() % 2 == 1 {
                    values.push(0);
                }
                dataset.put(tags::PIXEL_DATA, VR::OB, PrimitiveValue::U8(values.into()))
            }
            Self::U16(values) => dataset.put(tags::PIXEL_DATA, VR::OW, PrimitiveValue::U16(values.into())),
        }
    }
}

/// Writes a file, whole or not at all.
pub(super) fn write(dataset: Dataset, path: &Path) -> Result<(), ExportError> {
    let failed = |source: io::Error| ExportError::Write { path: path.to_owned(), source };
    let meta = FileMetaTableBuilder::new()
        .transfer_syntax(uids::EXPLICIT_VR_LITTLE_ENDIAN)
        .implementation_class_uid(uid([b"sonoweave".as_slice()]))
        .implementation_version_name("SONOWEAVE");
    let object = dataset.0.with_meta(meta).map_err(|e| failed(io::Error::other(e)))?;
    write_whole(path, |to| object.write_all(to).map_err(io::Error::other)).map_err(failed)
}
