//! Bricks for viewers that draw the growing volume: in the end they are the volume's, hidden parts
//! are unseen, and viewers do not delay insertion.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use pipeline::session::{BrickCopy, BrickViewer, Finished};
use render::Crop;
use render::crop::Operation;
use volume::brick::{BrickIndex, VOXELS};
use volume::read::Values as _;

use crate::script::{begin, frames as all_frames, poses};
use crate::set::{Set, frames};

/// Frames of each of these sessions.
const COUNT: u64 = 75;
/// A session without progress for this long has hung.
const PATIENCE: Duration = Duration::from_secs(20);
/// Bricks that the viewer takes at once.
const MOST: usize = 40;

#[derive(Default)]
struct Viewer {
    looks: AtomicBool,
    crop: Mutex<Crop>,
    dirty: Mutex<BTreeSet<BrickIndex>>,
    held: Mutex<BTreeMap<BrickIndex, Box<BrickCopy>>>,
    /// Times that it was served, with nothing to ask for; and bricks read.
    idle: AtomicU64,
    read: AtomicU64,
    /// While this is set, the viewer blocks.
    stuck: AtomicBool,
}

impl BrickViewer for Viewer {
    fn is_watched(&self) -> bool {
        self.looks.load(Ordering::Relaxed)
    }

    fn crop(&self) -> Crop {
        self.crop.lock().unwrap().clone()
    }

    fn changed(&self, bricks: &[BrickIndex], all: bool) {
        let mut dirty = self.dirty.lock().unwrap();
        if all {
            dirty.extend(self.held.lock().unwrap().keys());
        }
        dirty.extend(bricks);
    }

    fn serve(&self, read: &mut dyn FnMut(&[BrickIndex]) -> Vec<Box<BrickCopy>>) {
        let begun = Instant::now();
        while self.stuck.load(Ordering::Relaxed) && begun.elapsed() < PATIENCE {
            std::thread::sleep(Duration::from_millis(2));
        }
        let mut dirty = self.dirty.lock().unwrap();
        let asked: Vec<BrickIndex> = dirty.iter().copied().take(MOST).collect();
        if asked.is_empty() {
            self.idle.fetch_add(1, Ordering::Relaxed);
            return;
        }
        dirty.retain(|brick| !asked.contains(brick));
        let copies = read(&asked);
        assert_eq!(copies.len(), asked.len());
        self.read.fetch_add(asked.len() as u64, Ordering::Relaxed);
        self.held.lock().unwrap().extend(asked.into_iter().zip(copies));
    }
}

fn viewed_by(viewer: &Arc<Viewer>) -> Set {
    let begin_ns = begin();
    let set = Set::of(poses(begin_ns, COUNT).that_stays(), all_frames(begin_ns, COUNT));
    Set { brick_viewer: Some(Arc::clone(viewer) as Arc<dyn BrickViewer>), ..set }
}

/// Returns the finished volume's bricks.
fn bricks_of(finished: &Finished) -> BTreeMap<BrickIndex, Box<BrickCopy>> {
    let volume = finished.outcome.as_ref().unwrap().reconstructor.volume();
    let copy = |brick: BrickIndex| {
        let mut copy = Box::new(BrickCopy { value: [0.0; VOXELS], weight: [0.0; VOXELS] });
        volume.brick(brick, &mut copy.value, &mut copy.weight);
        (brick, copy)
    };
    volume.bricks().map(copy).collect()
}

fn is_same(a: &BrickCopy, b: &BrickCopy) -> bool {
    a.value == b.value && a.weight == b.weight
}

#[test]
fn bricks_equal_the_volume_bitwise_also_after_a_crop() {
    let viewer = Arc::new(Viewer::default());
    let hides = Operation::BeyondPlane { point: [16.0, 16.0, 20.0], normal: [0.0, 0.0, 1.0] };
    let (mut step, mut idle, mut read) = (0, 0, 0);
    let begun = Instant::now();
    let (finished, _) = viewed_by(&viewer).until(|status, _| {
        assert!(begun.elapsed() < PATIENCE, "step {step}");
        let now = viewer.idle.load(Ordering::Relaxed);
        match step {
            // Without a viewer, nothing is read. A new one gets all present bricks.
            0 if status.ledger.frames.used >= 20 => {
                assert_eq!((now, viewer.read.load(Ordering::Relaxed)), (0, 0));
                viewer.looks.store(true, Ordering::Relaxed);
            }
            1 if status.ledger.frames.used == COUNT => idle = now,
            2 if now >= idle + 3 => {
                read = viewer.read.load(Ordering::Relaxed);
                idle = now;
            }
            // Without changes, nothing is read.
            3 if now >= idle + 3 => {
                assert_eq!(viewer.read.load(Ordering::Relaxed), read);
                *viewer.crop.lock().unwrap() = Crop::new(vec![hides.clone()]).unwrap();
                idle = now;
            }
            4 if now >= idle + 3 && viewer.read.load(Ordering::Relaxed) > read => return true,
            _ => return false,
        }
        step += 1;
        false
    });
    assert_eq!(frames(&finished), (COUNT, COUNT, vec![]));
    let (held, expected) = (viewer.held.lock().unwrap(), bricks_of(&finished));
    assert!(expected.len() > 50 && held.keys().eq(expected.keys()), "{} of {}", held.len(), expected.len());
    let (mut same, mut hidden) = (0, 0);
    for (brick, copy) in &*held {
        // Voxels are 1 mm apart: the plane lies at z = 20.
        if brick[2] * 8 + 7 <= 20 {
            assert!(is_same(copy, &expected[brick]), "{brick:?}: the bits of the volume");
            same += 1;
        } else if brick[2] * 8 > 20 {
            assert!(copy.weight.iter().all(|weight| *weight == 0.0), "{brick:?}");
            hidden += 1;
        }
    }
    assert!(same > 10 && hidden > 10, "{same} and {hidden}");
}

#[test]
fn stuck_brick_viewer_delays_no_slice() {
    let viewer = Arc::new(Viewer { looks: true.into(), stuck: true.into(), ..Viewer::default() });
    let (finished, _) = viewed_by(&viewer).until(|status, _| {
        let is_done = status.ledger.frames.used == COUNT;
        if is_done {
            viewer.stuck.store(false, Ordering::Relaxed);
        }
        is_done
    });
    assert_eq!(frames(&finished), (COUNT, COUNT, vec![]));
}
