//! Written files, read back.

use dicom_core::Tag;
use dicom_dictionary_std::{tags, uids};
use dicom_object::{DefaultDicomObject, open_file};
use glam::{DMat3, DVec3};

use formats::Limits;
use formats::image::{VolumeReader, open_sequence};
use sonoweave_core::NOTICE;
use sonoweave_core::reading::{Stamp, Status};
use volume::Grid;

use super::dataset::decimal;
use super::identifiers::Identifiers;
use super::segmentation::Segmentation;
use super::sweep::{Sweep, SweepFrame};
use super::volume::VolumeImage;
use crate::ExportError;
use crate::volume::Scalar;

fn grid() -> Grid {
    Grid {
        origin: DVec3::new(-1.5, 2.25, 1000.0 / 3.0),
        spacing: DVec3::new(0.5, 0.25, 0.7),
        direction: DMat3::from_cols(DVec3::Y, DVec3::NEG_X, DVec3::Z),
        size: [5, 3, 4],
    }
}

fn volume<'a>(grid: &'a Grid, scalar: Scalar, identifiers: &'a Identifiers) -> VolumeImage<'a> {
    VolumeImage { grid, scalar, unseen: 7.0, recording: "a hash", world: "Reference", fields: &[], identifiers }
}

/// Returns the frames of a sweep with these poses.
fn frames(poses: &[[f64; 16]]) -> Vec<SweepFrame> {
    let times = [1_000_000_000, 1_033_000_000, 1_020_000_000];
    let frame = |(n, (pose, time_ns)): (usize, (&[f64; 16], i64))| SweepFrame {
        time_ns,
        stamp: Stamp { item: n as u64, source_s: Some(time_ns as f64 / 1e9), ..Stamp::default() },
        number: None,
        pose: Ok(*pose),
    };
    poses.iter().zip(times).enumerate().map(frame).collect()
}

fn sweep<'a>(pixels: &'a [u8], frames: &'a [SweepFrame], identifiers: &'a Identifiers) -> Sweep<'a> {
    Sweep {
        size: [3, 2],
        pixels,
        frames,
        pixel_mm: Some([0.2, 0.1]),
        recording: "a hash",
        world: "Reference",
        identifiers,
    }
}

fn value(x: u64, y: u64, z: u64) -> f32 {
    (x + 10 * y + 40 * z) as f32
}

fn fill(y: u64, z: u64, row: &mut [f32]) {
    for (x, to) in row.iter_mut().enumerate() {
        *to = value(x as u64, y, z);
    }
}

fn text(object: &DefaultDicomObject, tag: Tag) -> String {
    object.element(tag).unwrap().to_str().unwrap().into_owned()
}

/// Asserts that a file states its purpose, for archives and for readers.
fn is_for_research(object: &DefaultDicomObject) {
    assert_eq!(text(object, tags::CONTENT_QUALIFICATION), "RESEARCH");
    let comments = text(object, tags::IMAGE_COMMENTS);
    assert!(comments.starts_with(NOTICE), "{comments}");
}

#[test]
fn volume_planes_lie_at_voxel_positions() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.dcm");
    let (grid, none) = (grid(), Identifiers::default());
    for (scalar, scale) in [(Scalar::U8, 1.0), (Scalar::U16, 300.0)] {
        let write = |y: u64, z: u64, row: &mut [f32]| {
            fill(y, z, row);
            row.iter_mut().for_each(|v| *v *= scale);
        };
        volume(&grid, scalar, &none).write(&path, write).unwrap();
        let read = open_file(&path).unwrap();
        assert_eq!(text(&read, tags::SOP_CLASS_UID), uids::ENHANCED_US_VOLUME_STORAGE);
        let number = |tag| read.element(tag).unwrap().to_int::<u32>().unwrap();
        assert_eq!([tags::COLUMNS, tags::ROWS, tags::NUMBER_OF_FRAMES].map(number), [5, 3, 4]);
        let pixels: Vec<u16> = read.element(tags::PIXEL_DATA).unwrap().to_multi_int().unwrap();
        let expected =
            (0..4).flat_map(|z| (0..3).flat_map(move |y| (0..5).map(move |x| (value(x, y, z) * scale) as u16)));
        assert_eq!(pixels, expected.collect::<Vec<_>>());
        let shared = &read.element(tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE).unwrap().items().unwrap()[0];
        let inner = |item: &dicom_object::InMemDicomObject, sequence: Tag, tag: Tag| -> Vec<f64> {
            let items = item.element(sequence).unwrap().items().unwrap();
            items[0].element(tag).unwrap().to_multi_float64().unwrap()
        };
        // Row spacing first.
        assert_eq!(inner(shared, tags::PIXEL_MEASURES_SEQUENCE, tags::PIXEL_SPACING), [0.25, 0.5]);
        let axes = inner(shared, tags::PLANE_ORIENTATION_VOLUME_SEQUENCE, tags::IMAGE_ORIENTATION_VOLUME);
        assert_eq!(axes, [0.0, 1.0, 0.0, -1.0, 0.0, 0.0]);
        let frames = read.element(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE).unwrap().items().unwrap();
        for (z, frame) in frames.iter().enumerate() {
            let at = inner(frame, tags::PLANE_POSITION_VOLUME_SEQUENCE, tags::IMAGE_POSITION_VOLUME);
            let expected = grid.world_from_volume().point(DVec3::new(0.0, 0.0, z as f64));
            assert_eq!(at, expected.to_array(), "to the last bit");
        }
        assert!(text(&read, tags::IMAGE_COMMENTS).contains("no slice reached have the value 7"));
        is_for_research(&read);
    }
}

#[test]
fn sweep_keeps_frames_times_scale_and_poses() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.dcm");
    let pixels: Vec<u8> = (0..18).map(|i| i * 14).collect();
    let poses: Vec<[f64; 16]> = (0..3).map(|f| std::array::from_fn(|i| f64::from(f) + i as f64 / 3.0)).collect();
    sweep(&pixels, &frames(&poses), &Identifiers::default()).write(&path).unwrap();
    let read = open_file(&path).unwrap();
    assert_eq!(text(&read, tags::SOP_CLASS_UID), uids::ULTRASOUND_MULTI_FRAME_IMAGE_STORAGE);
    assert_eq!(read.element(tags::PIXEL_DATA).unwrap().to_bytes().unwrap().as_ref(), pixels);
    // A time that goes back counts as a step of 0.
    assert_eq!(read.element(tags::FRAME_TIME_VECTOR).unwrap().to_multi_float64().unwrap(), [0.0, 33.0, 0.0]);
    let region = &read.element(tags::SEQUENCE_OF_ULTRASOUND_REGIONS).unwrap().items().unwrap()[0];
    let cm = |tag| region.element(tag).unwrap().to_float64().unwrap();
    assert!((cm(tags::PHYSICAL_DELTA_X) - 0.02).abs() < 1e-12 && (cm(tags::PHYSICAL_DELTA_Y) - 0.01).abs() < 1e-12);
    assert_eq!(text(&read, Tag(0x0009, 0x0010)), "SONOWEAVE");
    assert_eq!(read.element(Tag(0x0009, 0x1001)).unwrap().to_multi_float64().unwrap(), poses.as_flattened());
    assert_eq!(text(&read, Tag(0x0009, 0x1002)), "Reference");
    is_for_research(&read);
}

#[test]
fn given_identifiers_are_written_and_output_repeats() {
    let folder = tempfile::tempdir().unwrap();
    let (grid, none) = (grid(), Identifiers::default());
    let write = |name: &str, identifiers: &Identifiers| {
        let path = folder.path().join(name);
        volume(&grid, Scalar::U8, identifiers).write(&path, fill).unwrap();
        (open_file(&path).unwrap(), std::fs::read(&path).unwrap())
    };
    let ((empty, bytes), (_, again)) = (write("a.dcm", &none), write("b.dcm", &none));
    assert!(bytes == again, "no clock and no chance in it");
    for tag in [tags::PATIENT_NAME, tags::PATIENT_ID, tags::STUDY_DATE, tags::STUDY_ID, tags::ACCESSION_NUMBER] {
        assert_eq!(text(&empty, tag), "", "{tag}");
    }
    let given = Identifiers {
        patient_name: Some("Müller^Jörg".into()),
        patient_id: Some("4711".into()),
        study_description: Some("Knee".into()),
        acquired: Some("20240229235959".into()),
        ..Identifiers::default()
    };
    let (named, _) = write("c.dcm", &given);
    assert_eq!(
        (text(&named, tags::PATIENT_NAME), text(&named, tags::PATIENT_ID)),
        ("Müller^Jörg".into(), "4711".into())
    );
    assert_eq!(
        (text(&named, tags::STUDY_DESCRIPTION), text(&named, tags::STUDY_DATE)),
        ("Knee".into(), "20240229".into())
    );
    // Another instance of another study, in the same frame of reference.
    for tag in [tags::SOP_INSTANCE_UID, tags::STUDY_INSTANCE_UID, tags::SERIES_INSTANCE_UID] {
        assert_ne!(text(&named, tag), text(&empty, tag));
        assert!(text(&named, tag).starts_with("2.25.") && text(&named, tag).len() <= 64);
    }
    assert_eq!(text(&named, tags::FRAME_OF_REFERENCE_UID), text(&empty, tags::FRAME_OF_REFERENCE_UID));
    // A sweep of the same recording and patient has the same study and frame of reference.
    let path = folder.path().join("s.dcm");
    sweep(&[0; 18], &frames(&[[0.0; 16]; 3]), &given).write(&path).unwrap();
    let beside = open_file(&path).unwrap();
    for tag in [tags::STUDY_INSTANCE_UID, tags::FRAME_OF_REFERENCE_UID] {
        assert_eq!(text(&beside, tag), text(&named, tag));
    }
    assert_ne!(text(&beside, tags::SERIES_INSTANCE_UID), text(&named, tags::SERIES_INSTANCE_UID));
}

#[test]
fn invalid_input_is_refused_and_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.dcm");
    let none = Identifiers::default();
    let refused = |grid: &Grid, scalar: Scalar, identifiers: &Identifiers| {
        let error = volume(grid, scalar, identifiers).write(&path, |_, _, _| panic!("nothing is read")).unwrap_err();
        assert!(!path.exists());
        error
    };
    let good = grid();
    assert!(matches!(refused(&good, Scalar::F32, &none), ExportError::FloatingPoint));
    let sized = |size| refused(&Grid { size, ..good }, Scalar::U8, &none);
    assert!(matches!(sized([70_000, 1, 1]), ExportError::DicomTooLong { pixels: 70_000, .. }));
    assert!(matches!(sized([60_000, 60_000, 2]), ExportError::DicomTooLarge { bytes: 7_200_000_000, .. }));
    assert!(matches!(sized([4, 0, 2]), ExportError::NoFrame));
    let with = |change: fn(&mut Identifiers)| {
        let mut identifiers = Identifiers::default();
        change(&mut identifiers);
        refused(&good, Scalar::U8, &identifiers).to_string()
    };
    assert!(with(|i| i.patient_id = Some("4\\7".into())).contains("backslash"));
    assert!(with(|i| i.patient_name = Some("x".repeat(65))).contains("64 characters"));
    for uid in ["1.2.03", "12", "1..2", "1.2a", ""] {
        let identifiers = Identifiers { study_uid: Some(uid.into()), ..Identifiers::default() };
        let error = refused(&good, Scalar::U8, &identifiers);
        assert!(matches!(error, ExportError::Identifier { what: "study UID", .. }), "{uid}: {error}");
    }
    for time in ["20230229000000", "2024", "20241301000000", "20240101240000", "2024010112000x", "00000101000000"] {
        let identifiers = Identifiers { acquired: Some(time.into()), ..Identifiers::default() };
        let error = refused(&good, Scalar::U8, &identifiers);
        assert!(matches!(error, ExportError::Identifier { what: "time of acquisition", .. }), "{time}: {error}");
    }
}

#[test]
fn volume_and_sweep_are_read_back_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dcm");
    let (grid, none) = (Grid { spacing: DVec3::new(1.0 / 3.0, 0.25, 0.7), ..grid() }, Identifiers::default());
    let fields = [("SonoweaveUnseen".to_owned(), "7".to_owned()), ("SonoweaveRange".to_owned(), "0 255".to_owned())];
    VolumeImage { fields: &fields, ..volume(&grid, Scalar::U8, &none) }.write(&path, fill).unwrap();
    let mut read = VolumeReader::open(&path, &Limits::default()).unwrap();
    let header = read.header().clone();
    let axes = [grid.direction.x_axis, grid.direction.y_axis, grid.direction.z_axis].map(|axis| axis.to_array());
    assert_eq!((header.spacing, header.origin), (grid.spacing.to_array(), grid.origin.to_array()));
    assert_eq!((header.axes, header.size), (axes, [5, 3, 4]));
    assert_eq!(header.fields[1..], fields);
    assert_eq!(header.fields[0].1, "Reference (mm, not anatomical)");
    for z in 0..4 {
        let expected: Vec<u8> = (0..3).flat_map(|y| (0..5).map(move |x| value(x, y, z) as u8)).collect();
        assert_eq!(read.next_slice().unwrap().unwrap(), expected);
    }
    let pixels: Vec<u8> = (0..18).map(|i| i * 14).collect();
    let pose = std::array::from_fn(|i| i as f64 / 3.0);
    let mut frames = frames(&[pose; 3]);
    frames[1].pose = Err("OUT_OF_VIEW".into());
    (frames[0].stamp.source_s, frames[2].number) = (None, Some(u64::MAX));
    frames[2].stamp.unfiltered_s = Some(1.0 / 3.0);
    sweep(&pixels, &frames, &none).write(&path).unwrap();
    let read = open_sequence(&path, &Limits::default()).unwrap();
    assert_eq!(read.header.transforms, [("Image".to_owned(), "Reference".to_owned())]);
    for (n, frame) in (0..).zip(&frames) {
        let item = read.header.item(n);
        let stamp = frame.stamp;
        assert_eq!((item.source_s, item.unfiltered_s), (stamp.source_s, stamp.unfiltered_s));
        assert_eq!(item.frame_number, frame.number);
        match &frame.pose {
            Ok(pose) => assert_eq!((item.transforms[0].matrix, &item.transforms[0].status), (*pose, &Status::Ok)),
            Err(word) => assert_eq!(item.transforms[0].status, Status::Other(word.clone().into())),
        }
    }
}

#[test]
fn decimal_strings_fit_sixteen_characters() {
    assert_eq!([0.5, 2.0, -1.0 / 3.0].map(decimal), ["0.5", "2", "-3.3333333333e-1"]);
    for value in [1.0 / 3.0, -std::f64::consts::PI * 1e-7, 1e300 / 7.0, 123_456.789_012_345_67] {
        let text = decimal(value);
        let back: f64 = text.parse().unwrap();
        assert!(text.len() <= 16 && (back / value - 1.0).abs() < 1e-9, "{text}");
    }
}

#[test]
fn segmentation_has_bits_of_its_planes_at_their_places() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.dcm");
    let (grid, identifiers) = (grid(), Identifiers::default());
    let region = Segmentation {
        grid: &grid,
        settings: "a region",
        recording: "a hash",
        world: "Reference",
        identifiers: &identifiers,
    };
    // Planes 1 and 3 have voxels, of 15 each, so that the second begins within a byte.
    let is_inside = |x: u64, y: u64, z: u64| z % 2 == 1 && (x + 2 * y + z).is_multiple_of(3);
    let fill = |y, z, row: &mut [bool]| row.iter_mut().zip(0..).for_each(|(to, x)| *to = is_inside(x, y, z));
    region.write(&path, fill).unwrap();
    let read = open_file(&path).unwrap();
    assert_eq!(text(&read, tags::SOP_CLASS_UID), uids::SEGMENTATION_STORAGE);
    assert_eq!((text(&read, tags::MODALITY), text(&read, tags::SEGMENTATION_TYPE)), ("SEG".into(), "BINARY".into()));
    let number = |tag| read.element(tag).unwrap().to_int::<u32>().unwrap();
    let [columns, rows, frames, bits] =
        [tags::COLUMNS, tags::ROWS, tags::NUMBER_OF_FRAMES, tags::BITS_ALLOCATED].map(number);
    assert_eq!([columns, rows, frames, bits], [5, 3, 2, 1]);
    let bytes = read.element(tags::PIXEL_DATA).unwrap().to_bytes().unwrap().into_owned();
    assert_eq!(bytes.len(), 4);
    let planes = read.element(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE).unwrap().items().unwrap();
    for (frame, z) in [(0, 1), (1, 3)] {
        for (n, (x, y)) in (0..3).flat_map(|y| (0..5).map(move |x| (x, y))).enumerate() {
            let at = 15 * frame + n;
            assert_eq!((bytes[at / 8] >> (at % 8)) & 1 == 1, is_inside(x, y, z), "{x} {y} {z}");
        }
        let position = planes[frame].element(tags::PLANE_POSITION_SEQUENCE).unwrap().items().unwrap()[0]
            .element(tags::IMAGE_POSITION_PATIENT)
            .unwrap()
            .to_multi_float64()
            .unwrap();
        let expected = grid.world_from_volume().point(DVec3::new(0.0, 0.0, z as f64));
        assert!(DVec3::from_slice(&position).distance(expected) < 1e-9, "{position:?}");
    }
    let first = std::fs::read(&path).unwrap();
    region.write(&path, fill).unwrap();
    assert!(std::fs::read(&path).unwrap() == first, "other bytes");
    assert!(text(&read, tags::IMAGE_COMMENTS).contains("a region"));
    is_for_research(&read);
    let none = region.write(&folder.path().join("n.dcm"), |_, _, _| ());
    assert!(matches!(none, Err(ExportError::NoFrame)) && !folder.path().join("n.dcm").exists());
}
