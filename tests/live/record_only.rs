//! A record-only session: the listener receives what is recorded, and everything is counted.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use tempfile::NamedTempFile;

use formats::session::WriterOptions;
use pipeline::session::{Latencies, RecordedDecisions, walk};
use sonoweave_core::clock::SECOND;
use sonoweave_core::{Description, Device, Error, Health, Next};
use sync::ingest::live::Live;

use crate::script::{Act, FRAME, Script, begin, frame, measured, pose, poses_timing, video};
use crate::set::{Memory, Set, roles};

/// Summary of a sample: its device, and the time and number or position that identify it.
fn short((device, live): &(usize, Live)) -> Option<(usize, i64, f64)> {
    match live {
        Live::Pose { sample, .. } => Some((*device, sample.time_ns, sample.pose.position_mm.z)),
        Live::Picture { picture, timed } => Some((*device, timed.time_ns, picture.head.stamp.item as f64)),
        _ => None,
    }
}

#[test]
fn received_samples_equal_a_walk_through_the_recording() {
    let begin_ns = begin();
    // The 30th frame is damaged: it has too few pixels.
    let of_frames = (0..60).map(|n| {
        let at_ns = begin_ns + n as i64 * FRAME;
        let mut given = frame(n, n, at_ns, n);
        if let (30, sonoweave_core::Reading::Frame(frame)) = (n, &mut given) {
            frame.pixels = frame.pixels[..100].into();
        }
        (at_ns, Act::Give(given))
    });
    let of_poses = measured(60).map(|(item, after, mm)| {
        let at_ns = begin_ns + after;
        (at_ns, Act::Give(pose(item, 1, Some(1000 + item), at_ns, mm)))
    });
    let of_poses: Vec<_> = of_poses.collect();
    let poses = of_poses.len() as u64;
    let tracker = Script::new("a tracker", poses_timing(true), of_poses);
    let disk = Memory::default();
    let grabber = Script::new("a grabber", video(), of_frames);
    let set = Set::of(tracker, grabber).recorded(disk.clone(), WriterOptions::new("a test"), 0);
    let (received, status) = set.record_only(&AtomicBool::new(false), |_| false);
    assert_eq!((status.ledger.frames.total, status.ledger.frames.used, status.ledger.frames.waiting), (60, 59, 0));
    assert_eq!(status.ledger.frames.refused.values().sum::<u64>(), 1, "{}", status.ledger);
    assert_eq!(status.ledger.readings[0].used, poses, "{}", status.ledger);

    let file = NamedTempFile::new().unwrap();
    std::fs::write(file.path(), disk.bytes()).unwrap();
    // A replay into a volume has the rules of today's sessions.
    let decisions = RecordedDecisions::read(file.path()).unwrap();
    assert!(["path_by_reach", "mask_by_edges"].iter().all(|rule| decisions.notes(rule) == ["true"]));
    let mut walked = Vec::new();
    walk(file.path(), true, roles().into(), Latencies::Given, |device, live| walked.push((device, live))).unwrap();
    let [received, walked]: [Vec<_>; 2] = [&received, &walked].map(|all| all.iter().filter_map(short).collect());
    assert_eq!(received.len() as u64, 59 + poses);
    assert_eq!(received, walked);
    let times: Vec<i64> = received.iter().filter(|(device, ..)| *device == 1).map(|(_, time_ns, _)| *time_ns).collect();
    assert!(times.windows(2).all(|two| two[0] < two[1]) && times[58] - times[0] > SECOND, "{times:?}");
}

/// A grabber that gives its frame some time after the session was told to end.
struct Late {
    script: Script,
    told: Arc<AtomicBool>,
}

impl Device for Late {
    fn start(&mut self) -> Result<(), Error> {
        self.script.start()
    }

    fn next(&mut self, _: i64) -> Result<Next, Error> {
        while !self.told.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(1));
        }
        // Several turns of the listener.
        std::thread::sleep(Duration::from_millis(300));
        self.script.next(i64::MAX)
    }

    fn stop(&mut self) -> Result<(), Error> {
        self.script.stop()
    }

    fn describe(&self) -> &Description {
        self.script.describe()
    }

    fn health(&self) -> &Health {
        self.script.health()
    }
}

#[test]
fn frame_that_comes_after_the_end_was_told_is_received() {
    let begin_ns = begin();
    let tracker = Script::new("a tracker", poses_timing(true), []);
    let script = Script::new("a grabber", video(), [(begin_ns, Act::Give(frame(0, 0, begin_ns, 0)))]);
    let told = Arc::new(AtomicBool::new(false));
    let set = Set::of(tracker, Late { script, told: told.clone() });
    let (received, status) = set.record_only(&told, |_| true);
    assert_eq!((status.ledger.frames.total, status.ledger.frames.used), (1, 1), "{}", status.ledger);
    assert_eq!(received.len(), 1);
}
