//! Every container is equivalent: files written in any of them read back the same. Separate
//! pixel files appear and disappear with their header.

#![allow(clippy::unwrap_used, reason = "a test that cannot be set up has failed")]

use std::fs;
use std::io::Write as _;
use std::path::Path;

use proptest::prelude::*;

use drivers::replay::{Replay, SequenceSettings};
use formats::image::write::{SequenceHeader, SequenceItem, SequenceWriter, VolumeWriter};
use formats::image::{About, Content, ELEMENT_SPACING, VolumeHeader, VolumeReader};
use formats::{Error as FileError, Limits, Unwritable};
use sonoweave_core::reading::{NamedTransform, PixelType, Reading, Stamp, Status};
use sonoweave_core::{Device, Next};

const SEQUENCES: [&str; 5] = ["a.igs.mha", "a.mhd", "a.igs.nrrd", "a.seq.nrrd", "a.nhdr"];
const VOLUMES: [&str; 4] = ["a.mha", "a.mhd", "a.nrrd", "a.nhdr"];

/// Generates field names without a meaning to readers or formats.
fn names() -> impl Strategy<Value = String> {
    prop::sample::subsequence(vec!["Operator", "Söite", "CustomFrameField", "a b", "X\\n", "Kernel"], 0..4)
        .prop_map(|names| names.join("|"))
}

fn texts() -> impl Strategy<Value = String> {
    prop_oneof![
        Just(String::new()),
        "[ -~äµ]{0,20}".prop_map(|text| text.trim().to_owned()),
        Just("C:\\new\\\\path".to_owned()),
        Just("key:=value = x: y # z".to_owned()),
    ]
}

fn fields() -> impl Strategy<Value = Vec<(String, String)>> {
    (names(), prop::collection::vec(texts(), 4)).prop_map(|(names, texts)| {
        let names = names.split('|').filter(|name| !name.is_empty()).map(str::to_owned);
        names.zip(texts).collect()
    })
}

fn status() -> impl Strategy<Value = Status> {
    prop_oneof![Just(Status::Ok), Just(Status::Other("INVALID".into())), Just(Status::Other("MISSING".into()))]
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        Just(0.0),
        Just(-1.0),
        Just(1.0e-300),
        -1.0e6..1.0e6,
        any::<f64>().prop_filter("no NaN", |v| !v.is_nan())
    ]
}

fn item(timed: bool) -> impl Strategy<Value = SequenceItem> {
    let transform = |from: &'static str, to: &'static str| {
        (prop::array::uniform16(number()), status()).prop_map(move |(matrix, status)| NamedTransform {
            stamp: Stamp::default(),
            from: from.into(),
            to: to.into(),
            matrix,
            status,
        })
    };
    let transforms = (prop::option::of(transform("Probe", "Tracker")), prop::option::of(transform("Stylus", "")));
    (0.0..1e9, prop::option::of(0.0..1e9), any::<Option<u64>>(), status(), transforms, fields()).prop_map(
        move |(source_s, unfiltered_s, frame_number, status, (first, second), fields)| SequenceItem {
            stamp: Stamp { source_s: timed.then_some(source_s), unfiltered_s, ..Stamp::default() },
            frame_number,
            status,
            transforms: first.into_iter().chain(second).collect(),
            fields,
        },
    )
}

prop_compose! {
    fn sequence()(
        images in any::<bool>(),
        size in [1..5_u32, 1..5_u32],
        pixel in prop::sample::select(&PixelType::ALL[..]),
        channels in 1..=4_u32,
        orientation in prop::sample::select(vec!["", "MFA", "UN"]),
        image_type in prop::sample::select(vec!["", "BRIGHTNESS"]),
        compressed in any::<bool>(),
        spacing in prop::option::of((1e-3..1e3, prop_oneof![Just(1.0), 1e-3..1e3])),
        fields in fields(),
        items in any::<bool>().prop_flat_map(|timed| prop::collection::vec(item(timed), 1..5)),
    ) -> SequenceHeader {
        SequenceHeader {
            size: if images { size } else { [0, 0] },
            pixel,
            channels,
            orientation: orientation.into(),
            image_type: image_type.into(),
            compressed,
            fields: spacing.map(|(x, y)| (ELEMENT_SPACING.to_owned(), format!("{x} {y}"))).into_iter().chain(fields).collect(),
            items,
        }
    }
}

fn pixels(header: &SequenceHeader, frame: usize) -> Vec<u8> {
    let bytes = header.size[0] as usize * header.size[1] as usize * header.channels as usize * header.pixel.bytes();
    (0..bytes).map(|at| (at * 37 + frame * 101) as u8).collect()
}

fn check(path: &Path, header: &SequenceHeader) {
    let mut writer = SequenceWriter::create(path, header).unwrap();
    let images = header.size != [0, 0];
    for frame in (0..header.items.len()).filter(|_| images) {
        writer.write_frame(&pixels(header, frame)).unwrap();
    }
    writer.finish().unwrap();
    let mut device = Replay::open(&SequenceSettings::new(path)).unwrap();
    assert_eq!(device.describe().fields, header.fields);
    assert_eq!(device.describe().pixel, images.then_some((header.pixel, header.channels)));
    device.start().unwrap();
    for (n, put) in header.items.iter().enumerate() {
        for transform in &put.transforms {
            let Next::Reading(Reading::NamedTransform(got)) = device.next(sonoweave_core::NO_DEADLINE).unwrap() else {
                panic!("no transform")
            };
            assert_eq!((&got.from, &got.to, &got.status), (&transform.from, &transform.to, &transform.status));
            assert_eq!(got.matrix.map(f64::to_bits), transform.matrix.map(f64::to_bits));
        }
        let Next::Reading(Reading::Frame(got)) = device.next(sonoweave_core::NO_DEADLINE).unwrap() else {
            panic!("no frame")
        };
        assert_eq!(got.stamp, Stamp { item: n as u64, ..put.stamp });
        assert_eq!((got.frame_number, &got.status, &got.fields), (put.frame_number, &put.status, &put.fields));
        assert_eq!((&*got.orientation, &*got.image_type), (&*header.orientation, &*header.image_type));
        assert_eq!(*got.pixels, pixels(header, n));
    }
    assert!(matches!(device.next(sonoweave_core::NO_DEADLINE).unwrap(), Next::End));
    let about = About::read(path, &Limits::default()).unwrap();
    assert_eq!((about.content, about.compressed), (Content::Sequence, header.compressed && images));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn sequence_roundtrips_in_every_container(header in sequence()) {
        let folder = tempfile::tempdir().unwrap();
        for name in SEQUENCES {
            check(&folder.path().join(name), &header);
        }
    }

    #[test]
    fn volume_roundtrips_in_every_container(
        size in [1..5_u32, 1..5_u32, 1..5_u32],
        spacing in prop::array::uniform3(1e-3..1e3),
        origin in prop::array::uniform3(-1e4..1e4),
        turned in any::<bool>(),
        pixel in prop::sample::select(&PixelType::ALL[..]),
        channels in 1..=4_u32,
        compressed in any::<bool>(),
        fields in fields(),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let (c, s) = (0.8, 0.6);
        let plain = VolumeHeader::new(size, pixel);
        let axes = if turned { [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, -1.0]] } else { plain.axes };
        let header = VolumeHeader { spacing, origin, axes, channels, compressed, fields, ..plain };
        let bytes = header.slice_bytes().unwrap() as usize * size[2] as usize;
        let voxels: Vec<u8> = (0..bytes).map(|at| (at * 31) as u8).collect();
        for name in VOLUMES {
            let path = folder.path().join(name);
            let mut writer = VolumeWriter::create(&path, &header).unwrap();
            writer.write_all(&voxels).unwrap();
            writer.finish().unwrap();
            let mut reader = VolumeReader::open(&path, &Limits::default()).unwrap();
            let mut got = reader.header().clone();
            let near = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 4.0 * f64::EPSILON * b.abs().max(1.0));
            prop_assert!(near(&got.spacing, &header.spacing), "{:?} is not {:?}", got.spacing, header.spacing);
            prop_assert!(near(got.axes.as_flattened(), header.axes.as_flattened()), "{:?}", got.axes);
            got.fields.retain(|(name, _)| name != "AnatomicalOrientation");
            prop_assert_eq!(&got, &VolumeHeader { spacing: got.spacing, axes: got.axes, ..header.clone() });
            let mut back = Vec::new();
            while let Some(slice) = reader.next_slice().unwrap() {
                back.extend_from_slice(slice);
            }
            prop_assert_eq!(&back, &voxels);
        }
    }
}

fn read_slices(path: &Path) -> Result<(), FileError> {
    let mut reader = VolumeReader::open(path, &Limits::default())?;
    while reader.next_slice()?.is_some() {}
    Ok(())
}

#[test]
fn separate_pixel_file_follows_its_header() {
    let folder = tempfile::tempdir().unwrap();
    let entries = || {
        let mut names: Vec<_> =
            fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    };
    for (name, compressed, data) in [
        ("s.igs.mhd", false, "s.igs.raw"),
        ("s.igs.mhd", true, "s.igs.zraw"),
        ("s.nhdr", false, "s.raw"),
        ("s.nhdr", true, "s.raw.gz"),
    ] {
        let path = folder.path().join(name);
        let header = VolumeHeader { compressed, ..VolumeHeader::new([3, 2, 2], PixelType::U8) };
        let mut writer = VolumeWriter::create(&path, &header).unwrap();
        writer.write_all(&[7; 11]).unwrap();
        assert!(matches!(writer.finish(), Err(FileError::Unwritable { .. })));
        assert!(entries().is_empty(), "half a file is none");
        let mut writer = VolumeWriter::create(&path, &header).unwrap();
        writer.write_all(&[7; 12]).unwrap();
        writer.finish().unwrap();
        let mut expected = vec![name.to_owned(), data.to_owned()];
        expected.sort();
        assert_eq!(entries(), expected);
        let header = fs::read_to_string(&path).unwrap();
        assert!(
            header.contains(&format!("ElementDataFile = {data}\n")) || header.contains(&format!("data file: {data}\n"))
        );
        let opened = VolumeReader::open(&path, &Limits::default());
        assert_eq!(opened.unwrap().next_slice().unwrap().unwrap(), [7; 6]);
        fs::write(folder.path().join(data), [7; 5]).unwrap();
        let text = read_slices(&path).unwrap_err().to_string();
        assert!(text.contains(data), "{text}");
        fs::remove_file(folder.path().join(data)).unwrap();
        fs::remove_file(&path).unwrap();
    }
}

#[test]
fn failed_rename_restores_earlier_pixels() {
    for (name, data) in [("s.mhd", "s.raw"), ("s.nhdr", "s.raw")] {
        let folder = tempfile::tempdir().unwrap();
        let (path, data) = (folder.path().join(name), folder.path().join(data));
        let write = |value: u8| {
            let mut writer = VolumeWriter::create(&path, &VolumeHeader::new([3, 2, 2], PixelType::U8)).unwrap();
            writer.write_all(&[value; 12]).unwrap();
            writer.finish()
        };
        let count = || fs::read_dir(folder.path()).unwrap().count();
        // A folder with the header's name blocks it.
        fs::create_dir(&path).unwrap();
        let error = write(1).unwrap_err();
        assert!(matches!(&error, FileError::Io { path: at, .. } if *at == path), "{error}");
        assert!(!data.exists() && count() == 1, "{name}");
        fs::write(&data, [2; 12]).unwrap();
        write(3).unwrap_err();
        assert_eq!((fs::read(&data).unwrap(), count()), (vec![2; 12], 2), "{name}");
        // A folder with the pixel file's name blocks the pixel file.
        fs::remove_dir(&path).unwrap();
        fs::remove_file(&data).unwrap();
        fs::create_dir(&data).unwrap();
        write(4).unwrap_err();
        assert!(data.is_dir() && count() == 1, "{name}");
        fs::remove_dir(&data).unwrap();
        for value in [5, 6] {
            write(value).unwrap();
            assert_eq!((fs::read(&data).unwrap(), count()), (vec![value; 12], 2), "{name}");
        }
    }
}

#[test]
fn name_without_format_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.png", "a", "a.seq.nrrd"] {
        let error =
            VolumeWriter::create(&folder.path().join(name), &VolumeHeader::new([1; 3], PixelType::U8)).err().unwrap();
        assert!(
            error.to_string().contains("volumes are written as .mha, .mhd, .nrrd, .nhdr, .nii or .nii.gz"),
            "{error}"
        );
    }
}

fn put(path: &Path, header: &VolumeHeader) -> Vec<u8> {
    let bytes = header.slice_bytes().unwrap() as usize * header.size[2] as usize;
    let voxels: Vec<u8> = (0..bytes).map(|at| (at * 31) as u8).collect();
    let mut writer = VolumeWriter::create(path, header).unwrap();
    writer.write_all(&voxels).unwrap();
    writer.finish().unwrap();
    voxels
}

#[test]
fn nifti_roundtrips_within_single_precision() {
    let folder = tempfile::tempdir().unwrap();
    let kinds = PixelType::ALL.map(|pixel| (pixel, 1)).into_iter().chain([(PixelType::U8, 3), (PixelType::U8, 4)]);
    for ((pixel, channels), name) in kinds.flat_map(|kind| [(kind, "v.nii"), (kind, "v.nii.gz")]) {
        let path = folder.path().join(name);
        let header = VolumeHeader {
            spacing: [0.5, 0.3, 2.0],
            origin: [-74.5217, 165.573, 1.0e-3],
            axes: [[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, -1.0]],
            channels,
            compressed: name.ends_with("gz"),
            fields: vec![
                ("Kernel".into(), "a = b".into()),
                ("Empty".into(), String::new()),
                ("M".into(), "März".into()),
            ],
            ..VolumeHeader::new([4, 3, 6], pixel)
        };
        let voxels = put(&path, &header);
        let mut reader = VolumeReader::open(&path, &Limits::default()).unwrap();
        let got = reader.header().clone();
        let near = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-6 * b.abs().max(1.0));
        assert!(near(&got.spacing, &header.spacing) && near(&got.origin, &header.origin), "{got:?}");
        assert!(near(got.axes.as_flattened(), header.axes.as_flattened()), "{:?}", got.axes);
        let VolumeHeader { spacing, origin, axes, .. } = got;
        assert_eq!(got, VolumeHeader { spacing, origin, axes, ..header });
        let mut back = Vec::new();
        while let Some(slice) = reader.next_slice().unwrap() {
            back.extend_from_slice(slice);
        }
        assert_eq!(back, voxels, "{name} {pixel:?}");
        assert_eq!(About::read(&path, &Limits::default()).unwrap().content, Content::Volume);
        assert!(
            Replay::open(&SequenceSettings::new(&path)).err().unwrap().to_string().contains("not a sequence of frames")
        );
    }
}

#[test]
fn nifti_quaternion_matches_matrix() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.nii");
    for axes in [
        [[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]],
        [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]],
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]],
    ] {
        let header = VolumeHeader {
            origin: [1.0, 2.0, 3.0],
            spacing: [0.5, 1.0, 2.0],
            axes,
            ..VolumeHeader::new([2; 3], PixelType::U8)
        };
        put(&path, &header);
        let by_matrix = VolumeReader::open(&path, &Limits::default()).unwrap().header().clone();
        let mut bytes = fs::read(&path).unwrap();
        bytes[254] = 0;
        fs::write(&path, &bytes).unwrap();
        let by_quaternion = VolumeReader::open(&path, &Limits::default()).unwrap().header().clone();
        let apart = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(by_quaternion.placed && by_matrix.placed);
        assert!(apart(by_quaternion.axes.as_flattened(), by_matrix.axes.as_flattened()) < 1e-6, "{axes:?}");
        assert_eq!((by_quaternion.origin, by_quaternion.spacing), (header.origin, header.spacing));
        bytes[252] = 0;
        fs::write(&path, &bytes).unwrap();
        let nowhere = VolumeReader::open(&path, &Limits::default()).unwrap().header().clone();
        assert_eq!((nowhere.placed, nowhere.origin), (false, [0.0; 3]));
    }
}

#[test]
fn nifti_of_other_byte_order_and_scaling_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.nii");
    let header = VolumeHeader::new([2, 1, 1], PixelType::I16);
    put(&path, &header);
    let mut bytes = fs::read(&path).unwrap();
    let data = bytes.len() - 4;
    bytes[112..116].copy_from_slice(&0.5_f32.to_ne_bytes());
    bytes[116..120].copy_from_slice(&(-10.0_f32).to_ne_bytes());
    bytes[data..].copy_from_slice([4_i16, -6].map(i16::to_ne_bytes).as_flattened());
    fs::write(&path, &bytes).unwrap();
    let values = |path: &Path| {
        let mut reader = VolumeReader::open(path, &Limits::default()).unwrap();
        assert_eq!(reader.header().pixel, PixelType::F64);
        let slice = reader.next_slice().unwrap().unwrap().to_vec();
        slice.as_chunks::<8>().0.iter().map(|word| f64::from_ne_bytes(*word)).collect::<Vec<_>>()
    };
    assert_eq!(values(&path), [-8.0, -13.0]);
    // Reverses the bytes of every number in the header.
    let words = [
        (0, 4, 1),
        (40, 2, 8),
        (70, 2, 2),
        (76, 4, 8),
        (108, 4, 3),
        (252, 2, 2),
        (256, 4, 6),
        (280, 4, 12),
        (data, 2, 2),
    ];
    for (at, width, count) in words {
        bytes[at..at + width * count].chunks_exact_mut(width).for_each(<[u8]>::reverse);
    }
    fs::write(&path, &bytes).unwrap();
    assert_eq!(values(&path), [-8.0, -13.0]);
    assert_eq!(VolumeReader::open(&path, &Limits::default()).unwrap().header().size, [2, 1, 1]);
}

#[test]
fn damaged_nifti_is_refused_by_field_and_byte() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.nii");
    put(&path, &VolumeHeader::new([3, 2, 2], PixelType::U8));
    let whole = fs::read(&path).unwrap();
    let small = Limits { header_bytes: 4096, frame_bytes: 4096, items: 64, transposed_bytes: 0 };
    let refused = |bytes: &[u8], sentence: &str| {
        fs::write(&path, bytes).unwrap();
        let opened = VolumeReader::open(&path, &small);
        let text = opened.and_then(|mut v| v.next_slice().map(|_| ())).unwrap_err().to_string();
        assert!(
            text.starts_with(&path.display().to_string()) && text.contains(sentence),
            "{text:?} does not say {sentence:?}"
        );
    };
    let with = |at: usize, word: &[u8]| {
        let mut bytes = whole.clone();
        bytes[at..at + word.len()].copy_from_slice(word);
        bytes
    };
    let short = |n: i16| n.to_ne_bytes();
    refused(&whole[..200], "field sizeof_hdr (byte 0)");
    refused(&with(344, b"ni1\0"), "field magic (byte 344): is not n+1");
    refused(&with(40, &short(2)), "field dim (byte 40): is \"2 3 2 2");
    refused(&with(42, &short(-3)), "an axis cannot have -3 voxels");
    refused(&with(40, &[short(4), short(3), short(2), short(2), short(2)].concat()), "several volumes");
    refused(&with(42, &short(i16::MAX)), "the size of one frame");
    refused(&with(46, &short(65)), "the number of frames");
    refused(&with(70, &short(32)), "field datatype (byte 70): is 32");
    refused(&with(108, &100.0_f32.to_ne_bytes()), "field vox_offset (byte 108): is 100");
    refused(&with(108, &f32::NAN.to_ne_bytes()), "field vox_offset");
    refused(&with(108, &1.0e9_f32.to_ne_bytes()), "the header's size in bytes is 1000000000");
    refused(&with(108, &4000.0_f32.to_ne_bytes()), "the file ends after");
    refused(&with(112, &f32::INFINITY.to_ne_bytes()), "not finite");
    refused(&with(280, &f32::NAN.to_ne_bytes()), "field srow (byte 280)");
    refused(&with(280, &[0; 48]), "gives an axis no length");
    refused(&whole[..whole.len() - 1], "promises 12 bytes of pixels, but the file holds 11");
    refused(&[&whole[..], &[0]].concat(), "data follow the last frame");
    refused(&[0x1f, 0x8b, 8, 0], "reading the header failed");
    let wide = VolumeHeader::new([40_000, 1, 1], PixelType::U8);
    let error = VolumeWriter::create(&path, &wide).err();
    assert!(matches!(error, Some(FileError::Unwritable { source: Unwritable::NiftiSize(40_000), .. })));
    let two = VolumeHeader { channels: 2, ..VolumeHeader::new([1; 3], PixelType::U8) };
    let error = VolumeWriter::create(&path, &two).err();
    assert!(matches!(error, Some(FileError::Unwritable { source: Unwritable::NiftiType { channels: 2, .. }, .. })));
}
