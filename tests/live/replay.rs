//! Replays of a recorded session: the same decisions and bits, for any number of threads and any
//! speed; and the reported differences, if there are any.

use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroU64;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

use tempfile::NamedTempFile;

use drivers::replay::{Pace, SessionReplay, SessionSettings};
use formats::session::WriterOptions;
use pipeline::session::{
    DeviceRole, Drawn, Every, Finished, First, Recorded, RecordedDecisions, Session, SessionInputs, SessionStatus,
    Source, ViewClient, run,
};
use render::RenderSettings;
use render::classify::transfer::Transfer;
use sonoweave_core::clock::{MS, Monotonic, SECOND};
use sonoweave_core::ledger::{Frames, Queue};

use crate::script::{
    Act, FRAME, Script, begin, frame, frames as all_frames, measured, pose, poses, poses_timing, video,
};
use crate::set::{Memory, Set, roles, stages};

/// Waiting time of frames in a session with many disturbances.
const WAIT: i64 = 150 * MS;

/// A session with many disturbances. Frames come twice and out of order, and a number is
/// missing. Poses are swapped, come twice, and are absent for longer than frames wait.
fn eventful() -> (Finished, Memory) {
    let begin_ns = begin();
    let numbers: Vec<u64> = (0..9).chain(8..15).chain(17..21).chain([22, 23, 21]).chain(24..60).collect();
    let of_frames = (0..).zip(&numbers).map(|(item, n)| {
        let at_ns = begin_ns + *n as i64 * FRAME;
        // Two frames show the same image at two poses.
        (at_ns, Act::Give(frame(item, *n, at_ns, if *n == 41 { 40 } else { *n })))
    });
    let mut of_poses: Vec<(i64, Act)> = Vec::new();
    for (item, after, mm) in measured(60) {
        let at_ns = begin_ns + after;
        if (SECOND..SECOND + 400 * MS).contains(&after) {
            continue;
        }
        of_poses.push((at_ns, Act::Give(pose(item, 1, Some(1000 + item), at_ns, mm))));
        match item % 10 {
            5 => {
                let len = of_poses.len();
                of_poses.swap(len - 1, len - 2);
            }
            8 => of_poses.push((at_ns, Act::Give(pose(item, 1, Some(1000 + item), at_ns, mm)))),
            _ => {}
        }
    }
    let tracker = Script::new("a tracker", poses_timing(true), of_poses);
    let disk = Memory::default();
    let grabber = Script::new("a grabber", video(), of_frames);
    let set = Set::of(tracker, grabber).waits(WAIT).recorded(disk.clone(), WriterOptions::new("a test"), 0);
    (set.run().0, disk)
}

/// Replays a session's bytes, with optional changes.
pub(crate) fn again(
    disk: &Memory,
    wait_ns: i64,
    pace: Pace,
    all: bool,
    other: impl FnOnce(&mut Session, &mut DeviceRole),
) -> (Finished, RecordedDecisions) {
    let file = NamedTempFile::new().unwrap();
    std::fs::write(file.path(), disk.bytes()).unwrap();
    let mut decisions = RecordedDecisions::read(file.path()).unwrap();
    if all {
        decisions.use_all();
    }
    let replay = SessionReplay::open(&SessionSettings { pace, ..SessionSettings::new(file.path()) }).unwrap();
    let mut session = stages(wait_ns, None);
    let [mut tracking, grabber] = roles();
    other(&mut session, &mut tracking);
    let recorded = Recorded { replay, decisions, roles: vec![tracking, grabber] };
    let inputs = SessionInputs::of(Source::Recording(recorded));
    let ended = run(&session, inputs, &Monotonic, &AtomicBool::new(false), |_| Vec::new());
    let mut finished = ended.unwrap().finish();
    let decisions = finished.decisions.take().unwrap();
    (finished, decisions)
}

/// A viewer that keeps every picture, by its number of slices.
#[derive(Default)]
struct Album {
    pictures: Mutex<BTreeMap<u64, Vec<u8>>>,
    every: Option<NonZeroU64>,
    /// Parts and threads of the renderer.
    parts: Option<u32>,
    threads: usize,
}

impl Album {
    fn of_every(slices: u64) -> Arc<Self> {
        Arc::new(Self { every: NonZeroU64::new(slices), ..Self::default() })
    }

    fn slices(&self) -> Vec<u64> {
        self.pictures.lock().unwrap().keys().copied().collect()
    }
}

impl ViewClient for Album {
    fn settings(&self, _: &First) -> Result<RenderSettings, Box<dyn std::error::Error + Send + Sync>> {
        let settings = RenderSettings::new([64, 64], Transfer::preset("tissue", [0.0, 255.0])?);
        Ok(RenderSettings { parts: self.parts, threads: self.threads, ..settings })
    }

    fn shown(&self, drawn: &Drawn) {
        let picture = drawn.renderer.picture();
        let bits = picture.pixels.iter().flatten().flat_map(|value| value.to_bits().to_le_bytes());
        let before = self.pictures.lock().unwrap().insert(drawn.slices, bits.collect());
        assert!(before.is_none(), "a picture of {} slices was there", drawn.slices);
    }

    fn every(&self) -> Option<Every> {
        self.every.map(Every::Slices)
    }
}

/// Returns the frames' outcomes without losses before arrival, which a recording lacks.
fn outcomes(finished: &Finished) -> Frames {
    Frames { lost: 0, ..finished.status.ledger.frames.clone() }
}

#[test]
fn replay_repeats_decisions_for_any_threads_and_speed() {
    let (live, disk) = eventful();
    let frames = &live.status.ledger.frames;
    assert!(frames.refused.len() >= 3 && frames.used > 30, "{}", live.status.ledger);
    for (threads, pace) in [(1, Pace::Unpaced), (3, Pace::Unpaced), (2, Pace::Factor(3.0))] {
        let (replayed, decisions) = again(&disk, WAIT, pace, false, |session, _| session.settings.threads = threads);
        assert_eq!(decisions.differences().first, None);
        assert_eq!(outcomes(&replayed), outcomes(&live));
        assert_eq!(replayed.status.ledger.first_refusals, live.status.ledger.first_refusals);
        let [one, other] = [&replayed, &live].map(|finished| &finished.status.ledger.readings[0]);
        assert_eq!((one.total, one.used, &one.refused), (other.total, other.used, &other.refused));
        assert_eq!(replayed.digest, live.digest);
        assert!(live.digest.as_ref().unwrap().volume_sha256.is_some());
    }
}

#[test]
fn replay_picture_after_a_slice_equals_the_live_one() {
    let begin_ns = begin();
    let live = Album::of_every(0);
    let disk = Memory::default();
    let set = Set::of(poses(begin_ns, 60), all_frames(begin_ns, 60));
    let set = Set { looks: Some(Arc::clone(&live) as Arc<dyn ViewClient>), ..set };
    let (finished, _) = set.recorded(disk.clone(), WriterOptions::new("a test"), 0).run();
    let inserted = finished.status.ledger.frames.used;
    // A busy machine leaves out all but the last picture.
    assert_eq!(live.slices().last(), Some(&inserted), "{:?}", live.slices());
    let run = |every, threads, pace| {
        let album = Album::of_every(every);
        let (replayed, decisions) = again(&disk, WAIT, pace, false, |session, _| {
            session.view_client = Some(Arc::clone(&album) as Arc<dyn ViewClient>);
            session.settings.threads = threads;
        });
        assert_eq!(decisions.differences().first, None);
        // Slices leave the box, and the renderer keeps what it has read.
        let SessionStatus { picture_renderers, picture_boxes_widened, .. } = replayed.status;
        assert!(picture_renderers == 1 && picture_boxes_widened > 0, "{picture_boxes_widened}");
        album
    };
    let each = run(1, 1, Pace::Unpaced);
    assert_eq!(each.slices(), (1..=inserted).collect::<Vec<_>>());
    let some = run(7, 3, Pace::Factor(4.0));
    assert_eq!(
        some.slices(),
        (7..=inserted).step_by(7).chain([inserted]).collect::<BTreeSet<_>>().into_iter().collect::<Vec<_>>()
    );
    let each = each.pictures.lock().unwrap();
    for album in [&live, &some] {
        for (slices, picture) in &*album.pictures.lock().unwrap() {
            assert!(each[slices] == *picture, "after {slices} slices");
        }
    }
    assert!(each[&(inserted / 2)] != each[&inserted], "pictures show what came since");
}

#[test]
fn picture_in_parts_has_same_bits_live_and_replayed() {
    let begin_ns = begin();
    let live = Arc::new(Album { parts: Some(3), threads: 2, ..Album::default() });
    let disk = Memory::default();
    let set = Set::of(poses(begin_ns, 40), all_frames(begin_ns, 40));
    let set = Set { looks: Some(Arc::clone(&live) as Arc<dyn ViewClient>), ..set };
    let (finished, _) = set.recorded(disk.clone(), WriterOptions::new("a test"), 0).run();
    let status = &finished.status;
    assert!(status.pictures > 0 && status.pictures_in_parts == status.pictures, "{status:?}");
    let run = |parts, threads| {
        let album = Arc::new(Album { every: NonZeroU64::new(1), parts, threads, ..Album::default() });
        let (replayed, decisions) = again(&disk, WAIT, Pace::Unpaced, false, |session, _| {
            session.view_client = Some(Arc::clone(&album) as Arc<dyn ViewClient>);
        });
        assert_eq!((decisions.differences().first, &replayed.digest), (None, &finished.digest));
        (album, replayed.status)
    };
    let (each, status) = run(Some(1), 1);
    let each = each.pictures.lock().unwrap();
    assert_eq!((status.pictures_in_parts, status.pictures), (0, each.len() as u64));
    for (slices, picture) in &*live.pictures.lock().unwrap() {
        assert!(each[slices] == *picture, "after {slices} slices, live");
    }
    for (parts, threads) in (1..=8).flat_map(|parts| [(parts, 1), (parts, 2)]) {
        let (album, status) = run(Some(parts), threads);
        assert!(*album.pictures.lock().unwrap() == *each, "{parts} parts on {threads} threads");
        let in_parts = if parts > 1 { status.pictures } else { 0 };
        assert_eq!(status.pictures_in_parts, in_parts, "{parts} parts on {threads} threads");
    }
}

#[test]
fn first_differing_frame_is_named() {
    let (_, disk) = eventful();
    let (_, decisions) = again(&disk, WAIT, Pace::Unpaced, false, |_, tracker| tracker.latency_ns = MS);
    let found = decisions.differences();
    let first = found.first.unwrap();
    assert!(found.count > 30, "{}", found.count);
    assert!(first.starts_with("frame 0: world_from_image[2][3] is ") && first.ends_with("when it was live"), "{first}");
}

#[test]
fn dropped_frames_drop_again_or_are_used_on_request() {
    // Frames declared so large that only four may be on their way, and poses that are late by a
    // quarter of a second.
    let begin_ns = begin();
    let late = measured(50).map(|(item, after, mm)| {
        let at_ns = begin_ns + after;
        (at_ns + SECOND / 4, Act::Give(pose(item, 1, None, at_ns, mm)))
    });
    let tracker = Script::new("a tracker", poses_timing(false), late);
    let disk = Memory::default();
    let grabber = all_frames(begin_ns, 50).that_seems([30_000, 30_000]);
    let set = Set::of(tracker, grabber).waits(SECOND).recorded(disk.clone(), WriterOptions::new("a test"), 0);
    let (live, _) = set.run();
    let frames = &live.status.ledger.frames;
    let dropped = frames.dropped[&Queue::Pairing];
    assert!(dropped > 10 && frames.used > 5, "{}", live.status.ledger);
    let (replayed, decisions) = again(&disk, SECOND, Pace::Unpaced, false, |_, _| {});
    assert_eq!((decisions.differences().first, decisions.dropped()), (None, dropped));
    assert_eq!((outcomes(&replayed), &replayed.digest), (outcomes(&live), &live.digest));
    let (all, decisions) = again(&disk, SECOND, Pace::Unpaced, true, |_, _| {});
    assert_eq!(decisions.differences().first, None, "what was asked for is no difference");
    assert_eq!(all.status.ledger.frames.used, frames.used + dropped);
    assert_ne!(all.digest, live.digest);
}
