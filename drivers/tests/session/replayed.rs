//! The replay device on intact and damaged sessions.

use std::sync::Arc;

use drivers::OpenSettings;
use drivers::replay::{Pace, SessionReplay, SessionSettings};
use formats::session::{SessionWriter, WriterOptions};
use sonoweave_core::clock::{Clock, MS, Manual, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::{Description, Device, Error, NO_DEADLINE, Next};

use crate::{BEGIN, Shared, about, chunks_of, frame, mixture};

fn recorded(
    folder: &std::path::Path,
    cut: impl FnOnce(&mut Vec<u8>),
) -> (SessionSettings, Vec<(Option<&'static str>, String)>) {
    let disk = Shared::default();
    let mut session = SessionWriter::on(Box::new(disk.clone()), "x".as_ref(), about(), chunks_of(100 * MS)).unwrap();
    let written = mixture(&mut session, 40);
    session.finish(BEGIN + SECOND).unwrap();
    let mut bytes = disk.bytes();
    cut(&mut bytes);
    let path = folder.join("session.mcap");
    std::fs::write(&path, bytes).unwrap();
    (SessionSettings::new(path), written)
}

fn all(replay: &mut SessionReplay) -> Result<Vec<(Option<String>, String)>, Error> {
    let mut found = Vec::new();
    loop {
        match replay.next(NO_DEADLINE)? {
            Next::Reading(reading) => found.push((replay.source().map(str::to_owned), format!("{reading:?}"))),
            Next::Pending => panic!("nothing to wait for"),
            Next::End => return Ok(found),
        }
    }
}

#[test]
fn replay_of_all_or_one_device_matches_recording() {
    let folder = tempfile::tempdir().unwrap();
    let (settings, written) = recorded(folder.path(), |_| {});
    for required in [None, Some("tracker"), Some("grabber")] {
        let settings = SessionSettings { device: required.map(str::to_owned), ..settings.clone() };
        let mut replay = SessionReplay::open(&settings).unwrap();
        let names: Vec<&str> = replay.devices().iter().map(|device| device.name.as_str()).collect();
        assert_eq!(names, ["tracker", "grabber"]);
        for _ in 0..2 {
            assert!(matches!(replay.next(0), Err(Error::Stopped(_))));
            replay.start().unwrap();
            let found = all(&mut replay).unwrap();
            let expected: Vec<_> = written.iter().filter(|(by, _)| required.is_none() || *by == required).collect();
            assert_eq!(found.len(), expected.len());
            for ((by, reading), (device, expected)) in found.iter().zip(expected) {
                assert_eq!((by.as_deref(), reading), (*device, expected));
            }
            assert_eq!((replay.health().state, replay.health().why.as_str()), (State::Ended, ""));
            replay.stop().unwrap();
        }
    }
    let missing = SessionSettings { device: Some("arm".into()), ..settings.clone() };
    let error = drivers::open(&OpenSettings::Session(missing)).err().unwrap();
    assert!(error.to_string().ends_with("has no device \"arm\"; give one of its own: tracker, grabber"), "{error}");
    assert!(matches!(error, drivers::Error::NoDevice { .. }));
    let mut device = drivers::open(&OpenSettings::Session(settings)).unwrap();
    assert!(device.home(1).is_err());
    device.start().unwrap();
    assert!(device.start().is_err(), "it runs already");
}

#[test]
fn device_replay_keeps_session_time() {
    let folder = tempfile::tempdir().unwrap();
    let (settings, _) = recorded(folder.path(), |_| {});
    for (device, offset) in [(None, 0), (Some("tracker"), 0), (Some("grabber"), 2)] {
        for factor in [1.0, 4.0] {
            let pace = Pace::Factor(factor);
            let settings = SessionSettings { device: device.map(str::to_owned), pace, ..settings.clone() };
            let mut replay = SessionReplay::open(&settings).unwrap();
            let clock = Manual::at(5 * SECOND);
            replay.set_clock(Arc::new(clock.clone()));
            replay.start().unwrap();
            let (mut first, mut waited) = (None, 0);
            loop {
                match replay.next(clock.now_ns() + MS).unwrap() {
                    Next::Reading(_) => drop(first.get_or_insert(clock.now_ns())),
                    Next::Pending => waited += 1,
                    Next::End => break,
                }
            }
            let took = clock.now_ns() - 5 * SECOND;
            // 40 rounds, 20 ms apart, the last of which ends after at most 5 ms.
            let expected = (f64::from(39 * 20 + 4) * 1e6 / factor) as i64;
            assert!((took - expected).abs() <= (2.0e6 / factor) as i64, "{device:?} {factor}: {took} {expected}");
            assert_eq!(first.unwrap() - 5 * SECOND, ((offset * MS) as f64 / factor) as i64);
            assert!(waited > took / MS / 2);
        }
    }
}

#[test]
fn interrupted_session_ends_and_inner_damage_is_error() {
    let folder = tempfile::tempdir().unwrap();
    let (settings, written) = recorded(folder.path(), |bytes| bytes.truncate(bytes.len() * 2 / 3));
    let mut replay = SessionReplay::open(&settings).unwrap();
    replay.start().unwrap();
    let found = all(&mut replay).unwrap();
    assert!(found.len() > 60 && found.len() < written.len());
    assert!(found.iter().zip(&written).all(|((_, a), (_, b))| a == b));
    assert!(replay.health().why.contains("broken off"), "{}", replay.health().why);
    let (settings, _) = recorded(folder.path(), |bytes| {
        let picture = bytes.windows(4).enumerate().filter(|(_, four)| four == b"IDAT").map(|(at, _)| at).nth(20);
        bytes[picture.unwrap()] ^= 4;
    });
    let mut replay = SessionReplay::open(&settings).unwrap();
    replay.start().unwrap();
    let error = all(&mut replay).err().unwrap();
    let Some(formats::Error::Damaged { damage, .. }) = error.cause() else { panic!("{error}") };
    let sentence =
        format!("session.mcap: byte {}: a chunk with a wrong checksum, up to byte {}", damage.from, damage.until);
    assert!(error.to_string().contains(&sentence), "{error}");
    assert!(matches!(replay.next(0), Err(Error::Failed(_))), "no reading follows an error");
    // Losses during recording are known at the end.
    let disk = Shared::default();
    let options = WriterOptions { held_bytes: 20_000, ..chunks_of(100 * MS) };
    let mut session = SessionWriter::on(Box::new(disk.clone()), "x".as_ref(), about(), options).unwrap();
    let source = session.device("grabber", None, &Description::default(), None).unwrap();
    for n in 0..100 {
        disk.disk().room = (n > 20 && n < 60).then_some(0);
        let at_ns = BEGIN + n * 50 * MS;
        let _ = session.write(source, &frame(n.cast_unsigned(), at_ns, [64, 64]), at_ns);
    }
    let lost = session.finish(BEGIN + 6 * SECOND).unwrap().lost;
    let path = folder.path().join("lossy.mcap");
    std::fs::write(&path, disk.bytes()).unwrap();
    let mut replay = SessionReplay::open(&SessionSettings::new(path)).unwrap();
    replay.start().unwrap();
    assert_eq!(all(&mut replay).unwrap().len() as u64 + lost, 100);
    assert!(lost > 10 && replay.health().received.lost == lost, "{lost} {:?}", replay.health());
    let without = SessionWriter::create(folder.path(), WriterOptions::new("x")).unwrap();
    let path = without.path().to_owned();
    drop(without);
    let mut replay = SessionReplay::open(&SessionSettings::new(path)).unwrap();
    replay.start().unwrap();
    assert!(all(&mut replay).unwrap().is_empty());
}
