//! NRRD through the public interface: files of other programs are read, or refused with the
//! fault.

#![allow(clippy::unwrap_used, reason = "a test that cannot be set up has failed")]

use std::fs;
use std::io::{Read as _, Write as _};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use flate2::Compression;
use flate2::write::GzEncoder;
use proptest::prelude::*;

use drivers::replay::{Progress, Replay, SequenceSettings};
use formats::Limits;
use formats::image::write::VolumeWriter;
use formats::image::{About, Content, VolumeHeader, VolumeReader};
use sonoweave_core::reading::{Frame, PixelType, Reading, Status};
use sonoweave_core::{Device, Error, Next};

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn read(settings: &SequenceSettings) -> Result<Vec<Reading>, Error> {
    let mut device = Replay::open(settings)?;
    device.start()?;
    let mut readings = Vec::new();
    while let Next::Reading(reading) = device.next(sonoweave_core::NO_DEADLINE)? {
        readings.push(reading);
    }
    Ok(readings)
}

fn frames(path: &Path) -> Result<Vec<Frame>, Error> {
    let only = |reading| if let Reading::Frame(frame) = reading { Some(frame) } else { None };
    Ok(read(&SequenceSettings::new(path))?.into_iter().filter_map(only).collect())
}

/// Writes a file with that header and data into a new folder, and passes its path to `then`.
fn of<T>(header: &str, data: &[u8], then: impl FnOnce(&Path) -> T) -> T {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.nrrd");
    fs::write(&path, [header.as_bytes(), data].concat()).unwrap();
    then(&path)
}

fn refused(header: &str, data: &[u8]) -> String {
    of(header, data, |path| {
        let volume = || VolumeReader::open(path, &Limits::default()).err().map(Error::from);
        let text = read(&SequenceSettings::new(path)).err().or_else(volume).expect("it is wrong").to_string();
        assert!(text.starts_with(&path.display().to_string()), "{text}");
        text
    })
}

/// Two frames of 3×2 of 16 bits.
const HEAD: &str =
    "NRRD0004\ntype: ushort\ndimension: 3\nsizes: 3 2 2\nkinds: domain domain list\nendian: big\nencoding: raw\n";

/// Pixel values, by frame.
const VALUES: [[u16; 6]; 2] = [[1, 2, 3, 256, 5, 6], [7, 8, 9, 10, 11, 65535]];

fn big(values: impl IntoIterator<Item = u16>) -> Vec<u8> {
    values.into_iter().flat_map(u16::to_be_bytes).collect()
}

fn native(values: &[u16]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_ne_bytes()).collect()
}

fn check(path: &Path) {
    let frames = frames(path).unwrap();
    assert_eq!(frames.len(), 2);
    for (frame, values) in frames.iter().zip(&VALUES) {
        assert_eq!((frame.size, frame.channels, frame.pixel), ([3, 2], 1, PixelType::U16));
        assert_eq!(*frame.pixels, native(values));
    }
}

#[test]
fn every_encoding_gives_same_pixels() {
    let data = big(VALUES.concat());
    of(&format!("{HEAD}\n"), &data, check);
    of(&format!("{}\n", HEAD.replace("raw", "gzip")), &gzip(&data), check);
    let members = [gzip(&data[..7]), gzip(&data[7..]), gzip(&[])].concat();
    of(&format!("{}\n", HEAD.replace("raw", "gz")), &members, check);
    let text = VALUES.concat().iter().map(u16::to_string).collect::<Vec<_>>().join("\n");
    for encoding in ["ascii", "text", "txt"] {
        of(&format!("{}\n", HEAD.replace("raw", encoding)), text.as_bytes(), check);
    }
    of(&format!("{HEAD}byte skip: -1\n\n"), &[&[9; 5][..], &data].concat(), check);
    of(&format!("{HEAD}line skip: 2\nbyteskip: 3\n\n"), &[b"a\nbc\nxyz", &data[..]].concat(), check);
    of(&format!("{}byte skip: 5000\n\n", HEAD.replace("raw", "gzip")), &gzip(&[&[9; 5000][..], &data].concat()), check);
}

#[test]
fn data_in_file_beside_header_is_read() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("pixels")).unwrap();
    let path = folder.path().join("a.nhdr");
    let data = big(VALUES.concat());
    for (name, encoding, bytes) in [
        ("a.raw", "raw", data.clone()),
        ("./pixels/a.raw.gz", "gzip", gzip(&data)),
        ("pixels/b.raw", "raw", data.clone()),
    ] {
        fs::write(folder.path().join(name), bytes).unwrap();
        fs::write(&path, format!("{}data file: {name}\n", HEAD.replace("raw", encoding))).unwrap();
        check(&path);
    }
    let refused = |name: &str, bytes: Option<&[u8]>, expected: &str| {
        let data = folder.path().join("c.raw");
        if let Some(bytes) = bytes {
            fs::write(&data, bytes).unwrap();
        }
        fs::write(&path, format!("{HEAD}datafile: {name}\n")).unwrap();
        let text = frames(&path).err().unwrap().to_string();
        assert!(text.starts_with(&path.display().to_string()) && text.contains(expected), "{text}");
    };
    refused("none.raw", None, "field data file (byte 100): names the data file");
    refused("../a.raw", None, "must lie beside the header");
    refused("/etc/passwd", None, "must lie beside the header");
    refused("", None, "must lie beside the header");
    refused("c.raw", Some(&data[..23]), "promises 24 bytes of pixels, but its data file c.raw holds 23");
    refused("c.raw", Some(&[&data[..], &[0]].concat()), "its data file c.raw holds 25: data follow the last frame");
    let folder_as_data = frames(&{
        fs::write(&path, format!("{HEAD}data file: pixels\n")).unwrap();
        path.clone()
    });
    assert!(folder_as_data.err().unwrap().to_string().contains("not a regular file"));
}

#[test]
fn list_on_first_axis_is_transposed_within_limit() {
    // Frames interleaved pixel by pixel.
    let data: Vec<u16> = (0..6).flat_map(|pixel| VALUES.map(|frame| frame[pixel])).collect();
    let head = HEAD.replace("3 2 2", "2 3 2").replace("domain domain list", "list domain domain");
    of(&format!("{head}\n"), &big(data.clone()), check);
    of(&format!("{}\n", head.replace("raw", "gzip")), &gzip(&big(data.clone())), check);
    let slicer = head
        .replace("dimension: 3", "dimension: 4")
        .replace("2 3 2", "2 3 2 1")
        .replace("list domain domain", "list domain domain domain");
    of(&format!("{slicer}\n"), &big(data.clone()), |path| {
        check(path);
        let progress = Arc::new(AtomicU64::new(0));
        let count = Arc::clone(&progress);
        let report = move |done, of| {
            assert_eq!((done, of), (count.fetch_add(1, Ordering::Relaxed) + 1, 2));
        };
        read(&SequenceSettings { progress: Progress(Some(Arc::new(report))), ..SequenceSettings::new(path) }).unwrap();
        assert_eq!(progress.load(Ordering::Relaxed), 2, "told row by row");
        let limits = Limits { transposed_bytes: 23, ..Limits::default() };
        let error = read(&SequenceSettings { limits, ..SequenceSettings::new(path) }).unwrap_err();
        let limit = error.cause();
        assert!(matches!(limit, Some(formats::Error::Limit { value: 24, limit: 23, .. })), "{error}");
        assert!(error.to_string().contains("field sizes (byte 35): the list of frames is the first axis"), "{error}");
    });
    // Also with channels before the list, and larger than one transposed block.
    let (frames_of, width, height) = (70_usize, 130_usize, 3_usize);
    let value = |frame: usize, x: usize, y: usize, c: usize| (frame * 7 + x * 3 + y * 31 + c * 101) as u8;
    let mut data = Vec::new();
    for y in 0..height {
        for x in 0..width {
            for frame in 0..frames_of {
                data.extend((0..2).map(|c| value(frame, x, y, c)));
            }
        }
    }
    let head =
        "NRRD0004\ntype: uchar\ndimension: 4\nsizes: 2 70 130 3\nkinds: vector list domain domain\nencoding: raw\n\n";
    of(head, &data, |path| {
        let frames = frames(path).unwrap();
        assert_eq!(frames.len(), frames_of);
        for (n, frame) in frames.iter().enumerate() {
            assert_eq!((frame.size, frame.channels), ([130, 3], 2));
            let at = |i: usize| value(n, i / 2 % width, i / 2 / width, i % 2);
            assert!(frame.pixels.iter().enumerate().all(|(i, pixel)| *pixel == at(i)), "frame {n}");
        }
    });
}

#[test]
fn items_get_axis_times_and_key_fields() {
    let slicer = "NRRD0005\ntype: unsigned char\ndimension: 4\nspace: left-posterior-superior\nsizes: 1 1 1 3\n\
                  space directions: (1,0,0) (0,1,0) (0,0,1) none\nkinds: domain domain domain list\nlabels: \"\" \"\" \"\" \"time\"\n\
                  units: \"\" \"\" \"\" \"ms\"\nencoding: raw\nspace origin: (0,0,0)\nDataNodeClassName:=vtkMRMLScalarVolumeNode\n\
                  axis 3 index type:=numeric\naxis 3 index values:=500 533.5 600\naxis 3 item 1 Note:=here\naxis 3 item 0 Note:=\n\
                  axis 3 item 2 Note:=\nOperator:=B.\n\n";
    of(slicer, b"abc", |path| {
        let got = frames(path).unwrap();
        let times: Vec<_> = got.iter().map(|frame| frame.stamp.source_s.unwrap()).collect();
        assert_eq!(times, [0.5, 0.5335, 0.6]);
        assert_eq!(got[1].fields, [("Note".to_owned(), "here".to_owned())]);
        assert_eq!(&*got[2].pixels, b"c");
        let device = Replay::open(&SequenceSettings::new(path)).unwrap();
        assert_eq!(device.describe().fields, [("Operator".to_owned(), "B.".to_owned())]);
    });
    let by_order = slicer.replace("\"time\"", "\"frame\"");
    of(&by_order, b"abc", |path| assert_eq!(frames(path).unwrap()[2].stamp.source_s, None, "an order is no time"));
    let few = refused(&slicer.replace("500 533.5 600", "500 600"), b"abc");
    assert!(few.contains("holds 2 times"), "{few}");
    let odd = refused(&slicer.replace("533.5", "soon"), b"abc");
    assert!(odd.contains("\"soon\"; each time must be a finite number"), "{odd}");
}

#[test]
fn file_without_images_is_read() {
    let eye = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1";
    let head = format!(
        "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 0 0 2\nkinds: domain domain list\n\
         Seq_Frame0000_ProbeToTrackerTransform:={eye}\nSeq_Frame0001_ProbeToTrackerTransform:={eye}\n\
         Seq_Frame0001_ProbeToTrackerTransformStatus:=INVALID\n\n"
    );
    of(&head, &[], |path| {
        let readings = read(&SequenceSettings::new(path)).unwrap();
        assert_eq!(readings.len(), 4);
        let Reading::NamedTransform(second) = &readings[2] else { panic!("{:?}", readings[2]) };
        assert_eq!(
            (&*second.from, &*second.to, &second.status),
            ("Probe", "Tracker", &Status::Other("INVALID".into()))
        );
        assert_eq!(Replay::open(&SequenceSettings::new(path)).unwrap().describe().image_size, None);
    });
}

#[test]
fn kinds_select_colour_image_or_volume() {
    let head = |dimension: u32, sizes: &str, kinds: &str| {
        format!("NRRD0001\ntype: uint8\ndimension: {dimension}\nsizes: {sizes}\nkinds: {kinds}\nencoding: raw\n\n")
    };
    for (kind, channels) in [("vector", 2), ("RGB-color", 3), ("RGBA-color", 4), ("3-color", 3), ("scalar", 1)] {
        of(&head(3, &format!("{channels} 2 1"), &format!("{kind} domain domain")), &vec![7; 2 * channels], |path| {
            let got = frames(path).unwrap();
            assert_eq!((got.len(), got[0].channels, got[0].size), (1, channels as u32, [2, 1]));
        });
    }
    of(&head(3, "2 1 3", "space space space"), b"abcdef", |path| {
        assert_eq!(About::read(path, &Limits::default()).unwrap().content, Content::Volume);
        let mut volume = VolumeReader::open(path, &Limits::default()).unwrap();
        assert_eq!(volume.header().size, [2, 1, 3]);
        assert_eq!(volume.next_slice().unwrap().unwrap(), b"ab");
    });
    of(&head(4, "3 2 1 1", "RGB-color domain domain domain"), b"abcdef", |path| {
        assert_eq!(VolumeReader::open(path, &Limits::default()).unwrap().header().channels, 3);
    });
}

#[test]
fn unsupported_files_are_refused_by_field_and_byte() {
    let with = |from: &str, to: &str| format!("{}\n", HEAD.replace(from, to));
    let data = big(VALUES.concat());
    for (header, expected) in [
        (
            with("domain domain list", "domain list domain"),
            "field kinds (byte 48): is \"domain list domain\": the list of frames lies between",
        ),
        (with("domain domain list", "list domain list"), "only one axis can be the list"),
        (with("domain domain list", "domain vector list"), "channels must be the first axis"),
        (with("domain domain list", "domain 3D-matrix list"), "which images do not have"),
        (with("domain domain list", "domain list"), "exactly 3 words"),
        (with("dimension: 3", "dimension: 17"), "field dimension (byte 22): is 17"),
        (with("dimension: 3\n", ""), "field dimension"),
        (with("3 2 2", "3 2"), "field sizes (byte 35): is \"3 2\", but dimension requires exactly 3"),
        (with("3 2 2", "3 2 0"), "no frames"),
        (with("3 2 2", "3 2 -2"), "negative"),
        (with("3 2 2", "3 2 3"), "promises 36 bytes of pixels, but the file holds 24 after its header"),
        (with("3 2 2", "99999999 99999999 2"), "the size of one frame"),
        (with("3 2 2", "3 2 99999999999"), "the number of frames"),
        (with("raw", "bzip2"), "field encoding (byte 86): is bzip2, which is not supported"),
        (with("raw", "hex"), "is hex, which is not supported"),
        (with("raw", "zip"), "not an encoding"),
        (with("encoding: raw\n", ""), "field encoding"),
        (with("endian: big\n", ""), "field endian"),
        (with("big", "middle"), "write little or big"),
        (with("ushort", "block"), "field type (byte 9): is \"block\", which is not a supported pixel type"),
        (format!("{HEAD}byte skip: -2\n\n"), "field byte skip (byte 100): -2 is negative"),
        (format!("{HEAD}byte skip: 25\n\n"), "skips 25 bytes"),
        (format!("{HEAD}line skip: 3\n\n"), "line 2 of the 3 to be skipped"),
        (format!("{}byte skip: -1\n\n", HEAD.replace("raw", "gzip")), "supported for raw data only"),
        (format!("{}byte skip: 900\n\n", HEAD.replace("raw", "ascii")), "more than the"),
        (
            with("dimension: 3", "dimension: 4")
                .replace("3 2 2", "3 2 2 1")
                .replace("domain list", "domain domain list"),
            "sequence of volumes",
        ),
        (
            with("dimension: 3", "dimension: 1").replace("3 2 2", "3").replace("domain domain list", "domain"),
            "has 1 axes in space",
        ),
    ] {
        let text = refused(&header, &data);
        assert!(text.contains(expected), "{text:?} does not say {expected:?}");
    }
    let bomb = gzip(&vec![0; 1 << 20]);
    let text = refused(&with("raw", "gzip"), &bomb);
    assert!(text.contains("more pixels follow the last frame"), "{text}");
    let cut = gzip(&data);
    let text = refused(&with("raw", "gzip"), &cut[..cut.len() - 9]);
    assert!(text.contains("frame 1") && text.contains("ends within the compressed data"), "{text}");
    let text = refused(&with("raw", "ascii"), b"1 2 3 256 5 6 7 8 9 10 11 65536");
    assert!(text.contains("\"65536\" is not a value of U16"), "{text}");
    let text = refused(&with("raw", "ascii"), b"1 2 3 256 5 6 7 8 9 10 11 65535 1");
    assert!(text.contains("more numbers follow"), "{text}");
}

/// Returns an intact file, in which the test flips bits.
fn whole(choice: usize) -> Vec<u8> {
    let data = big(VALUES.concat());
    let keys = "axis 2 item 0 Note:=a\\nb\nSeq_Frame0000_AToBTransform:=1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\naxis 2 item 1 Note:=\n\n";
    match choice {
        0 => [format!("{HEAD}{keys}").as_bytes(), &data].concat(),
        1 => [
            format!("{}byte skip: 2\n{keys}", HEAD.replace("raw", "gzip")).as_bytes(),
            &gzip(&[b"ab", &data[..]].concat()),
        ]
        .concat(),
        2 => [format!("{}{keys}", HEAD.replace("raw", "ascii")).as_bytes(), b"1 2 3 4 5 6 7 8 9 10 11 12"].concat(),
        3 => [
            HEAD.replace("3 2 2", "2 3 2").replace("domain domain list", "list domain domain").as_bytes(),
            b"byte skip: -1\n\n",
            &data,
        ]
        .concat(),
        4 => [
            HEAD.replace("list", "domain").as_bytes(),
            b"space: RAS\nspace directions: (1,0,0) (0,2,0) (0,0,3)\n\n",
            &data,
        ]
        .concat(),
        _ => {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("v.nii.gz");
            let fields = vec![("Kernel".to_owned(), "gaussian".to_owned())];
            let header = VolumeHeader { fields, ..VolumeHeader::new([3, 2, 2], PixelType::U16) };
            let mut writer = VolumeWriter::create(&path, &header).unwrap();
            writer.write_all(&data).unwrap();
            writer.finish().unwrap();
            let packed = fs::read(&path).unwrap();
            if choice == 5 {
                return packed;
            }
            let mut plain = Vec::new();
            flate2::read::GzDecoder::new(&packed[..]).read_to_end(&mut plain).unwrap();
            plain
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 600, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn flipped_bits_never_panic_nor_exceed_the_limits(
        choice in 0..7_usize,
        flips in prop::collection::vec((any::<prop::sample::Index>(), 0..8_u32), 1..6),
    ) {
        let mut bytes = whole(choice);
        for (at, bit) in flips {
            let at = at.index(bytes.len());
            bytes[at] ^= 1 << bit;
        }
        let limits = Limits { header_bytes: 4096, frame_bytes: 4096, items: 64, transposed_bytes: 4096 };
        of("", &bytes, |path| {
            let expected = |error: Error| assert!(error.to_string().contains("a.nrrd"), "{error}");
            match read(&SequenceSettings { limits, ..SequenceSettings::new(path) }) {
                Ok(readings) => assert!(readings.len() as u64 <= 4 * limits.items),
                Err(error) => expected(error),
            }
            match VolumeReader::open(path, &limits) {
                Ok(mut volume) => loop {
                    match volume.next_slice() {
                        Ok(Some(slice)) => assert!(slice.len() as u64 <= 8 * limits.frame_bytes),
                        Ok(None) => break,
                        Err(error) => {
                            expected(error.into());
                            break;
                        }
                    }
                },
                Err(error) => expected(error.into()),
            }
        });
    }
}
