//! Planes through the growing volume: they show the volume's content, no work is repeated, and
//! viewers do not delay insertion.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use glam::DVec3;

use pipeline::live::{CutWork, Extent, Finished, PlaneImage, PlaneRequest, PlaneViewer};
use render::section::{Planar, Plane, Sampled};

use crate::script::{begin, frames as all_frames, poses};
use crate::set::{Set, frames};

/// Frames of each of these sessions.
const COUNT: u64 = 75;
/// From this number of slices on, none reaches the bricks of the plane across the sweep.
const PAST: u64 = 35;
/// A session without progress for this long has hung.
const PATIENCE: Duration = Duration::from_secs(20);

/// A viewer of a plane across the sweep, near its beginning, of one along it, and of an oblique
/// one.
#[derive(Default)]
struct Surgeon {
    looks: AtomicBool,
    /// Displacement of the plane along the sweep, mm, and the style number.
    aside: AtomicU64,
    look: AtomicU64,
    asked: AtomicU64,
    /// While this is set, the viewer blocks.
    stuck: AtomicBool,
    seen: Mutex<Vec<Seen>>,
}

#[derive(Clone)]
struct Seen {
    wanted: PlaneRequest,
    extent: Extent,
    sampled: Vec<Sampled>,
    slices: u64,
    work: CutWork,
}

const ACROSS: usize = 0;
const ALONG: usize = 1;
const OBLIQUE: usize = 2;

impl Surgeon {
    fn seen(&self) -> Vec<Seen> {
        self.seen.lock().unwrap().clone()
    }

    fn of(&self, number: usize) -> Vec<Seen> {
        self.seen().into_iter().filter(|seen| seen.wanted.number == number).collect()
    }

    fn asked(&self) -> u64 {
        self.asked.load(Ordering::Relaxed)
    }
}

impl PlaneViewer for Surgeon {
    fn is_watched(&self) -> bool {
        self.looks.load(Ordering::Relaxed)
    }

    fn wants(&self, extent: &Extent) -> Vec<PlaneRequest> {
        self.asked.fetch_add(1, Ordering::Relaxed);
        let aside = 10.0 + self.aside.load(Ordering::Relaxed) as f64;
        let planes = [
            (DVec3::new(16.0, 16.0, 2.0), DVec3::Z),
            (DVec3::new(aside, 16.0, 20.0), DVec3::X),
            (DVec3::new(16.0, 16.0, 20.0), DVec3::new(0.5, 0.3, 0.7)),
        ];
        let look = self.look.load(Ordering::Relaxed);
        let wanted = planes.into_iter().enumerate().map(|(number, (point, normal))| {
            let plane = Plane::new(point, normal, None).unwrap();
            PlaneRequest { number, section: plane.cover(&extent.place, 0.7, 256).unwrap(), look }
        });
        wanted.collect()
    }

    fn cut(&self, cut: &PlaneImage<'_>) {
        let PlaneImage { wanted, extent, sampled, slices, work, .. } = *cut;
        self.seen.lock().unwrap().push(Seen { wanted, extent, sampled: sampled.to_vec(), slices, work });
        let begun = Instant::now();
        while self.stuck.load(Ordering::Relaxed) && begun.elapsed() < PATIENCE {
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    fn nothing(&self, why: &str) {
        assert_eq!(why, "no voxel was seen yet");
    }
}

fn viewed_by(surgeon: &Arc<Surgeon>) -> Set {
    let begin_ns = begin();
    let set = Set::of(poses(begin_ns, COUNT).that_stays(), all_frames(begin_ns, COUNT));
    Set { cutter: Some(Arc::clone(surgeon) as Arc<dyn PlaneViewer>), ..set }
}

/// Checks that the last image of each plane equals a sampling of the finished volume.
fn are_the_volume_s(surgeon: &Surgeon, finished: &Finished) {
    let volume = finished.outcome.as_ref().unwrap().reconstructor.volume();
    let last: BTreeMap<usize, Seen> = surgeon.seen().into_iter().map(|seen| (seen.wanted.number, seen)).collect();
    assert_eq!(last.len(), 3);
    for (number, Seen { wanted, extent, sampled, .. }) in last {
        let (expected, _) = Planar { volume, place: extent.place, pool: None }.sample(&wanted.section);
        let seen = expected.iter().filter(|sampled| sampled.is_seen()).count();
        assert!(seen > 500 && seen < expected.len(), "{number}: {seen} of {}", expected.len());
        assert!(sampled == expected, "{number}: the bits of the volume");
    }
}

#[test]
fn planes_equal_the_volume_bitwise() {
    let surgeon = Arc::new(Surgeon { looks: true.into(), ..Surgeon::default() });
    let (finished, _) = viewed_by(&surgeon).until(|status, _| status.ledger.frames.used == COUNT);
    assert_eq!(frames(&finished), (COUNT, COUNT, vec![]));
    are_the_volume_s(&surgeon, &finished);
    let seen = surgeon.seen();
    let work = seen.last().unwrap().work;
    println!("{} pictures, {work:?}", seen.len());
    assert_eq!(work.shown, seen.len() as u64);
}

#[test]
fn plane_is_sampled_and_shown_only_on_changes() {
    let surgeon = Arc::new(Surgeon::default());
    let mut steps = Vec::new();
    let (mut asked, mut last) = (0, CutWork::default());
    let begun = Instant::now();
    let (finished, _) = viewed_by(&surgeon).until(|status, _| {
        assert!(begun.elapsed() < PATIENCE, "{steps:?}");
        let now = surgeon.asked();
        let work = surgeon.seen().last().map_or(CutWork::default(), |seen| seen.work);
        match steps.len() {
            // Without a viewer, nothing is queried or read.
            0 if status.ledger.frames.used >= PAST => {
                assert_eq!((now, surgeon.seen().len()), (0, 0));
                surgeon.looks.store(true, Ordering::Relaxed);
            }
            // A new viewer sees all present slices, and the following ones.
            1 if status.ledger.frames.used == COUNT && !surgeon.seen().is_empty() => asked = now,
            2 if now >= asked + 4 => (asked, last) = (now, work),
            // Without changes, nothing is done.
            3 if now >= asked + 4 => {
                assert_eq!(work, last);
                asked = now;
                surgeon.look.store(1, Ordering::Relaxed);
            }
            // Another style reads and samples nothing.
            4 if now >= asked + 3 => {
                assert_eq!(work, CutWork { shown: last.shown + 3, ..last });
                (asked, last) = (now, work);
                surgeon.aside.store(9, Ordering::Relaxed);
            }
            // Only a plane that moves is read.
            5 if now >= asked + 3 => {
                let CutWork { bricks, planes, shown } = work;
                assert!(bricks > last.bricks);
                assert_eq!((planes, shown), (last.planes + 1, last.shown + 1));
                surgeon.looks.store(false, Ordering::Relaxed);
                asked = now;
            }
            6 => return true,
            _ => return false,
        }
        steps.push(begun.elapsed());
        false
    });
    assert_eq!(frames(&finished), (COUNT, COUNT, vec![]));
    // The plane that the sweep has passed has one image per style, the other as many as time
    // permits.
    let slices: Vec<u64> = surgeon.of(ACROSS).iter().map(|seen| seen.slices).collect();
    assert_eq!(slices.len(), 2, "{slices:?}");
    let along: Vec<u64> = surgeon.of(ALONG).iter().map(|seen| seen.slices).collect();
    println!("across {slices:?}, along {along:?}, oblique {}", surgeon.of(OBLIQUE).len());
    assert!(slices[0] == COUNT || along.len() > 3, "{along:?}");
    are_the_volume_s(&surgeon, &finished);
}

#[test]
fn stuck_plane_viewer_delays_no_slice() {
    let surgeon = Arc::new(Surgeon { looks: true.into(), stuck: true.into(), ..Surgeon::default() });
    let mut inserted_meanwhile = 0;
    let (finished, _) = viewed_by(&surgeon).until(|status, _| {
        if surgeon.stuck.load(Ordering::Relaxed) && !surgeon.seen().is_empty() {
            inserted_meanwhile = status.ledger.frames.used;
            surgeon.stuck.store(inserted_meanwhile < 50, Ordering::Relaxed);
        }
        status.ledger.frames.used == COUNT
    });
    assert!(inserted_meanwhile >= 50, "slices are inserted while nobody answers: {inserted_meanwhile}");
    assert_eq!(frames(&finished), (COUNT, COUNT, vec![]));
    are_the_volume_s(&surgeon, &finished);
}
