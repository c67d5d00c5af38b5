//! Random access to frames.

use std::path::Path;

use formats::Limits;
use formats::session::Frames;
use sonoweave_core::clock::{MS, SECOND};
use sonoweave_core::reading::Reading;

use crate::{BEGIN, chunks_of, mixture, writer};

/// Records a session of 60 frames among other data, with this chunk length; returns its frames
/// as written.
fn recorded(path: &Path, chunk_ns: i64) -> Vec<String> {
    let (mut session, disk) = writer(chunks_of(chunk_ns));
    let written = mixture(&mut session, 60);
    session.finish(BEGIN + 2 * SECOND).unwrap();
    std::fs::write(path, disk.bytes()).unwrap();
    written.into_iter().map(|(_, reading)| reading).filter(|reading| reading.starts_with("Frame")).collect()
}

fn reported(frames: &mut Frames, place: usize) -> Option<String> {
    frames.read(place).unwrap().map(|frame| format!("{:?}", Reading::Frame(frame)))
}

#[test]
fn frames_match_written_in_any_order() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.mcap");
    for chunk_ns in [0, 50 * MS, 10 * SECOND] {
        let written = recorded(&path, chunk_ns);
        assert_eq!(written.len(), 60);
        let mut frames = Frames::open(&path, "grabber", &Limits::default()).unwrap();
        assert_eq!(frames.count(), 60);
        // 37 and 60 are coprime: each frame comes once.
        for place in (0..60).map(|n| n * 37 % 60).chain((0..60).rev()).chain([5, 5, 59, 0]) {
            assert_eq!(reported(&mut frames, place).as_ref(), Some(&written[place]), "{place}");
        }
        assert_eq!(reported(&mut frames, 60), None);
        assert_eq!(Frames::open(&path, "tracker", &Limits::default()).unwrap().count(), 0);
    }
}

#[test]
fn unreadable_chunk_has_no_frames_changed_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.mcap");
    let written = recorded(&path, 100 * MS);
    let bytes = std::fs::read(&path).unwrap();
    let picture = bytes.windows(4).enumerate().filter(|(_, four)| four == b"IDAT").map(|(at, _)| at).nth(20).unwrap();
    let mut damaged = bytes.clone();
    damaged[picture] ^= 4;
    std::fs::write(&path, &damaged).unwrap();
    let mut frames = Frames::open(&path, "grabber", &Limits::default()).unwrap();
    let count = frames.count();
    assert!((40..60).contains(&count), "a chunk is lost: {count}");
    assert_eq!(reported(&mut frames, count - 1).as_ref(), written.last());
    std::fs::write(&path, &bytes).unwrap();
    let mut frames = Frames::open(&path, "grabber", &Limits::default()).unwrap();
    std::fs::write(&path, &damaged).unwrap();
    let error = frames.read(20).unwrap_err();
    assert!(matches!(error, formats::Error::Session { .. }), "{error}");
    assert_eq!(reported(&mut frames, 59).as_ref(), written.last(), "others are there still");
    let nothing = folder.path().join("none.mcap");
    assert!(Frames::open(&nothing, "grabber", &Limits::default()).is_err());
}
