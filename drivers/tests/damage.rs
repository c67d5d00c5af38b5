//! Damaged, hostile and contradictory files give a sentence that names file, field and offset.
//! They never cause a panic, nor memory use beyond the limits. Failing writers leave no files
//! behind.

#![allow(clippy::unwrap_used, reason = "a test that cannot be set up has failed")]

use std::fs;
use std::io::Write as _;
use std::path::Path;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use proptest::prelude::*;

use drivers::replay::{Replay, SequenceSettings};
use formats::image::write::{SequenceHeader, SequenceItem, SequenceWriter, VolumeWriter};
use formats::image::{VolumeHeader, VolumeReader};
use formats::{Error as FileError, Limits, Unwritable};
use sonoweave_core::reading::{NamedTransform, PixelType, Reading, Stamp, Status};
use sonoweave_core::{Device, Error, Next};

const EYE: &str = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1";
const SMALL: Limits = Limits { header_bytes: 4096, frame_bytes: 4096, items: 64, transposed_bytes: 16_384 };

/// Returns a recording of three frames of 4×2, with all meaningful fields.
fn recording(compressed: bool) -> Vec<u8> {
    let mut text = format!(
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = {}\nDimSize = 4 2 3\n\
         Kinds = domain domain list\nElementNumberOfChannels = 1\nElementType = MET_USHORT\nUltrasoundImageOrientation = MFA\n",
        if compressed { "True" } else { "False" }
    );
    for frame in 0..3 {
        for (name, value) in [
            ("ProbeToTrackerTransform", EYE),
            ("ProbeToTrackerTransformStatus", "OK"),
            ("Timestamp", "1.5"),
            ("FrameNumber", "7"),
        ] {
            text += &format!("Seq_Frame{frame:04}_{name} = {value}\n");
        }
    }
    let pixels: Vec<u8> = (0..48).collect();
    let data = if compressed { deflated(&pixels) } else { pixels };
    if compressed {
        text += &format!("CompressedDataSize = {}\n", data.len());
    }
    text += "ElementDataFile = LOCAL\n";
    [text.as_bytes(), &data].concat()
}

fn deflated(pixels: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(pixels).unwrap();
    encoder.finish().unwrap()
}

/// Reads everything: the frames' pixels until the end or the first error.
fn read(path: &Path, limits: Limits) -> (Vec<Vec<u8>>, Result<(), Error>) {
    let mut frames = Vec::new();
    let mut device = match Replay::open(&SequenceSettings { limits, ..SequenceSettings::new(path) }) {
        Ok(device) => device,
        Err(error) => return (frames, Err(error.into())),
    };
    if let Err(error) = device.start() {
        return (frames, Err(error));
    }
    loop {
        match device.next(sonoweave_core::NO_DEADLINE) {
            Ok(Next::Reading(Reading::Frame(frame))) => frames.push(frame.pixels.to_vec()),
            Ok(Next::Reading(_)) => {}
            Ok(Next::Pending) => panic!("a file never waits"),
            Ok(Next::End) => return (frames, Ok(())),
            Err(error) => {
                let after = device.next(sonoweave_core::NO_DEADLINE);
                assert!(matches!(after, Err(Error::Failed(_))), "no reading follows an error: {after:?}");
                return (frames, Err(error));
            }
        }
    }
}

fn in_file<T>(bytes: &[u8], then: impl FnOnce(&Path) -> T) -> T {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bad.igs.mha");
    fs::write(&path, bytes).unwrap();
    then(&path)
}

fn sentence(bytes: &[u8], limits: Limits) -> String {
    in_file(bytes, |path| {
        let text = read(path, limits).1.expect_err("the file is damaged").to_string();
        assert!(text.starts_with(&path.display().to_string()), "{text}");
        text
    })
}

fn replaced(compressed: bool, from: &str, to: &str) -> Vec<u8> {
    let whole = recording(compressed);
    let at = whole.windows(from.len()).position(|window| window == from.as_bytes()).unwrap();
    [&whole[..at], to.as_bytes(), &whole[at + from.len()..]].concat()
}

fn offset(compressed: bool, field: &str) -> usize {
    let whole = recording(compressed);
    whole.windows(field.len()).position(|window| window == field.as_bytes()).unwrap()
}

#[test]
fn refusal_names_file_field_offset_and_remedy() {
    let cases = [
        (EYE, "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0", "Seq_Frame0000_ProbeToTrackerTransform", "holds 15 numbers"),
        (EYE, "1 0 0 0 0 one 0 0 0 0 1 0 0 0 0 1", "Seq_Frame0000_ProbeToTrackerTransform", "\"one\", number 6 of 16"),
        ("= 1.5", "= nan", "Seq_Frame0000_Timestamp", "finite"),
        ("= 1.5", "= noon", "Seq_Frame0000_Timestamp", "number of seconds"),
        ("DimSize = 4 2 3", "DimSize = 4 2 0", "DimSize", "no frames"),
        ("DimSize = 4 2 3", "DimSize = 4 2 -3", "DimSize", "negative"),
        ("DimSize = 4 2 3", "DimSize = 4 2 2", "DimSize", "data follow the last frame"),
        ("DimSize = 4 2 3", "DimSize = 4 2 4", "DimSize", "cut short"),
        ("NDims = 3", "NDims = 4", "NDims", "sequences of volumes"),
        ("domain domain list", "list domain domain", "Kinds", "must be the last"),
        ("UltrasoundImageOrientation = MFA", "NDims = 3", "NDims", "repeats the field"),
        ("ElementDataFile = LOCAL", "ElementDataFile = a.raw", "ElementDataFile", "which does not exist"),
        ("ElementDataFile = LOCAL", "ElementDataFile = ../a.raw", "ElementDataFile", "must lie beside the header"),
        ("ElementDataFile = LOCAL", "ElementDataFile = /etc/passwd", "ElementDataFile", "must lie beside the header"),
        ("ElementDataFile = LOCAL", "ElementDataFile = LIST", "ElementDataFile", "several files"),
        ("ElementDataFile = LOCAL", "ElementDataFile = a%03d.raw 1 3 1", "ElementDataFile", "several files"),
        ("Seq_Frame0001_Tim", "Seq_Frame0000_Tim", "Seq_Frame0000_Timestamp", "repeats the field"),
    ];
    for (from, to, field, key) in cases {
        let text = sentence(&replaced(false, from, to), SMALL);
        assert!(text.contains(&format!(": field {field} (byte ")) && text.contains(key), "{text}");
    }
    let fifteen = sentence(&replaced(false, EYE, "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0"), SMALL);
    assert!(fifteen.contains(&format!("(byte {})", offset(false, "Seq_Frame0000_Probe"))), "{fifteen}");
    let volume = sentence(&replaced(false, "domain domain list", "domain domain domain"), SMALL);
    assert!(volume.contains(&format!("field Kinds (byte {})", offset(false, "Kinds"))), "{volume}");
}

#[test]
fn claims_beyond_limits_are_refused_before_allocation() {
    let cases = [
        ("DimSize = 100000 100000 10", "size of one frame in bytes is 20000000000, more than the limit of 4096"),
        ("DimSize = 4 2 1000000000000000", "number of frames is 1000000000000000, more than the limit of 64"),
        ("DimSize = 4294967296 4294967296 1", "size of one frame in bytes"),
    ];
    for (to, key) in cases {
        let text = sentence(&replaced(true, "DimSize = 4 2 3", to), SMALL);
        assert!(
            text.contains(&format!("field DimSize (byte {})", offset(true, "DimSize"))) && text.contains(key),
            "{text}"
        );
    }
    let header = Limits { header_bytes: 100, ..SMALL };
    assert!(
        sentence(&recording(false), header).contains("the header's size in bytes is 101, more than the limit of 100")
    );
    // Within the default limits, but a few bytes cannot hold a gigabyte.
    let text = sentence(&replaced(true, "DimSize = 4 2 3", "DimSize = 4096 8192 16"), Limits::default());
    assert!(text.contains("compressed bytes of data in the file can hold"), "{text}");
}

#[test]
fn decompression_bomb_is_not_inflated() {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    for _ in 0..256 {
        encoder.write_all(&vec![0; 1 << 20]).unwrap();
    }
    let bomb = encoder.finish().unwrap();
    let text = "NDims = 3\nDimSize = 4 2 3\nKinds = domain domain list\nElementType = MET_UCHAR\nCompressedData = True\n\
                ElementDataFile = LOCAL\n";
    in_file(&[text.as_bytes(), &bomb].concat(), |path| {
        let (frames, outcome) = read(path, SMALL);
        assert_eq!(
            frames,
            [vec![0; 8], vec![0; 8]],
            "the last frame is not delivered: the stream is not what was promised"
        );
        let error = outcome.unwrap_err();
        assert!(error.to_string().contains("more pixels follow the last frame"), "{error}");
        let Some(FileError::Data { frame: 2, offset, .. }) = error.cause() else { panic!("{error}") };
        let consumed = offset - text.len() as u64;
        assert!(consumed < 1 << 16, "{consumed} bytes of the bomb were inflated");
    });
}

#[test]
fn cut_file_gives_valid_frames_then_error() {
    for compressed in [false, true] {
        let whole = recording(compressed);
        let pixels: Vec<u8> = (0..48).collect();
        for cut in 0..whole.len() {
            in_file(&whole[..cut], |path| {
                let (frames, outcome) = read(path, SMALL);
                assert!(outcome.is_err(), "cut at {cut}");
                assert!(pixels.starts_with(&frames.concat()), "cut at {cut}");
            });
        }
        in_file(&whole, |path| assert!(read(path, SMALL).1.is_ok()));
    }
}

#[test]
fn damaged_compressed_stream_is_refused_with_frame() {
    let mut whole = recording(true);
    let last = whole.len() - 1;
    whole[last] ^= 0x40;
    let text = sentence(&whole, SMALL);
    assert!(text.contains("pixel data of frame 2 (byte ") && text.contains("damaged"), "{text}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn flipped_bits_never_panic_nor_exceed_the_limits(
        compressed: bool,
        flips in prop::collection::vec((any::<prop::sample::Index>(), 0..8_u32), 1..6),
    ) {
        let mut bytes = recording(compressed);
        for (at, bit) in flips {
            let at = at.index(bytes.len());
            bytes[at] ^= 1 << bit;
        }
        in_file(&bytes, |path| {
            let (frames, outcome) = read(path, SMALL);
            assert!(frames.len() as u64 <= SMALL.items);
            assert!(frames.iter().all(|frame| frame.len() as u64 <= SMALL.frame_bytes));
            if let Err(error) = outcome {
                assert!(error.to_string().contains("bad.igs.mha"), "{error}");
            }
            let _ = VolumeReader::open(path, &SMALL).map(|mut volume| while let Ok(Some(_)) = volume.next_slice() {});
        });
    }

    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        in_file(&bytes, |path| assert!(read(path, SMALL).1.is_err()));
    }
}

/// Returns the reason why a file cannot be written.
fn unwritable(written: Result<(), FileError>) -> Unwritable {
    match written {
        Err(FileError::Unwritable { source, .. }) => source,
        other => panic!("{other:?}"),
    }
}

fn one_frame(path: &Path) -> (SequenceHeader, Result<SequenceWriter, FileError>) {
    let header = SequenceHeader {
        size: [4, 2],
        pixel: PixelType::U8,
        channels: 1,
        orientation: "MFA".into(),
        image_type: String::new(),
        compressed: true,
        fields: Vec::new(),
        items: vec![SequenceItem {
            stamp: Stamp::default(),
            frame_number: None,
            status: Status::Ok,
            transforms: Vec::new(),
            fields: Vec::new(),
        }],
    };
    let writer = SequenceWriter::create(path, &header);
    (header, writer)
}

#[test]
fn unfinished_file_leaves_target_unchanged() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mha");
    fs::write(&path, "before").unwrap();
    let entries = || fs::read_dir(folder.path()).unwrap().count();
    let unchanged = || entries() == 1 && fs::read(&path).unwrap() == b"before";

    let mut dropped = one_frame(&path).1.unwrap();
    dropped.write_frame(&[0; 8]).unwrap();
    assert_eq!(entries(), 2, "the pixels go to a file of their own");
    drop(dropped);
    assert!(unchanged());

    let error = one_frame(&path).1.unwrap().finish();
    assert!(matches!(unwritable(error), Unwritable::Unfinished { written: 0, expected: 8 }));
    assert!(unchanged());

    let mut long = one_frame(&path).1.unwrap();
    assert!(matches!(unwritable(long.write_frame(&[0; 7])), Unwritable::FrameSize { given: 7, expected: 8 }));
    long.write_frame(&[0; 8]).unwrap();
    let error = long.write_frame(&[0; 8]).unwrap_err();
    assert!(
        matches!(&error, FileError::Io { source, .. } if source.to_string().contains("than the 8 bytes")),
        "{error}"
    );
    drop(long);
    assert!(unchanged());

    let mut volume = VolumeWriter::create(&path, &VolumeHeader::new([2, 2, 2], PixelType::U8)).unwrap();
    volume.write_all(&[0; 7]).unwrap();
    assert!(volume.write_all(&[0; 2]).is_err());
    assert!(volume.finish().is_err());
    assert!(unchanged());

    let none = folder.path().join("none").join("s.mha");
    assert!(matches!(one_frame(&none).1, Err(FileError::Io { .. })));
}

#[cfg(unix)]
#[test]
fn written_file_has_default_permissions() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mha");
    let mut writer = one_frame(&path).1.unwrap();
    writer.write_frame(&[0; 8]).unwrap();
    writer.finish().unwrap();
    let ordinary = folder.path().join("ordinary");
    fs::write(&ordinary, "").unwrap();
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(&path), mode(&ordinary));
}

#[test]
fn header_without_roundtrip_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mha");
    let refused = |change: &dyn Fn(&mut SequenceHeader)| {
        let mut header = one_frame(&path).0;
        change(&mut header);
        unwritable(SequenceWriter::create(&path, &header).map(drop))
    };
    let unreadable = |change: &dyn Fn(&mut SequenceHeader), key: &str| match refused(change) {
        Unwritable::Header(problem) => assert!(problem.contains(key), "{problem}"),
        other => panic!("{other}"),
    };
    let field = |name: &str, value: &str| (name.to_owned(), value.to_owned());
    let transform = |from: &str, to: &str, status| NamedTransform {
        stamp: Stamp::default(),
        from: from.into(),
        to: to.into(),
        matrix: [0.0; 16],
        status,
    };
    use Unwritable::{
        Channels, EmptySequence, FieldName, FieldTwice, FieldValue, FrameNames, Meaning, Place, Status as Word, Time,
    };
    assert!(matches!(refused(&|h| h.items.clear()), EmptySequence));
    assert!(matches!(refused(&|h| h.size = [4, 0]), EmptySequence));
    assert!(matches!(refused(&|h| h.channels = 5), Channels(5)));
    let lines = "M\nElementDataFile = x";
    assert!(matches!(refused(&|h| h.orientation = lines.into()), FieldValue { value, .. } if value == lines));
    assert!(matches!(refused(&|h| h.fields.push(field("A", "x\ny"))), FieldValue { name, .. } if name == "A"));
    assert!(matches!(refused(&|h| h.fields.push(field("A=B", "x"))), FieldName { reserved: '=', .. }));
    assert!(matches!(refused(&|h| h.fields.push(field("", "x"))), FieldName { .. }));
    assert!(matches!(refused(&|h| h.fields.push(field("DimSize", "1 1 1"))), FieldTwice(_)));
    assert!(matches!(refused(&|h| h.fields.push(field("UltrasoundImageOrientation", "UN"))), FieldTwice(_)));
    assert!(matches!(refused(&|h| h.fields.extend([field("A", "1"), field("A", "2")])), FieldTwice(_)));
    unreadable(&|h| h.items[0].fields.push(field("ImageStatus", "OK")), "repeats the field");
    unreadable(&|h| h.items[0].fields.extend([field("A", "1"), field("A", "2")]), "repeats the field");
    unreadable(&|h| h.items[0].fields.push(field("Timestamp", "soon")), "field Seq_Frame0000_Timestamp: is \"soon\"");
    unreadable(&|h| h.items[0].fields.push(field("Note", &"x".repeat(2 << 20))), "is longer than");
    assert!(matches!(refused(&|h| h.items[0].fields.push(field("Timestamp", "1"))), Meaning(0)));
    assert!(matches!(refused(&|h| h.items[0].fields.push(field("AToB", &["1"; 16].join(" ")))), Meaning(0)));
    assert!(matches!(refused(&|h| h.items[0].stamp.source_s = Some(f64::NAN)), Time { name: "Timestamp", .. }));
    assert!(matches!(refused(&|h| h.items[0].status = Status::Other("ok".into())), Word(_)));
    for (from, to) in [("Probe", "tracker"), ("HeadToToe", "Tracker")] {
        let error = refused(&|h| h.items[0].transforms.push(transform(from, to, Status::Ok)));
        assert!(matches!(error, FrameNames { .. }), "{error}");
    }
    let bad = VolumeHeader { spacing: [1.0, 0.0, 1.0], ..VolumeHeader::new([1, 1, 1], PixelType::U8) };
    assert!(matches!(unwritable(VolumeWriter::create(&path, &bad).map(drop)), Place));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}
