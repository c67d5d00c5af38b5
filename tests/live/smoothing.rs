//! Smoothed poses: a session's replay repeats them, and undoes them on request.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use tempfile::NamedTempFile;

use drivers::replay::{Pace, SessionReplay, SessionSettings};
use formats::session::WriterOptions;
use pipeline::Observer;
use pipeline::session::SessionStatus;
use sonoweave_core::clock::MS;
use sonoweave_core::reading::Reading;
use sonoweave_core::slice::Slice;
use sonoweave_core::{Device, NO_DEADLINE, Next};
use sync::smoothing::Smoothing;

use crate::replay::again;
use crate::script::{Act, Script, begin, frames as all_frames, measured, pose, poses_timing};
use crate::set::{Memory, Set};

const WAIT: i64 = 2_000 * MS;
const SMOOTHING: Smoothing = Smoothing { half_width_ns: 200 * MS, ahead_ns: 40 * MS };

/// A tracker with noise of ±0.5 mm along all axes.
fn noisy(begin_ns: i64) -> Script {
    let acts = measured(60).map(|(item, after, mm)| {
        let Reading::Pose(mut pose) = pose(item, 1, Some(1000 + item), begin_ns + after, mm) else { unreachable!() };
        for (axis, position_cm) in (1..).zip(&mut pose.position_cm) {
            // Multiples of the golden ratio have no order.
            let noise = ((item * (5 * axis + 2)) as f64 * 0.618_033_988_75).fract() - 0.5;
            *position_cm += 0.1 * noise;
        }
        (begin_ns + after, Act::Give(Reading::Pose(pose)))
    });
    Script::new("a tracker", poses_timing(true), acts.collect::<Vec<_>>())
}

/// The poses of slices, by their frames: three rows of four.
#[derive(Default)]
struct Poses(Mutex<BTreeMap<u64, Vec<f64>>>);

impl Observer for Poses {
    fn slice(&self, _world: &str, item: u64, slice: &Slice) {
        self.0.lock().unwrap().insert(item, slice.world_from_image.to_rows()[..12].to_vec());
    }
}

/// Returns the recorded poses before smoothing.
fn unsmoothed(disk: &Memory) -> BTreeMap<u64, Vec<f64>> {
    let file = NamedTempFile::new().unwrap();
    std::fs::write(file.path(), disk.bytes()).unwrap();
    let settings = SessionSettings { images: false, ..SessionSettings::new(file.path()) };
    let mut replay = SessionReplay::open(&settings).unwrap();
    let mut poses = BTreeMap::new();
    replay.start().unwrap();
    loop {
        match replay.next(NO_DEADLINE).unwrap() {
            Next::Reading(Reading::Recorded(note)) if note.topic == "placed" => {
                let note: serde_json::Value = serde_json::from_str(&note.text).unwrap();
                let rows = note["unsmoothed"].as_array().unwrap().iter().map(|number| number.as_f64().unwrap());
                poses.insert(note["frame"].as_u64().unwrap(), rows.collect());
            }
            Next::End => return poses,
            _ => {}
        }
    }
}

#[test]
fn replay_repeats_smoothed_poses_or_interpolates() {
    let (begin_ns, disk) = (begin(), Memory::default());
    let set = Set { smoothing: Some(SMOOTHING), ..Set::of(noisy(begin_ns), all_frames(begin_ns, 60)) };
    let (live, _) = set.waits(WAIT).recorded(disk.clone(), WriterOptions::new("a test"), 0).run();
    let smoothing = live.status.smoothing.clone().unwrap();
    let left: u64 = smoothing.not_smoothed.values().sum();
    assert_eq!(smoothing.smoothed + left, live.status.ledger.frames.used);
    // The first frames have few poses before them.
    assert!(smoothing.smoothed > 40 && left < 10, "{smoothing:?}");
    assert!(smoothing.moved_rms_mm > 0.1 && smoothing.moved_most_mm < 1.0, "{smoothing:?}");
    for (threads, pace) in [(1, Pace::Unpaced), (3, Pace::Unpaced), (2, Pace::Factor(3.0))] {
        let (replayed, decisions) = again(&disk, WAIT, pace, false, |session, _| {
            (session.settings.threads, session.smoothing) = (threads, Some(SMOOTHING));
        });
        assert_eq!(decisions.differences().first, None);
        assert_eq!((&replayed.digest, replayed.status.smoothing.as_ref()), (&live.digest, Some(&smoothing)));
    }
    // Without smoothing, the poses are those that the recording has beside the smoothed ones.
    let seen = Arc::new(Poses::default());
    let (plain, decisions) = again(&disk, WAIT, Pace::Unpaced, false, |session, _| {
        session.observers.push(Arc::clone(&seen) as Arc<dyn Observer>);
    });
    let recorded = unsmoothed(&disk);
    assert!(recorded.len() > 50 && *seen.0.lock().unwrap() == recorded, "{} poses", recorded.len());
    assert!(decisions.differences().first.unwrap().contains("world_from_image"));
    assert_eq!(plain.status.smoothing, None);
    assert_ne!(plain.digest, live.digest);
    let (offline, _) = again(&disk, WAIT, Pace::Unpaced, false, |session, _| {
        session.smoothing = Some(Smoothing { ahead_ns: SMOOTHING.half_width_ns, ..SMOOTHING });
    });
    let error = |status: &SessionStatus| status.smoothing.as_ref().unwrap().error_rms_mm;
    assert!(error(&offline.status) < 0.9 * error(&live.status), "{:?}", offline.status.smoothing);
}
