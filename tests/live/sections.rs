//! Planes through the growing volume: they show the volume's content, no work is repeated, and
//! viewers do not delay insertion.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use glam::DVec3;

use pipeline::session::{Extent, Finished, PlaneImage, PlaneRequest, PlaneViewer, PlaneWork, Readout};
use reconstruct::PathReconstructor;
use reconstruct::standard_error::Edge;
use render::section::{Planar, Plane, Sampled};
use volume::brick::VOXELS;
use volume::read::{SEEN, Values as _};

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
struct Viewer {
    looks: AtomicBool,
    /// Displacement of the plane along the sweep, mm, and the style number.
    aside: AtomicU64,
    style: AtomicU64,
    requested: AtomicU64,
    /// Whether standard errors are shown.
    errors: AtomicBool,
    /// Whether places seen weakly are shown.
    weakly_seen: AtomicBool,
    /// Whether the viewer asks for the edges at the place that is read out and far away, and the
    /// last answer.
    asks: AtomicBool,
    edges: Mutex<Vec<Option<Edge>>>,
    /// While this is set, the viewer blocks.
    stuck: AtomicBool,
    seen: Mutex<Vec<Seen>>,
}

#[derive(Clone)]
struct Seen {
    request: PlaneRequest,
    extent: Extent,
    sampled: Vec<Sampled>,
    errors: Vec<Sampled>,
    keeps_errors: bool,
    weak: Option<f32>,
    readout: Option<Readout>,
    slices: u64,
    work: PlaneWork,
}

/// The place that is read out: a voxel's middle.
const PLACE: DVec3 = DVec3::new(16.0, 12.0, 20.0);

const ACROSS: usize = 0;
const ALONG: usize = 1;
const OBLIQUE: usize = 2;

impl Viewer {
    fn seen(&self) -> Vec<Seen> {
        self.seen.lock().unwrap().clone()
    }

    fn of(&self, number: usize) -> Vec<Seen> {
        self.seen().into_iter().filter(|seen| seen.request.number == number).collect()
    }

    fn requested(&self) -> u64 {
        self.requested.load(Ordering::Relaxed)
    }
}

impl PlaneViewer for Viewer {
    fn is_watched(&self) -> bool {
        self.looks.load(Ordering::Relaxed)
    }

    fn requested(&self, extent: &Extent) -> Vec<PlaneRequest> {
        self.requested.fetch_add(1, Ordering::Relaxed);
        let aside = 10.0 + self.aside.load(Ordering::Relaxed) as f64;
        let planes = [
            (DVec3::new(16.0, 16.0, 2.0), DVec3::Z),
            (DVec3::new(aside, 16.0, 20.0), DVec3::X),
            (DVec3::new(16.0, 16.0, 20.0), DVec3::new(0.5, 0.3, 0.7)),
        ];
        let style = self.style.load(Ordering::Relaxed);
        let wanted = planes.into_iter().enumerate().map(|(number, (point, normal))| {
            let plane = Plane::new(point, normal, None).unwrap();
            PlaneRequest { number, section: plane.cover(&extent.place, 0.7, 256).unwrap(), style }
        });
        wanted.collect()
    }

    fn shows_errors(&self) -> bool {
        self.errors.load(Ordering::Relaxed)
    }

    fn shows_weakly_seen(&self) -> bool {
        self.weakly_seen.load(Ordering::Relaxed)
    }

    fn readout_at(&self, _: &Extent) -> DVec3 {
        PLACE
    }

    fn answer_edges(&self, edges: &mut dyn FnMut(&[DVec3]) -> Vec<Option<Edge>>) {
        if self.asks.load(Ordering::Relaxed) {
            *self.edges.lock().unwrap() = edges(&[PLACE, PLACE + DVec3::X * 1e4]);
        }
    }

    fn show_plane(&self, image: &PlaneImage<'_>) {
        let PlaneImage { request, extent, sampled, errors, keeps_errors, weighs_shadows, weak, .. } = *image;
        let PlaneImage { readout, slices, work, .. } = *image;
        let weak = weighs_shadows.then_some(weak);
        let (sampled, errors) = (sampled.to_vec(), errors.to_vec());
        let seen = Seen { request, extent, sampled, errors, keeps_errors, weak, readout, slices, work };
        self.seen.lock().unwrap().push(seen);
        let begun = Instant::now();
        while self.stuck.load(Ordering::Relaxed) && begun.elapsed() < PATIENCE {
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    fn nothing(&self, why: &str) {
        assert_eq!(why, "no voxel was seen yet; wait for the first slices");
    }
}

fn viewed_by(viewer: &Arc<Viewer>) -> Set {
    let begin_ns = begin();
    let set = Set::of(poses(begin_ns, COUNT).that_stays(), all_frames(begin_ns, COUNT));
    Set { plane_viewer: Some(Arc::clone(viewer) as Arc<dyn PlaneViewer>), ..set }
}

/// Checks that the last image of each plane equals a sampling of the finished volume.
fn are_the_volume_s(viewer: &Viewer, finished: &Finished) {
    let volume = finished.outcome.as_ref().unwrap().reconstructor.volume();
    let last: BTreeMap<usize, Seen> = viewer.seen().into_iter().map(|seen| (seen.request.number, seen)).collect();
    assert_eq!(last.len(), 3);
    for (number, Seen { request, extent, sampled, .. }) in last {
        let (expected, _) = Planar { volume, place: extent.place, team: None }.sample(&request.section);
        let seen = expected.iter().filter(|sampled| sampled.is_seen()).count();
        assert!(seen > 500 && seen < expected.len(), "{number}: {seen} of {}", expected.len());
        assert!(sampled == expected, "{number}: the bits of the volume");
    }
}

#[test]
fn planes_equal_the_volume_bitwise() {
    let viewer = Arc::new(Viewer { looks: true.into(), ..Viewer::default() });
    let (finished, _) = viewed_by(&viewer).until(|status, _| status.ledger.frames.used == COUNT);
    assert_eq!(frames(&finished), (COUNT, COUNT, vec![]));
    are_the_volume_s(&viewer, &finished);
    let seen = viewer.seen();
    let work = seen.last().unwrap().work;
    println!("{} pictures, {work:?}", seen.len());
    assert_eq!(work.shown, seen.len() as u64);
}

#[test]
fn plane_is_sampled_and_shown_only_on_changes() {
    let viewer = Arc::new(Viewer::default());
    let mut steps = Vec::new();
    let (mut requested, mut last) = (0, PlaneWork::default());
    let begun = Instant::now();
    let (finished, _) = viewed_by(&viewer).until(|status, _| {
        assert!(begun.elapsed() < PATIENCE, "{steps:?}");
        let now = viewer.requested();
        let work = viewer.seen().last().map_or(PlaneWork::default(), |seen| seen.work);
        match steps.len() {
            // Without a viewer, nothing is queried or read.
            0 if status.ledger.frames.used >= PAST => {
                assert_eq!((now, viewer.seen().len()), (0, 0));
                viewer.looks.store(true, Ordering::Relaxed);
            }
            // A new viewer sees all present slices, and the following ones.
            1 if status.ledger.frames.used == COUNT && !viewer.seen().is_empty() => requested = now,
            2 if now >= requested + 4 => (requested, last) = (now, work),
            // Without changes, nothing is done.
            3 if now >= requested + 4 => {
                assert_eq!(work, last);
                requested = now;
                viewer.style.store(1, Ordering::Relaxed);
            }
            // Another style reads and samples nothing.
            4 if now >= requested + 3 => {
                assert_eq!(work, PlaneWork { shown: last.shown + 3, ..last });
                (requested, last) = (now, work);
                viewer.aside.store(9, Ordering::Relaxed);
            }
            // Only a plane that moves is read.
            5 if now >= requested + 3 => {
                let PlaneWork { bricks, planes, shown } = work;
                assert!(bricks > last.bricks);
                assert_eq!((planes, shown), (last.planes + 1, last.shown + 1));
                viewer.looks.store(false, Ordering::Relaxed);
                requested = now;
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
    let slices: Vec<u64> = viewer.of(ACROSS).iter().map(|seen| seen.slices).collect();
    assert_eq!(slices.len(), 2, "{slices:?}");
    let along: Vec<u64> = viewer.of(ALONG).iter().map(|seen| seen.slices).collect();
    println!("across {slices:?}, along {along:?}, oblique {}", viewer.of(OBLIQUE).len());
    assert!(slices[0] == COUNT || along.len() > 3, "{along:?}");
    are_the_volume_s(&viewer, &finished);
}

#[test]
fn stuck_plane_viewer_delays_no_slice() {
    let viewer = Arc::new(Viewer { looks: true.into(), stuck: true.into(), ..Viewer::default() });
    let mut inserted_meanwhile = 0;
    let (finished, _) = viewed_by(&viewer).until(|status, _| {
        if viewer.stuck.load(Ordering::Relaxed) && !viewer.seen().is_empty() {
            inserted_meanwhile = status.ledger.frames.used;
            viewer.stuck.store(inserted_meanwhile < 50, Ordering::Relaxed);
        }
        status.ledger.frames.used == COUNT
    });
    assert!(inserted_meanwhile >= 50, "slices are inserted while nobody answers: {inserted_meanwhile}");
    assert_eq!(frames(&finished), (COUNT, COUNT, vec![]));
    are_the_volume_s(&viewer, &finished);
}

#[test]
fn planes_have_standard_errors_when_asked() {
    let viewer = Arc::new(Viewer { looks: true.into(), ..Viewer::default() });
    let set = Set { standard_error: true, ..viewed_by(&viewer) };
    let (finished, _) = set.until(|status, _| {
        viewer.errors.store(status.ledger.frames.used > COUNT / 2, Ordering::Relaxed);
        status.ledger.frames.used == COUNT
    });
    let reconstructor = &finished.outcome.as_ref().unwrap().reconstructor;
    let errors = reconstructor.standard_errors(0.0).unwrap();
    are_the_volume_s(&viewer, &finished);
    assert!(viewer.seen().iter().all(|seen| seen.keeps_errors && seen.weak.is_none()));
    assert!(viewer.seen().iter().any(|seen| seen.errors.is_empty()), "before they were asked for");
    for number in [ACROSS, ALONG, OBLIQUE] {
        let last = viewer.of(number).pop().unwrap();
        let planar = Planar { volume: &errors, place: last.extent.place, team: None };
        let (expected, _) = planar.sample(&last.request.section);
        assert_eq!(last.errors.len(), expected.len());
        let pairs = last.errors.iter().zip(&expected).filter(|(_, expected)| expected.is_seen());
        // The noise of the whole volume is taken now and then.
        let (near, seen) = pairs.fold((0, 0), |(near, seen), (found, expected)| {
            let is_near = (found.value - expected.value).abs() <= 0.3 * expected.value;
            (near + usize::from(is_near), seen + 1)
        });
        assert!(seen > 500 && near * 10 > seen * 9, "{number}: {near} of {seen}");
        let readout = last.readout.unwrap();
        assert_eq!(Some(readout.value), value_at_place(reconstructor), "{number}");
        assert!(readout.error.unwrap().standard_error > 0.0, "{readout:?}");
    }
}

#[test]
fn edges_at_places_are_answered_without_a_view_of_planes() {
    for standard_error in [true, false] {
        let viewer = Arc::new(Viewer::default());
        let set = Set { standard_error, ..viewed_by(&viewer) };
        let (finished, _) = set.until(|status, _| {
            // Asked when all slices are in the volume.
            viewer.asks.store(status.ledger.frames.used == COUNT, Ordering::Relaxed);
            !viewer.edges.lock().unwrap().is_empty()
        });
        assert!(viewer.seen().is_empty());
        let edges = viewer.edges.lock().unwrap().clone();
        assert_eq!((edges.len(), edges[1]), (2, None), "nothing was seen far away");
        let reconstructor = &finished.outcome.as_ref().unwrap().reconstructor;
        let expected = reconstructor.standard_errors(0.0).and_then(|errors| errors.edge(voxel_at_place()));
        assert_eq!(edges[0].map(|edge| edge.gradient), expected.map(|edge| edge.gradient));
        assert_eq!(expected.is_some(), standard_error);
        if let (Some(edge), Some(expected)) = (edges[0], expected) {
            // The noise of the whole volume is taken from a part of it.
            assert!((edge.standard_error / expected.standard_error - 1.0).abs() < 0.3, "{edge:?} {expected:?}");
        }
    }
}

#[test]
fn planes_tell_the_weight_below_which_places_are_weakly_seen() {
    let viewer = Arc::new(Viewer { looks: true.into(), ..Viewer::default() });
    let set = Set { shadow_weights: true, ..viewed_by(&viewer) };
    let (finished, _) = set.until(|status, _| {
        // As a page does, the viewer changes its style with what it shows.
        if status.ledger.frames.used > COUNT / 2 && !viewer.seen().is_empty() {
            viewer.weakly_seen.store(true, Ordering::Relaxed);
            viewer.style.store(1, Ordering::Relaxed);
        }
        status.ledger.frames.used == COUNT
    });
    are_the_volume_s(&viewer, &finished);
    let all: Vec<f32> = viewer.seen().iter().map(|seen| seen.weak.unwrap()).collect();
    assert_eq!(all[0], 0.0, "before it was asked for");
    // The planes through the middle have the weights of the whole volume.
    let reconstructor = &finished.outcome.as_ref().unwrap().reconstructor;
    assert_eq!(finished.status.dark_slices, Some(reconstructor.work().without_shadows));
    let volume = reconstructor.volume();
    let mut weights = Vec::new();
    for brick in volume.bricks() {
        let [mut values, mut of_brick] = [[0.0; VOXELS]; 2];
        volume.brick(brick, &mut values, &mut of_brick);
        weights.extend(of_brick.into_iter().filter(|weight| *weight > SEEN));
    }
    weights.sort_unstable_by(f32::total_cmp);
    let expected = 0.05 * weights[weights.len() / 2];
    for number in [ALONG, OBLIQUE] {
        let weak = viewer.of(number).pop().unwrap().weak.unwrap();
        assert!((weak / expected - 1.0).abs() < 0.3, "{number}: {weak} {expected}");
    }
}

/// Returns the finished volume's value at the place that is read out.
fn value_at_place(reconstructor: &PathReconstructor) -> Option<f32> {
    let (r, w) = reconstructor.volume().voxel(voxel_at_place());
    (w > 0.0).then(|| r / w)
}

fn voxel_at_place() -> [i64; 3] {
    PLACE.round().to_array().map(|x| x as i64)
}
