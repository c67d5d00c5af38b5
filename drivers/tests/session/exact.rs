//! Written messages are read back: exactly, in order, with their times; by this reader and by
//! the `mcap` crate's.

use std::collections::BTreeMap;

use formats::session::{Crop, Ending, SessionWriter, WriterOptions};
use formats::{Error, Unwritable};
use sonoweave_core::Description;
use sonoweave_core::clock::{MS, SECOND};
use sonoweave_core::reading::{Frame, PixelType, Reading, Status};

use crate::{BEGIN, chunks_of, frame, mixture, pose, read, writer};

#[test]
fn readings_roundtrip_exactly_in_order() {
    for chunk_ns in [0, 50 * MS, 10 * SECOND] {
        let (mut session, disk) = writer(chunks_of(chunk_ns));
        let written = mixture(&mut session, 60);
        let account = session.finish(BEGIN + 2 * SECOND).unwrap();
        let bytes = disk.bytes();
        assert_eq!((account.lost, account.held_bytes, account.file_bytes), (0, 0, bytes.len() as u64));
        assert_eq!(account.stored, account.messages);
        let again = read(&bytes).unwrap();
        assert_eq!((again.damage.len(), again.missing, again.ending), (0, 0, Some(Ending::Finished)));
        assert!(again.times.is_sorted() && again.times[0] == BEGIN);
        assert_eq!(again.readings.len(), written.len());
        for ((device, _, _, reading), (by, expected)) in again.readings.iter().zip(&written) {
            assert_eq!((device.as_deref(), reading), (*by, expected));
        }
    }
}

#[test]
fn mcap_reader_finds_same_messages() {
    let (mut session, disk) = writer(chunks_of(100 * MS));
    let written = mixture(&mut session, 30);
    session.finish(BEGIN + 2 * SECOND).unwrap();
    let bytes = disk.bytes();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    assert!(summary.chunk_indexes.len() > 3);
    let mut topics = BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        assert_eq!(message.channel.message_encoding, "protobuf");
        let schema = message.channel.schema.clone().unwrap();
        assert!(!schema.data.is_empty());
        *topics.entry(message.channel.topic.clone()).or_insert(0) += 1;
    }
    // Poses of two stations; the session record at both ends; the description of both devices.
    let expected = [
        ("/grabber/about", 1),
        ("/grabber/image", 30),
        ("/grabber/transform", 30),
        ("/note/decision", 30),
        ("/session", 2),
        ("/tracker/about", 1),
        ("/tracker/counts", 30),
        ("/tracker/pose/1", 15),
        ("/tracker/pose/2", 15),
        ("/tracker/raw", 30),
    ];
    assert_eq!(topics, expected.map(|(topic, count)| (topic.to_owned(), count)).into());
    assert_eq!(written.len(), 180);
    assert_eq!(summary.stats.unwrap().message_count, 184);
}

#[test]
fn cropped_frame_keeps_position() {
    for (pixel, channels) in [(PixelType::U8, 1), (PixelType::U8, 3), (PixelType::U16, 1), (PixelType::F32, 2)] {
        let bytes = pixel.bytes() * channels as usize;
        let pixels: Vec<u8> = (0..20 * 15 * bytes).map(|n| (n * n / 7 + 1) as u8 | 1).collect();
        let Reading::Frame(model) = frame(3, BEGIN, [20, 15]) else { unreachable!() };
        let whole = Frame { channels, pixel, pixels: pixels.clone().into(), ..model };
        for crop in [
            Crop { offset: [0, 0], size: [20, 15] },
            Crop { offset: [4, 5], size: [9, 3] },
            Crop { offset: [11, 0], size: [100, 1] },
            Crop { offset: [19, 14], size: [1, 1] },
        ] {
            let (mut session, disk) = writer(WriterOptions::new("a test"));
            let grabber = session.device("grabber", None, &Description::default(), Some(crop)).unwrap();
            session.write(grabber, &Reading::Frame(whole.clone()), BEGIN).unwrap();
            session.finish(BEGIN).unwrap();
            let mut kept = pixels.clone();
            for (n, pixel) in kept.chunks_mut(bytes).enumerate() {
                let place = [n as u32 % 20, n as u32 / 20];
                let within =
                    |axis: usize| (crop.offset[axis]..crop.offset[axis] + crop.size[axis]).contains(&place[axis]);
                if !within(0) || !within(1) {
                    pixel.fill(0);
                }
            }
            let expected = format!("{:?}", Reading::Frame(Frame { pixels: kept.into(), ..whole.clone() }));
            let again = read(&disk.bytes()).unwrap();
            assert_eq!(again.readings[0].3, expected, "{crop:?} {pixel:?}");
        }
    }
}

#[test]
fn frame_without_pixels_roundtrips() {
    let Reading::Frame(model) = frame(3, BEGIN, [20, 15]) else { unreachable!() };
    let (mut session, disk) = writer(WriterOptions::new("a test"));
    let grabber = session.device("grabber", None, &Description::default(), None).unwrap();
    let without = [
        Frame { pixels: [].into(), ..model.clone() },
        Frame { pixels: [].into(), size: [0, 0], status: Status::Other("INVALID".into()), ..model.clone() },
        Frame { fields: vec![("a".into(), "b\nc".into()), (String::new(), String::new())], ..model },
    ];
    let expected: Vec<String> = without.iter().map(|frame| format!("{:?}", Reading::Frame(frame.clone()))).collect();
    without.into_iter().for_each(|frame| session.write(grabber, &Reading::Frame(frame), BEGIN).unwrap());
    session.finish(BEGIN).unwrap();
    let again: Vec<String> =
        read(&disk.bytes()).unwrap().readings.into_iter().map(|(_, _, _, reading)| reading).collect();
    assert_eq!(again, expected);
}

#[test]
fn log_times_never_decrease_and_stamps_stay() {
    let (mut session, disk) = writer(chunks_of(0));
    let tracker = session.device("tracker", None, &Description::default(), None).unwrap();
    for (item, at) in [(0, 50), (1, 20), (2, 70), (3, -5)] {
        session.write(tracker, &pose(item, BEGIN + at * MS), BEGIN + at * MS).unwrap();
    }
    session.finish(0).unwrap();
    let again = read(&disk.bytes()).unwrap();
    assert!(again.times.is_sorted(), "{:?}", again.times);
    for ((item, at), (_, _, _, reading)) in [(0, 50), (1, 20), (2, 70), (3, -5)].into_iter().zip(&again.readings) {
        assert_eq!(*reading, format!("{:?}", pose(item, BEGIN + at * MS)));
    }
}

/// The recorder and each replay run on their own threads.
const fn goes_to_a_thread<T: Send>() {}
const _: () = {
    goes_to_a_thread::<SessionWriter>();
    goes_to_a_thread::<drivers::replay::SessionReplay>();
};

#[test]
fn device_and_file_names_are_unique() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = SessionWriter::create(folder.path(), WriterOptions::new("a test")).unwrap();
    session.device("tracker", None, &Description::default(), None).unwrap();
    for name in ["tracker", "", "a/b", "note", "session"] {
        let refused = session.device(name, None, &Description::default(), None);
        let Err(Error::Unwritable { source, .. }) = refused else { panic!("{refused:?}") };
        assert!(matches!(source, Unwritable::DeviceName(given) if given == name));
    }
    let second = SessionWriter::create(folder.path(), WriterOptions::new("a test")).unwrap();
    assert_ne!(session.path(), second.path());
    assert!(session.path().file_name().unwrap().to_str().unwrap().starts_with("SESSION-20"));
    // A dropped writer finishes its file.
    let path = session.path().to_owned();
    drop(session);
    assert_eq!(read(&std::fs::read(path).unwrap()).unwrap().ending, Some(Ending::Finished));
    let room = second.room().unwrap();
    assert!(room.free_bytes > 0 && room.minutes().is_none());
}
