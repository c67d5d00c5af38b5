//! MetaImage through the public interface: written files read back the same, unusual but valid
//! files are read, and the replay device keeps its contract.

#![allow(clippy::unwrap_used, reason = "a test that cannot be set up has failed")]

use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::sync::Arc;

use drivers::OpenSettings;
use drivers::replay::{Pace, Replay, SequenceSettings};
use formats::Limits;
use formats::image::write::{SequenceHeader, SequenceItem, SequenceWriter, VolumeWriter};
use formats::image::{About, Content, VolumeHeader, VolumeReader, content};
use sonoweave_core::clock::{Clock, MS, Monotonic};
use sonoweave_core::reading::{Frame, NamedTransform, PixelType, Reading, Stamp, Status};
use sonoweave_core::{Device, Error, Next};

const EYE: [f64; 16] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
const EYE_TEXT: &str = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1";

/// Reads all remaining readings of a started device.
fn drain(device: &mut dyn Device) -> Result<Vec<Reading>, Error> {
    let mut readings = Vec::new();
    loop {
        match device.next(sonoweave_core::NO_DEADLINE)? {
            Next::Reading(reading) => readings.push(reading),
            Next::End => return Ok(readings),
            Next::Pending => panic!("a file never waits"),
        }
    }
}

fn replay(path: &Path) -> Result<Vec<Reading>, Error> {
    let mut device = drivers::open(&OpenSettings::sequence(path))?;
    device.start()?;
    drain(&mut *device)
}

fn frames(readings: &[Reading]) -> Vec<&Frame> {
    readings.iter().filter_map(|r| if let Reading::Frame(frame) = r { Some(frame) } else { None }).collect()
}

fn transforms(readings: &[Reading]) -> Vec<&NamedTransform> {
    readings.iter().filter_map(|r| if let Reading::NamedTransform(t) = r { Some(t) } else { None }).collect()
}

fn noise(bytes: usize) -> Vec<u8> {
    let mut state = 12_345_u32;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    (0..bytes).map(|_| next()).collect()
}

/// Returns two frames of 5×3, the second with unusual values everywhere.
fn sample(pixel: PixelType, channels: u32, compressed: bool) -> SequenceHeader {
    let transform = |from: &str, to: &str, matrix, status| NamedTransform {
        stamp: Stamp::default(),
        from: from.into(),
        to: to.into(),
        matrix,
        status,
    };
    let mut odd = EYE;
    odd[3] = -1.0e-300;
    odd[7] = 0.1 + 0.2;
    odd[11] = 1.0e17;
    odd[5] = f64::NAN;
    odd[6] = f64::NEG_INFINITY;
    let item = |number, source_s, transforms, status| SequenceItem {
        stamp: Stamp { source_s, unfiltered_s: source_s.map(|s: f64| s - 0.01), ..Stamp::default() },
        frame_number: number,
        status,
        transforms,
        fields: vec![("Note".into(), "left = right".into())],
    };
    SequenceHeader {
        size: [5, 3],
        pixel,
        channels,
        orientation: "UN".into(),
        image_type: "BRIGHTNESS".into(),
        compressed,
        fields: vec![("Operator".into(), "B. März".into()), ("Site".into(), String::new())],
        items: vec![
            item(Some(41), Some(215.102_186), vec![transform("Torso", "Tracker", EYE, Status::Ok)], Status::Ok),
            item(
                None,
                Some(215.2),
                vec![
                    transform("Probe", "Tracker", odd, Status::Other("MISSING".into())),
                    transform("Stylus", "", EYE, Status::Ok),
                ],
                Status::Other("INVALID".into()),
            ),
        ],
    }
}

fn bits(matrix: &[f64; 16]) -> [u64; 16] {
    matrix.map(|v| if v.is_nan() { f64::NAN.to_bits() } else { v.to_bits() })
}

fn write(path: &Path, header: &SequenceHeader, pixels: &[u8]) {
    let mut writer = SequenceWriter::create(path, header).unwrap();
    for frame in pixels.chunks(pixels.len() / header.items.len()) {
        writer.write_frame(frame).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn sequence_roundtrips_for_every_type_and_packing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.igs.mha");
    for pixel in PixelType::ALL {
        for (channels, compressed) in [(1, false), (3, true)] {
            let header = sample(pixel, channels, compressed);
            let pixels = noise(2 * 5 * 3 * pixel.bytes() * channels as usize);
            write(&path, &header, &pixels);
            let readings = replay(&path).unwrap();
            let order: Vec<_> = readings.iter().map(|r| matches!(r, Reading::Frame(_))).collect();
            assert_eq!(order, [false, true, false, false, true], "each item: transforms, then the frame");
            let mut items = header.items.iter().flat_map(|item| item.transforms.iter().map(move |t| (item, t)));
            for got in transforms(&readings) {
                let (item, put) = items.next().unwrap();
                assert_eq!((&got.from, &got.to, &got.status), (&put.from, &put.to, &put.status));
                assert_eq!(bits(&got.matrix), bits(&put.matrix));
                assert_eq!(got.stamp.source_s, item.stamp.source_s);
            }
            let frame_bytes = pixels.len() / 2;
            for (n, got) in frames(&readings).into_iter().enumerate() {
                let put = &header.items[n];
                assert_eq!(got.stamp, Stamp { item: n as u64, ..put.stamp });
                assert_eq!((got.frame_number, &got.status, &got.fields), (put.frame_number, &put.status, &put.fields));
                assert_eq!((got.size, got.channels, got.pixel), ([5, 3], channels, pixel));
                assert_eq!((&*got.orientation, &*got.image_type), ("UN", "BRIGHTNESS"));
                assert_eq!(&*got.pixels, &pixels[n * frame_bytes..(n + 1) * frame_bytes], "{pixel:?} {compressed}");
            }
        }
    }
}

#[test]
fn sequence_without_images_roundtrips() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t.mha");
    let header = SequenceHeader { size: [0, 0], compressed: true, ..sample(PixelType::U8, 1, true) };
    SequenceWriter::create(&path, &header).unwrap().finish().unwrap();
    let mut device = Replay::open(&SequenceSettings::new(&path)).unwrap();
    assert_eq!((device.describe().items, device.describe().image_size, device.describe().pixel), (Some(2), None, None));
    device.start().unwrap();
    let readings = drain(&mut device).unwrap();
    assert_eq!((transforms(&readings).len(), frames(&readings).len()), (3, 2));
    assert!(frames(&readings).iter().all(|frame| frame.pixels.is_empty() && frame.size == [0, 0]));
}

#[test]
fn description_holds_all_global_header_values() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mha");
    write(&path, &sample(PixelType::U16, 2, false), &noise(120));
    let device = Replay::open(&SequenceSettings::new(&path)).unwrap();
    let about = device.describe();
    assert_eq!((about.items, about.image_size, about.pixel), (Some(2), Some([5, 3]), Some((PixelType::U16, 2))));
    let field = |name: &str| about.fields.iter().find(|(n, _)| n == name).map(|(_, v)| &**v);
    assert_eq!(field("Operator"), Some("B. März"));
    assert_eq!(field("Site"), Some(""));
    assert_eq!(about.fields.len(), 2, "what the readings say is not said again: {:?}", about.fields);
    assert_eq!(content(&path, &Limits::default()).unwrap(), Content::Sequence);
}

#[test]
fn replay_restarts_and_checks_its_state() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mha");
    let pixels = noise(30);
    write(&path, &sample(PixelType::U8, 1, true), &pixels);
    let mut device = Replay::open(&SequenceSettings::new(&path)).unwrap();
    assert!(matches!(device.next(sonoweave_core::NO_DEADLINE), Err(Error::Stopped(_))));
    device.start().unwrap();
    assert!(matches!(device.start(), Err(Error::Running(_))));
    for _ in 0..3 {
        assert!(matches!(device.next(sonoweave_core::NO_DEADLINE).unwrap(), Next::Reading(_)));
    }
    device.stop().unwrap();
    assert!(matches!(device.next(sonoweave_core::NO_DEADLINE), Err(Error::Stopped(_))));
    for _ in 0..2 {
        device.start().unwrap();
        let readings = drain(&mut device).unwrap();
        let got: Vec<u8> = frames(&readings).iter().flat_map(|frame| frame.pixels.to_vec()).collect();
        assert_eq!(got, pixels);
        assert!(matches!(device.next(sonoweave_core::NO_DEADLINE).unwrap(), Next::End), "the end stays the end");
        device.stop().unwrap();
    }
}

#[test]
fn dropped_frames_memory_is_reused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mha");
    let mut header = sample(PixelType::U8, 1, true);
    header.items = vec![header.items[0].clone(); 50];
    write(&path, &header, &noise(50 * 15));
    let mut device = Replay::open(&SequenceSettings::new(&path)).unwrap();
    device.start().unwrap();
    let mut addresses = std::collections::HashSet::new();
    let mut held: Option<Arc<[u8]>> = None;
    while let Next::Reading(reading) = device.next(sonoweave_core::NO_DEADLINE).unwrap() {
        if let Reading::Frame(frame) = reading {
            addresses.insert(frame.pixels.as_ptr());
            held = Some(frame.pixels);
        }
    }
    assert!(held.is_some());
    assert_eq!(addresses.len(), 2, "one frame held at a time needs two buffers, however many frames there are");
}

#[test]
fn replay_without_images_reads_no_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mha");
    write(&path, &sample(PixelType::U8, 1, true), &noise(30));
    let mut bytes = fs::read(&path).unwrap();
    let header = bytes.windows(6).position(|w| w == b"LOCAL\n").unwrap() + 6;
    bytes[header..].fill(0xff);
    fs::write(&path, bytes).unwrap();
    let error = replay(&path).unwrap_err();
    assert!(matches!(error.cause(), Some(formats::Error::Data { frame: 0, .. })), "{error}");
    let mut device = Replay::open(&SequenceSettings { images: false, ..SequenceSettings::new(&path) }).unwrap();
    device.start().unwrap();
    let readings = drain(&mut device).unwrap();
    assert_eq!((transforms(&readings).len(), frames(&readings).len()), (3, 2));
    let frame = frames(&readings)[0];
    assert!(frame.pixels.is_empty() && frame.size == [5, 3] && frame.stamp.source_s == Some(215.102_186));
}

#[test]
fn replay_of_some_frames_skips_all_others() {
    let folder = tempfile::tempdir().unwrap();
    for compressed in [false, true] {
        let path = folder.path().join(format!("{compressed}.mha"));
        let two = sample(PixelType::U8, 1, compressed);
        let items: Vec<SequenceItem> = two.items.iter().cycle().take(6).cloned().collect();
        write(&path, &SequenceHeader { items, ..two }, &noise(6 * 15));
        let all = replay(&path).unwrap();
        for wanted in [&[] as &[u64], &[0], &[5], &[1, 2, 4], &[0, 1, 2, 3, 4, 5], &[3, 77]] {
            let only = Some(wanted.into());
            let mut device = Replay::open(&SequenceSettings { only, ..SequenceSettings::new(&path) }).unwrap();
            // Once more after it has ended.
            for _ in 0..2 {
                device.start().unwrap();
                let readings = drain(&mut device).unwrap();
                let expected = all.iter().filter(|reading| wanted.contains(&reading.stamp().item));
                assert!(readings.iter().map(text).eq(expected.map(text)), "{wanted:?}, compressed: {compressed}");
                device.stop().unwrap();
            }
        }
    }
}

/// A reading with all that it holds; numbers that are none are equal.
fn text(reading: &Reading) -> String {
    format!("{reading:?}")
}

#[test]
fn replay_in_real_time_takes_recorded_duration() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mha");
    write(&path, &sample(PixelType::U8, 1, true), &noise(30));
    let mut device = Replay::open(&SequenceSettings::new(&path)).unwrap();
    device.start().unwrap();
    let whole = drain(&mut device).unwrap();
    let times: Vec<f64> = frames(&whole).iter().map(|frame| frame.stamp.source_s.unwrap()).collect();
    let lasts = times.last().unwrap() - times[0];
    let factor = lasts / 0.05;
    let mut paced =
        Replay::open(&SequenceSettings { pace: Pace::Factor(factor), ..SequenceSettings::new(&path) }).unwrap();
    paced.start().unwrap();
    let (began, mut pending, mut readings) = (std::time::Instant::now(), 0, 0);
    loop {
        match paced.next(Monotonic.now_ns() + 5 * MS).unwrap() {
            Next::Reading(_) => readings += 1,
            Next::Pending => pending += 1,
            Next::End => break,
        }
    }
    let took = began.elapsed().as_secs_f64();
    assert!(
        took >= 0.05 && pending >= 3 && readings == whole.len(),
        "{took} s of {lasts} at {factor}, {pending}, {readings}"
    );
}

#[test]
fn unusual_valid_headers_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mha");
    let crlf = format!(
        "ObjectType=Image\r\n NDims =  3\r\nDimSize =  2                        1   2  \r\nElementByteOrderMSB = True\r\n\
         ElementType = MET_USHORT\r\nSeq_Frame0000_ProbeToTracker = {EYE_TEXT} \r\nSeq_Frame0000_Status = OK\r\n\
         Seq_Frame0001_Status = BAD\r\nElementDataFile = Local\r\n"
    );
    fs::write(&path, [crlf.as_bytes(), &[1, 2, 3, 4, 5, 6, 7, 8]].concat()).unwrap();
    let readings = replay(&path).unwrap();
    assert_eq!(transforms(&readings)[0].to, "Tracker");
    let native = |words: [u16; 2]| words.map(u16::to_ne_bytes).as_flattened().to_vec();
    assert_eq!(&*frames(&readings)[0].pixels, native([0x0102, 0x0304]));
    assert_eq!(&*frames(&readings)[1].pixels, native([0x0506, 0x0708]));
    assert_eq!(frames(&readings)[1].status, Status::Other("BAD".into()));

    let single = "NDims = 2\nDimSize = 3 1\nElementType = MET_CHAR\nKinds = domain domain\nElementDataFile = LOCAL\n";
    fs::write(&path, [single.as_bytes(), &[1, 2, 3]].concat()).unwrap();
    let readings = replay(&path).unwrap();
    assert_eq!((readings.len(), &*frames(&readings)[0].pixels), (1, &[1, 2, 3][..]));
    assert_eq!(frames(&readings)[0].stamp, Stamp::default());
}

#[test]
fn volume_roundtrips_raw_and_compressed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.mha");
    for pixel in PixelType::ALL {
        for compressed in [false, true] {
            let header = VolumeHeader {
                spacing: [0.5, 0.1 + 0.2, 2.0],
                origin: [-74.5217, 165.573, 1.0e-9],
                axes: [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
                channels: 2,
                compressed,
                fields: vec![("AnatomicalOrientation".into(), "RAI".into()), ("Kernel".into(), "gaussian".into())],
                ..VolumeHeader::new([4, 3, 6], pixel)
            };
            let voxels = noise(4 * 3 * 6 * 2 * pixel.bytes());
            let mut writer = VolumeWriter::create(&path, &header).unwrap();
            for piece in voxels.chunks(7) {
                writer.write_all(piece).unwrap();
            }
            writer.finish().unwrap();
            let mut volume = VolumeReader::open(&path, &Limits::default()).unwrap();
            assert_eq!(volume.header(), &header);
            let mut got = Vec::new();
            while let Some(slice) = volume.next_slice().unwrap() {
                assert_eq!(slice.len() as u64, header.slice_bytes().unwrap());
                got.extend_from_slice(slice);
            }
            assert_eq!(got, voxels);
            assert!(volume.next_slice().unwrap().is_none());
        }
    }
    assert_eq!(content(&path, &Limits::default()).unwrap(), Content::Volume);
    let text = String::from_utf8_lossy(&fs::read(&path).unwrap()).into_owned();
    assert!(
        text.contains("\nTransformMatrix = 0 1 0 -1 0 0 0 0 1\n"),
        "the first triple is the first axis's direction"
    );
    let error = replay(&path).unwrap_err().to_string();
    assert!(error.contains("field Kinds (byte ") && error.contains("makes this a volume"), "{error}");
}

#[test]
fn invalid_volumes_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.mha");
    let refused = |text: &str, expected: &str| {
        fs::write(&path, [text.as_bytes(), &[0; 8]].concat()).unwrap();
        let error = VolumeReader::open(&path, &Limits::default()).err().unwrap().to_string();
        assert!(error.contains(expected) && error.contains("(byte "), "{error}");
    };
    let head = "NDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\n";
    let end = "ElementDataFile = LOCAL\n";
    refused(&format!("{head}Kinds = domain domain list\n{end}"), "field Kinds (byte 50): makes this a sequence");
    refused(
        &format!("NDims = 2\nDimSize = 4 2\nElementType = MET_UCHAR\n{end}"),
        "field DimSize (byte 10): is \"4 2\": this is a single image",
    );
    refused(&format!("{head}ElementSpacing = 1 0 1\n{end}"), "field ElementSpacing (byte 50): is \"1 0 1\"; a spacing");
    refused(
        &format!("{head}Offset = 1 nan 1\n{end}"),
        "field Offset (byte 50): is \"1 nan 1\"; its numbers must be finite",
    );
    refused(&format!("{head}TransformMatrix = 1 0 0 1\n{end}"), "must hold exactly 9");
}

/// Returns the header of a text sequence: two frames of 3×1 pixels with two channels.
fn as_text(pixel: &str, data_file: &str) -> String {
    format!(
        "ObjectType = Image\nNDims = 3\nBinaryData = False\nCompressedData = False\nDimSize = 3 1 2\nKinds = domain domain list\n\
         ElementNumberOfChannels = 2\nElementType = {pixel}\nElementDataFile = {data_file}\n"
    )
}

#[test]
fn text_pixels_are_read_for_every_type_and_location() {
    let folder = tempfile::tempdir().unwrap();
    let (path, data) = (folder.path().join("t.mhd"), folder.path().join("t.txt"));
    let values: [i8; 12] = [1, 0, 100, 2, 127, 3, 64, 99, 5, 6, 7, 8];
    for pixel in PixelType::ALL {
        let signed = !matches!(pixel, PixelType::U8 | PixelType::U16 | PixelType::U32 | PixelType::U64);
        let value = |n: usize| if signed && n % 3 == 1 { -values[n] } else { values[n] };
        // Three spellings: MetaIO's, with a space after each number; a hand-written one; and
        // double precision.
        let plain: String = (0..12).map(|n| format!("{} ", value(n))).collect();
        let lines: String =
            (0..12).map(|n| format!("{}{}", value(n), if n % 4 == 3 { "\r\n" } else { ", " })).collect();
        let spelled: Vec<String> = (0..12).map(|n| format!("{:e}", f64::from(value(n)))).collect();
        let native: Vec<u8> = (0..12)
            .flat_map(|n| match pixel {
                PixelType::U8 | PixelType::I8 => value(n).to_ne_bytes().to_vec(),
                PixelType::U16 | PixelType::I16 => i16::from(value(n)).to_ne_bytes().to_vec(),
                PixelType::U32 | PixelType::I32 => i32::from(value(n)).to_ne_bytes().to_vec(),
                PixelType::U64 | PixelType::I64 => i64::from(value(n)).to_ne_bytes().to_vec(),
                PixelType::F32 => f32::from(value(n)).to_ne_bytes().to_vec(),
                PixelType::F64 => f64::from(value(n)).to_ne_bytes().to_vec(),
            })
            .collect();
        for text in [plain, lines, spelled.join("\n")] {
            for local in [true, false] {
                // The same file must also be readable as a volume.
                let head = as_text(&element_type(pixel), if local { "LOCAL" } else { "t.txt" });
                fs::write(&data, &text).unwrap();
                fs::write(&path, format!("{head}{}", if local { &*text } else { "" })).unwrap();
                let readings = replay(&path).unwrap();
                let got: Vec<u8> = frames(&readings).iter().flat_map(|frame| frame.pixels.to_vec()).collect();
                assert_eq!(got, native, "{pixel:?} {text:?} {local}");
                let about = About::read(&path, &Limits::default()).unwrap();
                assert_eq!((about.encoding, about.compressed), ("as text", false));
                fs::write(&path, fs::read_to_string(&path).unwrap().replace("domain list", "domain domain")).unwrap();
                let mut volume = VolumeReader::open(&path, &Limits::default()).unwrap();
                let mut got = volume.next_slice().unwrap().unwrap().to_vec();
                got.extend_from_slice(volume.next_slice().unwrap().unwrap());
                assert_eq!(got, native);
            }
        }
    }
}

/// Returns the type name that the MetaImage writer uses.
fn element_type(pixel: PixelType) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.mha");
    let mut writer = VolumeWriter::create(&path, &VolumeHeader::new([1; 3], pixel)).unwrap();
    writer.write_all(&[0; 8][..pixel.bytes()]).unwrap();
    writer.finish().unwrap();
    let bytes = fs::read(&path).unwrap();
    let text = String::from_utf8_lossy(&bytes);
    text.lines().find_map(|line| line.strip_prefix("ElementType = ")).unwrap().to_owned()
}

#[test]
fn invalid_text_pixels_are_refused_with_location() {
    let folder = tempfile::tempdir().unwrap();
    let (path, data) = (folder.path().join("t.mhd"), folder.path().join("t.txt"));
    let head = as_text("MET_SHORT", "LOCAL");
    let refused = |header: &str, text: &str, expected: &str| {
        fs::write(&data, text).unwrap();
        fs::write(&path, format!("{header}{}", if header.contains("LOCAL") { text } else { "" })).unwrap();
        let error = replay(&path).unwrap_err().to_string();
        assert!(error.contains(expected), "{error:?} does not say {expected:?}");
        error
    };
    let few = "there are fewer numbers than pixels";
    refused(&head, "1 2 3 4 5 6 7 8 9 10 11", few);
    refused(&head, "1 2 3 4 5 6 7 8 9 10 11 12 13", "more numbers follow the last frame");
    refused(&head, "1 2 3", "promises 24 bytes of pixels, more than the 5 bytes of data");
    refused(&head, "1 2 3 4 5 6 7 8 9 10 11 40000", "\"40000\" is not a value of I16");
    refused(&head, "1 2 3 4 5 6 7 8 9 10 11 1.5", "\"1.5\" is not a value of I16");
    let binary =
        refused(&head, "1 2 3 4 \u{1}\u{2}\u{7f} 6 7 8 9 10 11 12", "is not a value of I16; correct it or the type");
    assert!(binary.contains(&format!("{}", head.len() + 11)), "{binary} does not say where");
    let endless = "7".repeat(1 << 20);
    let error = refused(&head, &endless, "is not a value of I16");
    assert!(error.len() < 500, "{}", error.len());
    let beside = as_text("MET_SHORT", "t.txt");
    let error = refused(&beside, "1 2 3 4 5 6 7 8 9 10 11  ", few);
    assert!(error.contains("t.txt"), "{error}");
    let packed = beside.replace("CompressedData = False", "CompressedData = True");
    refused(&packed, "1 2 3 4 5 6 7 8 9 10 11 12", "field BinaryData (byte 29): is False, which means numbers as text");
    let from_behind = beside.replace("ElementDataFile", "HeaderSize = -1\nElementDataFile");
    refused(&from_behind, "1 2 3 4 5 6 7 8 9 10 11 12", "which is not supported for numbers as text");
    let behind = beside.replace("ElementDataFile", "HeaderSize = 6\nElementDataFile");
    fs::write(&path, behind).unwrap();
    fs::write(&data, "title 1 2 3 4 5 6 7 8 9 10 11 12").unwrap();
    assert_eq!(frames(&replay(&path).unwrap())[1].pixels[..2], 7_i16.to_ne_bytes());
}
