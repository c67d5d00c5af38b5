//! Fuzz targets: each decoder, and each reader of commands. `make fuzz` searches for bytes that
//! break them; an ordinary test (`drivers/tests/fuzz_corpus.rs`) repeats the inputs in
//! `corpus/`.
//!
//! Besides not panicking, the targets check: the bytes give the same records and counts in one
//! piece and divided anywhere. Every byte is in one record, skipped or pending; pending bytes
//! never exceed the format's window. The first two bytes of the input choose the settings and
//! the division of the rest.

#![allow(dead_code, reason = "each program of the fuzzer uses one of these functions")]

use std::fmt::Debug;
use std::ops::Range;

use drivers::arm::{ea1, microscribe, qsb};
use drivers::framing::{Decoder, Format, Losses};
use drivers::grabber::pixels::{
    Colour, Converter, Field, Layout, Matrix, PixelFormat, Range as Levels, Rows, Scan, Take,
};
use drivers::openigtlink;
use drivers::replay::{Replay, SequenceSettings};
use drivers::tracker::polhemus::{fastrak, isotrak, liberty, viper};
use formats::Limits;
use formats::image::{About, VolumeReader};
use formats::session::{Event, Maker, SessionReader};

/// A function that tests one kind of input.
pub(crate) type Target = fn(&[u8]);

/// All targets by name.
pub(crate) const ALL: [(&str, Target); 16] = [
    ("fastrak", fastrak),
    ("isotrak", isotrak),
    ("liberty", liberty),
    ("viper", viper),
    ("ea1", ea1),
    ("qsb", qsb),
    ("microscribe", microscribe),
    ("openigtlink", openigtlink),
    ("commands", commands),
    ("pixels", pixels),
    ("jpeg", jpeg),
    ("session", session),
    ("metaimage", image),
    ("nrrd", image),
    ("nifti", image),
    ("dicom", image),
];

fn decode<F: Format>(format: F, stream: &[u8], piece: usize) -> (Vec<(String, Range<u64>)>, Losses)
where
    for<'a> F::Record<'a>: Debug,
{
    let window = format.window();
    let mut decoder = Decoder::new(format);
    let mut found = Vec::new();
    let mut fed = 0;
    for bytes in stream.chunks(piece) {
        fed += bytes.len() as u64;
        decoder.feed(bytes, &mut |record, range| {
            assert!(range.start < range.end && range.end <= fed, "a record of bytes that have not come");
            found.push((format!("{record:?}"), range));
        });
        assert!(decoder.pending() < window.max(1), "more waits than a window");
    }
    let recorded: u64 = found.iter().map(|(_, range)| range.end - range.start).sum();
    assert_eq!(recorded + decoder.losses().bytes_skipped + decoder.pending() as u64, stream.len() as u64);
    (found, decoder.losses())
}

fn cut_anywhere<F: Format + Clone>(format: &F, stream: &[u8], cut: u8)
where
    for<'a> F::Record<'a>: Debug,
{
    let whole = decode(format.clone(), stream, stream.len().max(1));
    assert_eq!(decode(format.clone(), stream, 1 + usize::from(cut)), whole, "in pieces of {}", 1 + usize::from(cut));
}

pub(crate) fn fastrak(data: &[u8]) {
    let [choice, cut, stream @ ..] = data else { return };
    let (mode, codes): (_, &[u8]) = match choice % 8 {
        0 => (fastrak::Mode::Ascii, &[2, 11, 1]),
        1 => (fastrak::Mode::Ascii, &[2, 4, 1]),
        2 => (fastrak::Mode::Ascii, &[52, 61, 66, 1]),
        3 => (fastrak::Mode::Binary, &[2, 11, 0]),
        4 => (fastrak::Mode::Binary, &[2, 5, 6, 7, 16, 1]),
        5 => (fastrak::Mode::Binary, &[18, 20]),
        6 => (fastrak::Mode::Binary, &[]),
        _ => return cut_anywhere(&fastrak::Fastrak::replies(), stream, *cut),
    };
    let layout = fastrak::Layout::new(mode, codes).expect("a list that units have");
    cut_anywhere(&fastrak::Fastrak::uniform(usize::from(choice / 8 % 5), layout), stream, *cut);
}

pub(crate) fn isotrak(data: &[u8]) {
    let [choice, cut, stream @ ..] = data else { return };
    let codes: &[u8] = match choice % 4 {
        0 => &[2, 11],
        1 => &[2, 4, 1],
        2 => &[5, 6, 7, 0],
        _ => &[],
    };
    let layout = isotrak::Layout::new(codes).expect("a list that units have");
    cut_anywhere(&isotrak::Isotrak::new(choice / 4 % 4, layout), stream, *cut);
}

pub(crate) fn liberty(data: &[u8]) {
    let [choice, cut, stream @ ..] = data else { return };
    let codes: &[u8] = match choice % 4 {
        0 => &[8, 9, 2, 7],
        1 => &[2, 4, 6, 10, 11, 12, 1],
        _ => return cut_anywhere(&liberty::Liberty::replies(), stream, *cut),
    };
    let layout = liberty::Layout::new(codes).expect("a list that units have");
    cut_anywhere(&liberty::Liberty::new(choice / 4, layout), stream, *cut);
}

pub(crate) fn viper(data: &[u8]) {
    let [choice, cut, stream @ ..] = data else { return };
    cut_anywhere(&viper::Viper::new(usize::from(choice % 32)), stream, *cut);
}

pub(crate) fn ea1(data: &[u8]) {
    let [choice, cut, stream @ ..] = data else { return };
    let format = if choice % 2 == 0 { ea1::Ea1::new() } else { ea1::Ea1::or_bare_numbers() };
    cut_anywhere(&format, stream, *cut);
}

pub(crate) fn qsb(data: &[u8]) {
    let [_, cut, stream @ ..] = data else { return };
    cut_anywhere(&qsb::Qsb, stream, *cut);
}

pub(crate) fn microscribe(data: &[u8]) {
    use microscribe::{Answers, Awaited, Command, Family, Links, Question, Request, Samples};
    let [choice, cut, stream @ ..] = data else { return };
    let family = if choice & 0x80 == 0 { Family::MicroScribe } else { Family::Box };
    if let Some(request) = Request::new(family, usize::from(choice & 7), choice & 8 != 0) {
        cut_anywhere(&Samples::new(request), stream, *cut);
    }
    let awaited = match choice >> 4 & 7 {
        0 => Awaited::Signature,
        1 => Awaited::ProductName,
        2 => Awaited::Answer(Question::Parameters),
        3 => Awaited::Answer(Question::Maxima),
        4 => Awaited::Answer(Question::Comment),
        _ => Awaited::Echo(Command::Home),
    };
    cut_anywhere(&Answers::to(awaited), stream, *cut);
    Links::read(stream);
}

/// Reads a stream of OpenIGTLink in pieces of that length; returns the events, and the error
/// that broke it.
fn read_messages(
    stream: &[u8],
    piece: usize,
    limits: openigtlink::Limits,
) -> (Vec<openigtlink::Event>, Option<String>) {
    let mut decoder = openigtlink::Decoder::new(limits);
    let mut found = Vec::new();
    let mut broken = None;
    for bytes in stream.chunks(piece) {
        let outcome = decoder.feed(bytes, &mut |event| found.push(event));
        broken = outcome.err().map(|why| why.to_string());
        assert!(
            decoder.pending() as u64 <= openigtlink::header::HEADER as u64 + limits.body,
            "more waits than the limit"
        );
    }
    let taken: u64 = found
        .iter()
        .map(|event| match event {
            openigtlink::Event::Message(_, range) => range.end - range.start,
            openigtlink::Event::Refused(_) => 0,
        })
        .sum();
    // A skipped body counts as soon as its header has been read.
    assert!(taken + decoder.skipped() + decoder.pending() as u64 >= stream.len() as u64, "bytes that went nowhere");
    (found, broken)
}

/// Tests a stream of OpenIGTLink, or a body with a valid checksum, which arbitrary bytes never
/// have. A message that was understood must be understood the same after writing it.
pub(crate) fn openigtlink(data: &[u8]) {
    use openigtlink::{Event, Limits, header};
    let [choice, cut, stream @ ..] = data else { return };
    let limits = if choice & 2 == 0 { Limits { body: 96, passed: 4096 } } else { Limits::SMALL };
    let mut stream = stream.to_vec();
    if choice & 1 == 0 && stream.len() >= header::HEADER {
        let size = (stream.len() - header::HEADER) as u64;
        let sum = header::checksum(&stream[header::HEADER..]);
        stream[42..50].copy_from_slice(&size.to_be_bytes());
        stream[50..58].copy_from_slice(&sum.to_be_bytes());
    }
    let whole = read_messages(&stream, stream.len().max(1), limits);
    // Compared as text, because NaN differs from itself.
    let stated = |(found, broken): &(Vec<Event>, Option<String>)| format!("{found:?} {broken:?}");
    assert_eq!(stated(&read_messages(&stream, 1 + usize::from(*cut), limits)), stated(&whole));
    for event in &whole.0 {
        let Event::Message(message, _) = event else { continue };
        // A text that was made readable may be longer than before.
        let Ok(bytes) = message.bytes() else { continue };
        let again = read_messages(&bytes, bytes.len(), Limits::default());
        let [Event::Message(again, _)] = &again.0[..] else { panic!("{message:?} is written as {again:?}") };
        assert_eq!(again.bytes().ok().as_ref(), Some(&bytes), "{message:?}");
    }
}

/// Tests the command parsers of the virtual devices: a parsed command must be parsed the same
/// after writing it.
pub(crate) fn commands(data: &[u8]) {
    let [choice, line @ ..] = data else { return };
    match choice % 4 {
        0 => {
            if let Some((Ok(command), used)) = fastrak::Command::read(line) {
                assert!((1..=line.len()).contains(&used));
                assert_eq!(
                    fastrak::Command::read(&command.bytes()).map(|(again, _)| format!("{again:?}")),
                    Some(format!("{:?}", Ok::<_, ()>(command)))
                );
            }
        }
        1 => {
            if let Some((Some(command), used)) = liberty::Command::read(line) {
                assert!((1..=line.len()).contains(&used));
                assert_eq!(
                    liberty::Command::read(&command.bytes()).map(|(again, _)| format!("{again:?}")),
                    Some(format!("{:?}", Some(command)))
                );
            }
        }
        2 => {
            if let Some((Ok(command), _)) = ea1::Command::read(line) {
                let bytes = command.bytes();
                assert_eq!(ea1::Command::read(&bytes), Some((Ok(command), bytes.len())));
            }
        }
        _ => {
            if let Some((Some(command), _)) = qsb::Command::read(line) {
                let bytes = command.bytes();
                assert_eq!(qsb::Command::read(&bytes), Some((Some(command), bytes.len())));
            }
        }
    }
}

fn rows(choice: u8) -> Rows {
    let scan = match choice % 4 {
        0 => Scan::Progressive,
        1 => Scan::Interlaced,
        2 => Scan::Sequential { first: Field::Top },
        _ => Scan::Sequential { first: Field::Bottom },
    };
    let take = [Take::All, Take::Field(Field::Top), Take::Field(Field::Bottom)][usize::from(choice / 4 % 3)];
    Rows { scan, take }
}

/// Tests a video frame of any format and layout: it converts, unless the layout is impossible
/// or bytes are missing.
pub(crate) fn pixels(data: &[u8]) {
    let [choice, order, width, height, row_bytes, video @ ..] = data else { return };
    // The last format is JPEG, which has its own function.
    let formats = &PixelFormat::ALL[..PixelFormat::ALL.len() - 1];
    let layout = Layout {
        format: formats[usize::from(choice % 16) % formats.len()],
        size: [(*width).into(), (*height).into()],
        row_bytes: (*row_bytes).into(),
        range: if choice & 32 == 0 { Levels::Limited } else { Levels::Full },
        matrix: if choice & 64 == 0 { Matrix::Bt601 } else { Matrix::Bt709 },
    };
    let colour = if choice & 128 == 0 { Colour::Grey } else { Colour::Rgb };
    let Ok(mut converter) = Converter::new(layout, rows(*order), colour) else { return };
    let mut picture = vec![0; converter.picture_bytes()];
    assert_eq!(converter.convert(video, &mut picture).is_ok(), video.len() >= converter.video_bytes());
}

/// Tests a JPEG frame: it is decoded or refused, the same each time.
pub(crate) fn jpeg(data: &[u8]) {
    let [choice, order, video @ ..] = data else { return };
    let layout = Layout {
        format: PixelFormat::Mjpg,
        size: [if choice & 128 == 0 { 64 } else { 16 }, 16],
        row_bytes: 0,
        range: Levels::Full,
        matrix: Matrix::Bt601,
    };
    let colour = if choice & 1 == 0 { Colour::Grey } else { Colour::Rgb };
    let Ok(mut converter) = Converter::new(layout, rows(*order), colour) else { return };
    let mut pictures = [vec![0; converter.picture_bytes()], vec![0; converter.picture_bytes()]];
    let outcomes = pictures.each_mut().map(|picture| converter.convert(video, picture));
    assert_eq!(outcomes[0], outcomes[1]);
    assert!(outcomes[0].is_err() || pictures[0] == pictures[1]);
}

/// Returns the content of a session's file as text.
fn read_session(file: &[u8]) -> Vec<String> {
    let limits = Limits { frame_bytes: 1 << 20, ..Limits::default() };
    let mut stated = Vec::new();
    let mut reader = match SessionReader::of(std::io::Cursor::new(file), file.len() as u64, "fuzzed".as_ref(), &limits)
    {
        Ok(reader) => reader,
        Err(error) => return vec![error.to_string()],
    };
    let mut maker = Maker::new(true, limits.frame_bytes);
    let mut until = 0;
    loop {
        match reader.next_event().expect("memory can be read") {
            None => break,
            Some(Event::Damage(part)) => {
                assert!(part.from < part.until && part.until <= file.len() as u64, "{part:?}");
                assert!(!part.is_loss || part.from >= until, "{part:?} overlaps what was told before");
                until = if part.is_loss { part.until } else { until };
                stated.push(format!("{part:?}"));
            }
            Some(Event::Message(message)) => {
                let whole = (message.about(), message.device(), message.loss(), maker.read(&message));
                stated.push(format!("{} {} {whole:?}", message.channel.topic, message.log_ns()));
            }
        }
    }
    assert!(reader.ending().is_some());
    stated
}

/// Tests a session's file, or the records of a chunk with a valid checksum, which arbitrary
/// bytes never have.
pub(crate) fn session(data: &[u8]) {
    let [choice, _, file @ ..] = data else { return };
    if choice % 2 == 0 {
        assert_eq!(read_session(file), read_session(file));
        return;
    }
    // Magic, and a chunk: number, length, two times, size, checksum, no compression, size,
    // records.
    let size = file.len() as u64;
    let mut whole = mcap::MAGIC.to_vec();
    whole.push(6);
    whole.extend_from_slice(&(40 + size).to_le_bytes());
    whole.extend_from_slice(&[0; 16]);
    whole.extend_from_slice(&size.to_le_bytes());
    whole.extend_from_slice(&crc32fast::hash(file).to_le_bytes());
    whole.extend_from_slice(&[0; 4]);
    whole.extend_from_slice(&size.to_le_bytes());
    whole.extend_from_slice(file);
    assert_eq!(read_session(&whole), read_session(&whole));
}

/// Returns the content of an image file as text, within the limits.
fn read_image(path: &std::path::Path, limits: &Limits) -> Vec<String> {
    use sonoweave_core::{Device as _, Next, Reading};
    let mut stated = vec![format!("{:?}", About::read(path, limits).map_err(|error| error.to_string()))];
    match Replay::open(&SequenceSettings { limits: *limits, ..SequenceSettings::new(path) }) {
        Err(error) => stated.push(error.to_string()),
        Ok(mut device) => {
            stated.extend(device.start().err().map(|error| error.to_string()));
            loop {
                match device.next(sonoweave_core::NO_DEADLINE) {
                    Ok(Next::Reading(reading)) => {
                        if let Reading::Frame(frame) = &reading {
                            assert!(frame.pixels.len() as u64 <= limits.frame_bytes && frame.stamp.item < limits.items);
                        }
                        stated.push(format!("{reading:?}"));
                    }
                    Ok(Next::Pending) => panic!("a file never waits"),
                    Ok(Next::End) => break,
                    Err(error) => {
                        stated.push(error.to_string());
                        break;
                    }
                }
            }
        }
    }
    match VolumeReader::open(path, limits) {
        Err(error) => stated.push(error.to_string()),
        Ok(mut volume) => loop {
            match volume.next_slice() {
                Ok(Some(slice)) => stated.push(format!("{slice:?}")),
                Ok(None) => break,
                Err(error) => {
                    stated.push(error.to_string());
                    break;
                }
            }
        },
    }
    stated
}

/// Tests an image file: MetaImage, NRRD, NIfTI or DICOM, by its first bytes.
pub(crate) fn image(data: &[u8]) {
    let [choice, _, file @ ..] = data else { return };
    let folder = tempfile::tempdir().expect("there is room");
    let path = folder.path().join("a");
    std::fs::write(&path, file).expect("there is room");
    // Pixel file that a header may name.
    std::fs::write(folder.path().join("a.raw"), [7; 24]).expect("there is room");
    let frame_bytes = if choice % 2 == 0 { 4096 } else { 16 };
    let limits = Limits { header_bytes: 1 << 16, frame_bytes, items: 256, transposed_bytes: 4096 };
    assert_eq!(read_image(&path, &limits), read_image(&path, &limits));
}
