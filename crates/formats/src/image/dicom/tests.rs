//! Files of other programs, damaged files and refused ones. Our own are read back in the tests of
//! `export`.

use std::path::PathBuf;

use dicom_core::value::DataSetSequence;
use dicom_core::{DataElement, PrimitiveValue, Tag, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::{FileMetaTableBuilder, InMemDicomObject};
use proptest::prelude::*;
use sonoweave_core::reading::PixelType;

use crate::image::{About, Content, VolumeReader, content, open_sequence};
use crate::{Error, Limits};

type Object = InMemDicomObject;

fn with(mut object: Object, tag: Tag, vr: VR, value: impl Into<PrimitiveValue>) -> Object {
    object.put(DataElement::new(tag, vr, value.into()));
    object
}

fn nested(mut object: Object, tag: Tag, items: Vec<Object>) -> Object {
    object.put(DataElement::new(tag, VR::SQ, DataSetSequence::from(items)));
    object
}

fn doubles(values: &[f64]) -> PrimitiveValue {
    PrimitiveValue::F64(values.iter().copied().collect())
}

/// Returns an image of 3×2 pixels and four frames, by another program.
fn image(class: &str) -> Object {
    let mut object = Object::new_empty();
    for (tag, vr, text) in [
        (tags::SOP_CLASS_UID, VR::UI, class),
        (tags::SOP_INSTANCE_UID, VR::UI, "1.2.3"),
        (tags::PHOTOMETRIC_INTERPRETATION, VR::CS, "MONOCHROME2"),
        (tags::NUMBER_OF_FRAMES, VR::IS, "4"),
        (tags::PATIENT_NAME, VR::PN, "Doe^Jane"),
    ] {
        object = with(object, tag, vr, text);
    }
    for (tag, number) in [
        (tags::SAMPLES_PER_PIXEL, 1_u16),
        (tags::ROWS, 2),
        (tags::COLUMNS, 3),
        (tags::BITS_ALLOCATED, 8),
        (tags::BITS_STORED, 8),
        (tags::HIGH_BIT, 7),
        (tags::PIXEL_REPRESENTATION, 0),
    ] {
        object = with(object, tag, VR::US, PrimitiveValue::from(number));
    }
    with(object, tags::PIXEL_DATA, VR::OB, PrimitiveValue::U8((0..24).collect()))
}

fn frames() -> Object {
    with(image(uids::ULTRASOUND_MULTI_FRAME_IMAGE_STORAGE), tags::FRAME_TIME, VR::DS, "40")
}

/// Returns a volume whose planes follow one another along −x.
fn planes(place: impl Fn(usize) -> [f64; 3]) -> Object {
    let measures = with(Object::new_empty(), tags::PIXEL_SPACING, VR::DS, "0.25\\0.5");
    let orientation = [0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let axes = with(Object::new_empty(), tags::IMAGE_ORIENTATION_VOLUME, VR::FD, doubles(&orientation));
    let shared = nested(Object::new_empty(), tags::PIXEL_MEASURES_SEQUENCE, vec![measures]);
    let shared = nested(shared, tags::PLANE_ORIENTATION_VOLUME_SEQUENCE, vec![axes]);
    let frame = |n: usize| {
        let position = with(Object::new_empty(), tags::IMAGE_POSITION_VOLUME, VR::FD, doubles(&place(n)));
        nested(Object::new_empty(), tags::PLANE_POSITION_VOLUME_SEQUENCE, vec![position])
    };
    let volume = nested(image(uids::ENHANCED_US_VOLUME_STORAGE), tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE, vec![shared]);
    nested(volume, tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE, (0..4).map(frame).collect())
}

fn even(n: usize) -> [f64; 3] {
    [10.0 - 0.75 * n as f64, 2.0, 3.0]
}

fn bytes(object: &Object, syntax: &str) -> Vec<u8> {
    let meta = FileMetaTableBuilder::new().transfer_syntax(syntax);
    let mut bytes = Vec::new();
    object.clone().with_meta(meta).unwrap().write_all(&mut bytes).unwrap();
    bytes
}

struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn put(&self, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join("a");
        std::fs::write(&path, bytes).unwrap();
        path
    }

    fn of(&self, object: &Object) -> PathBuf {
        self.put(&bytes(object, uids::EXPLICIT_VR_LITTLE_ENDIAN))
    }
}

#[test]
fn others_frames_are_pictures_with_times() {
    let place = Place::new();
    for syntax in [uids::EXPLICIT_VR_LITTLE_ENDIAN, uids::IMPLICIT_VR_LITTLE_ENDIAN] {
        let path = place.put(&bytes(&frames(), syntax));
        let opened = open_sequence(&path, &Limits::default()).unwrap();
        assert_eq!((opened.layout.size, opened.layout.layers, opened.layout.pixel), ([3, 2], 4, PixelType::U8));
        assert_eq!(
            (0..4).map(|n| opened.header.item(n).source_s.unwrap()).collect::<Vec<_>>(),
            [0.0, 0.04, 0.08, 0.12]
        );
        assert!(opened.header.transforms.is_empty() && opened.header.fields.is_empty(), "and no patient's name");
        let pixels = &std::fs::read(&path).unwrap()[opened.layout.data_at as usize..][..24];
        assert_eq!(pixels, (0..24).collect::<Vec<u8>>());
        let about = About::read(&path, &Limits::default()).unwrap();
        assert_eq!((about.content, about.format, about.encoding), (Content::Sequence, "DICOM", "not compressed"));
    }
    let vector = with(frames(), tags::FRAME_TIME_VECTOR, VR::DS, "0\\40\\50\\60");
    let opened = open_sequence(&place.of(&vector), &Limits::default()).unwrap();
    assert_eq!(opened.header.item(3).source_s, Some(0.15));
}

#[test]
fn others_volume_lies_where_its_planes_are() {
    let place = Place::new();
    let mut volume = VolumeReader::open(&place.of(&planes(even)), &Limits::default()).unwrap();
    let header = volume.header();
    assert_eq!((header.size, header.spacing, header.origin), ([3, 2, 4], [0.5, 0.25, 0.75], [10.0, 2.0, 3.0]));
    assert_eq!(header.axes, [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]]);
    assert!(header.fields.is_empty());
    assert_eq!(volume.next_slice().unwrap().unwrap(), [0, 1, 2, 3, 4, 5]);
}

#[test]
fn unreadable_kinds_are_refused_with_remedy() {
    let place = Place::new();
    let us = |tag, number: u16| with(planes(even), tag, VR::US, PrimitiveValue::from(number));
    let uneven = planes(|n| [10.0 - 0.75 * n as f64 - f64::from(u8::from(n == 1)) * 0.1, 2.0, 3.0]);
    let refused = |path: PathBuf, why: &str| {
        let error = content(&path, &Limits::default()).unwrap_err().to_string();
        assert!(error.contains(why), "{error}");
    };
    refused(place.of(&image(uids::CT_IMAGE_STORAGE)), "only ultrasound multi-frame images and enhanced");
    refused(place.put(&bytes(&frames(), "1.2.840.10008.1.2.4.50")), "store the file uncompressed, as by `gdcmconv");
    refused(place.of(&uneven), "not at an even distance");
    refused(place.of(&planes(|_| even(0))), "planes at different places");
    refused(place.of(&us(tags::BITS_STORED, 12)), "BitsStored");
    refused(place.of(&us(tags::SAMPLES_PER_PIXEL, 3)), "only MONOCHROME2 and RGB");
    refused(place.of(&us(tags::ROWS, 0)), "no pixel");
    refused(place.of(&us(tags::ROWS, 65_535)), "cut short");
    refused(place.of(&with(planes(even), tags::RESCALE_SLOPE, VR::DS, "2")), "RescaleSlope");
    refused(place.of(&with(planes(even), tags::NUMBER_OF_FRAMES, VR::IS, "x")), "no whole number");
    refused(place.of(&image(uids::ENHANCED_US_VOLUME_STORAGE)), "is missing for plane 0");
    let mut none = frames();
    none.remove_element(tags::PIXEL_DATA);
    refused(place.of(&none), "has no pixels");
    let sequence = place.of(&planes(even));
    assert!(open_sequence(&sequence, &Limits::default()).err().unwrap().to_string().contains("makes this a volume"));
    let volume = VolumeReader::open(&place.of(&frames()), &Limits::default()).err().unwrap();
    assert!(volume.to_string().contains("reconstruct it first"), "{volume}");
}

#[test]
fn huge_claims_are_refused_before_memory_is_taken() {
    let place = Place::new();
    let object = with(frames(), Tag(0x0009, 0x1001), VR::OB, PrimitiveValue::U8((0..8).collect()));
    let good = bytes(&with(object, Tag(0x0009, 0x0010), VR::LO, "X"), uids::EXPLICIT_VR_LITTLE_ENDIAN);
    let at = good.windows(6).position(|bytes| bytes == b"\x09\0\x01\x10OB").unwrap() + 8;
    let mut huge = good.clone();
    huge[at..at + 4].copy_from_slice(&0xffff_fff0_u32.to_le_bytes());
    let error = content(&place.put(&huge), &Limits::default()).unwrap_err();
    assert!(error.to_string().contains("claims 4294967280 bytes"), "{error}");
    let limits = Limits { header_bytes: 300, ..Limits::default() };
    assert!(matches!(content(&place.put(&good), &limits).unwrap_err(), Error::Limit { .. }));
    let mut deep = frames();
    for _ in 0..20 {
        deep = nested(Object::new_empty(), tags::ACQUISITION_CONTEXT_SEQUENCE, vec![deep]);
    }
    let error = content(&place.of(&deep), &Limits::default()).unwrap_err();
    assert!(error.to_string().contains("nested more than 16 deep"), "{error}");
}

fn read(path: &std::path::Path) -> Vec<String> {
    let limits = Limits { header_bytes: 1 << 14, frame_bytes: 1 << 12, items: 64, ..Limits::default() };
    let mut said = vec![format!("{:?}", content(path, &limits).map_err(|e| e.to_string()))];
    match open_sequence(path, &limits) {
        Ok(opened) => said.extend((0..opened.layout.layers).map(|n| format!("{:?}", opened.header.item(n)))),
        Err(error) => said.push(error.to_string()),
    }
    match VolumeReader::open(path, &limits) {
        Ok(mut volume) => {
            said.push(format!("{:?}", volume.header()));
            while let Ok(Some(slice)) = volume.next_slice() {
                said.push(format!("{slice:?}"));
            }
        }
        Err(error) => said.push(error.to_string()),
    }
    said
}

/// Headers of an item's begin, its end and a sequence's end.
const MARKS: [[u8; 8]; 3] = [*b"\xfe\xff\x00\xe0\0\0\0\0", *b"\xfe\xff\x0d\xe0\0\0\0\0", *b"\xfe\xff\xdd\xe0\0\0\0\0"];

#[test]
fn ends_of_what_did_not_begin_are_refused() {
    let place = Place::new();
    let object = planes(even);
    let good = bytes(&object, uids::EXPLICIT_VR_LITTLE_ENDIAN);
    let at = good.windows(6).position(|bytes| bytes == b"\x10\0\x10\0PN").unwrap();
    let [item, item_end, sequence_end] = MARKS;
    let sequence = *b"\x40\0\x55\x05SQ\0\0\xff\xff\xff\xff";
    let with = |inserted: &[&[u8]]| [&good[..at], &inserted.concat(), &good[at..]].concat();
    assert!(content(&place.put(&with(&[&sequence, &item, &sequence_end])), &Limits::default()).is_ok());
    for inserted in
        [&[&item_end[..], &item][..], &[&sequence, &item_end, &item], &[&sequence, &item_end, &sequence_end]]
    {
        let error = content(&place.put(&with(inserted)), &Limits::default()).unwrap_err().to_string();
        assert!(error.contains("is damaged or cut short there"), "{error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]

    /// A damaged file is read or refused with a sentence, the same each time.
    #[test]
    fn damaged_files_are_read_or_refused(
        is_volume: bool,
        flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..4),
        marks in prop::collection::vec((any::<prop::sample::Index>(), prop::sample::select(&MARKS[..])), 0..3),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let object = if is_volume { planes(even) } else { frames() };
        let mut file = bytes(&object, uids::EXPLICIT_VR_LITTLE_ENDIAN);
        for (at, value) in flips {
            let at = at.index(file.len());
            file[at] = value;
        }
        for (at, mark) in marks {
            let at = at.index(file.len() - mark.len());
            file[at..at + mark.len()].copy_from_slice(&mark);
        }
        if let Some(cut) = cut {
            file.truncate(cut.index(file.len()));
        }
        let place = Place::new();
        let path = place.put(&file);
        prop_assert_eq!(read(&path), read(&path));
    }
}
