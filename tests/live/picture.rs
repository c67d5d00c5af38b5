//! A slow, stuck or failing viewer does not delay insertion.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use pipeline::session::{Drawn, First, ViewClient};
use render::RenderSettings;
use render::camera::View;
use render::classify::transfer::Transfer;

use crate::script::{begin, frames as all_frames, poses};
use crate::set::{Set, frames};

/// Frames of each of these sessions.
const COUNT: u64 = 50;

/// A viewer.
struct Viewer {
    /// The viewer blocks until this is set.
    answers: Arc<AtomicBool>,
    unable: bool,
    most_hz: f64,
}

impl ViewClient for Viewer {
    fn settings(&self, _: &First) -> Result<RenderSettings, Box<dyn std::error::Error + Send + Sync>> {
        // If the session waits for the viewer, it has failed, and is to end.
        let begun = Instant::now();
        while !self.answers.load(Ordering::Relaxed) && begun.elapsed() < Duration::from_secs(20) {
            std::thread::sleep(Duration::from_millis(2));
        }
        self.answers.store(true, Ordering::Relaxed);
        if self.unable {
            return Err("there is no such transfer function any more".into());
        }
        Ok(RenderSettings::new([64, 64], Transfer::preset("tissue", [0.0, 255.0])?))
    }

    fn most_hz(&self) -> f64 {
        self.most_hz
    }
}

fn viewed_by(viewer: Viewer) -> Set {
    let begin_ns = begin();
    let set = Set::of(poses(begin_ns, COUNT), all_frames(begin_ns, COUNT));
    Set { looks: Some(Arc::new(viewer)), ..set }
}

#[test]
fn stuck_viewer_delays_no_slice_and_skips_are_counted() {
    let answers = Arc::new(AtomicBool::new(false));
    let mut inserted_meanwhile = 0;
    let set = viewed_by(Viewer { answers: Arc::clone(&answers), unable: false, most_hz: 1e9 });
    let (finished, _) = set.until(|status, _| {
        if !answers.load(Ordering::Relaxed) {
            inserted_meanwhile = status.ledger.frames.used;
            answers.store(inserted_meanwhile >= 30, Ordering::Relaxed);
        }
        false
    });
    assert!(inserted_meanwhile >= 30, "slices are inserted while nobody answers");
    assert_eq!(frames(&finished), (COUNT, COUNT, vec![]));
    let drawn = finished.drawn.as_ref().unwrap();
    // Each slice is rendered by itself or with a later one.
    assert_eq!(drawn.pictures + drawn.skipped, COUNT, "{} {}", drawn.pictures, drawn.skipped);
    assert!(drawn.skipped >= 29, "{}", drawn.skipped);
    // The volume is read at least once for each picture, and more often if it is read in parts.
    assert!(drawn.held.quantiles().unwrap().count >= drawn.pictures);
    println!("held {:?}, drawn {:?}", drawn.held.quantiles(), drawn.draw.quantiles());
}

#[test]
fn failing_viewer_is_reported_and_volume_is_complete() {
    let (finished, _) = viewed_by(Viewer { answers: Arc::new(true.into()), unable: true, most_hz: 30.0 }).run();
    assert_eq!(frames(&finished), (COUNT, COUNT, vec![]));
    assert!(finished.drawn.is_none() && finished.outcome.is_some());
    let notes = &finished.status.notes;
    assert!(notes.iter().any(|note| note == "no picture: there is no such transfer function any more"), "{notes:?}");
}

#[test]
fn picture_rate_is_limited_and_last_shows_all_slices() {
    let begun = Instant::now();
    let (finished, _) = viewed_by(Viewer { answers: Arc::new(true.into()), unable: false, most_hz: 4.0 }).run();
    let seconds = begun.elapsed().as_secs_f64();
    let drawn = finished.drawn.as_ref().unwrap();
    // The first and the last picture are additional, and two may come early.
    assert!(drawn.pictures as f64 <= 4.0 * seconds + 4.0, "{} in {seconds} s", drawn.pictures);
    assert!(drawn.pictures >= 2);
    assert_eq!(drawn.pictures + drawn.skipped, COUNT);
}

/// A viewer that notes the nice values of the threads that call it.
#[derive(Default)]
struct Weighed {
    /// Nice values of the rendering threads, and of the thread that reads the volume.
    draw: std::sync::Mutex<Vec<i32>>,
    read: std::sync::Mutex<Vec<i32>>,
}

fn nice() -> i32 {
    rustix::process::getpriority_process(None).unwrap()
}

impl ViewClient for Weighed {
    fn settings(&self, _: &First) -> Result<RenderSettings, Box<dyn std::error::Error + Send + Sync>> {
        self.draw.lock().unwrap().push(nice());
        Ok(RenderSettings::new([64, 64], Transfer::preset("tissue", [0.0, 255.0])?))
    }

    fn shown(&self, _: &Drawn) {
        self.draw.lock().unwrap().push(nice());
    }

    fn is_watched(&self) -> bool {
        self.read.lock().unwrap().push(nice());
        true
    }
}

#[test]
fn rendering_thread_is_nice_and_volume_reader_is_not() {
    let weighed = Arc::new(Weighed::default());
    let begin_ns = begin();
    let set = Set::of(poses(begin_ns, COUNT), all_frames(begin_ns, COUNT));
    let (finished, _) = Set { looks: Some(Arc::clone(&weighed) as Arc<dyn ViewClient>), ..set }.run();
    assert_eq!(frames(&finished), (COUNT, COUNT, vec![]));
    let [draw, read] = [&weighed.draw, &weighed.read].map(|of| of.lock().unwrap().clone());
    let own = nice();
    assert!(draw.len() > 1 && draw.iter().all(|nice| *nice == own.max(10)), "{draw:?}");
    assert!(!read.is_empty() && read.iter().all(|nice| *nice == own), "{read:?}");
}

/// A viewer that comes on request, then views from another side, and leaves.
struct Visitor {
    there: AtomicBool,
    turned: AtomicBool,
    lasting: bool,
    seen: std::sync::Mutex<Vec<(bool, u64)>>,
}

impl Visitor {
    fn new(lasting: bool) -> Arc<Self> {
        let (there, turned) = (false.into(), false.into());
        Arc::new(Self { there, turned, lasting, seen: Default::default() })
    }

    fn seen(&self) -> Vec<(bool, u64)> {
        self.seen.lock().unwrap().clone()
    }
}

const ASIDE: f64 = 55.0;

impl ViewClient for Visitor {
    fn settings(&self, _: &First) -> Result<RenderSettings, Box<dyn std::error::Error + Send + Sync>> {
        Ok(RenderSettings::new([64, 64], Transfer::preset("tissue", [0.0, 255.0])?))
    }

    fn is_watched(&self) -> bool {
        self.there.load(Ordering::Relaxed)
    }

    fn keeps_last(&self) -> bool {
        self.lasting
    }

    fn view(&self, home: View) -> View {
        if self.turned.load(Ordering::Relaxed) { View { azimuth: ASIDE, zoom: 0.5, ..home } } else { home }
    }

    fn turn(&self) -> Duration {
        Duration::from_millis(5)
    }

    fn shown(&self, drawn: &Drawn) {
        let forward = View { azimuth: ASIDE, ..View::default() }.axes().forward;
        let is_aside = (drawn.renderer.camera().axes().forward - forward).length() < 1e-9;
        self.seen.lock().unwrap().push((is_aside && !drawn.refining, drawn.slices));
    }
}

/// A session that continues until a command ends it.
fn visited(visitor: &Arc<Visitor>, mut ends: impl FnMut(u64) -> bool) -> pipeline::session::Finished {
    let begin_ns = begin();
    let set = Set::of(poses(begin_ns, COUNT).that_stays(), all_frames(begin_ns, COUNT));
    let begun = Instant::now();
    let set = Set { looks: Some(Arc::clone(visitor) as Arc<dyn ViewClient>), ..set };
    let (finished, _) =
        set.until(|status, _| ends(status.ledger.frames.used) || begun.elapsed() > Duration::from_secs(20));
    assert_eq!(frames(&finished), (COUNT, COUNT, vec![]));
    finished
}

#[test]
fn without_viewer_only_the_final_picture_is_rendered() {
    let visitor = Visitor::new(false);
    let finished = visited(&visitor, |used| used == COUNT);
    assert_eq!((visitor.seen(), finished.status.pictures), (Vec::new(), 0));
    assert!(finished.drawn.is_none());
    let visitor = Visitor::new(true);
    let finished = visited(&visitor, |used| used == COUNT);
    let drawn = finished.drawn.unwrap();
    assert_eq!((visitor.seen(), drawn.pictures, drawn.slices), (vec![(false, COUNT)], 1, COUNT));
}

#[test]
fn late_viewer_sees_all_and_last_picture_uses_home_view() {
    let never = Visitor::new(true);
    let expected = visited(&never, |used| used == COUNT).drawn.unwrap();
    let visitor = Visitor::new(true);
    let finished = visited(&visitor, |used| {
        if used < COUNT {
            return false;
        }
        // All slices are inserted, and there was no viewer yet.
        visitor.there.store(true, Ordering::Relaxed);
        let seen = visitor.seen();
        visitor.turned.store(seen.contains(&(false, COUNT)), Ordering::Relaxed);
        seen.contains(&(true, COUNT))
    });
    assert!(visitor.seen().contains(&(true, COUNT)), "the new view was refined to its end: {:?}", visitor.seen());
    let drawn = finished.drawn.unwrap();
    assert!(drawn.renderer.picture() == expected.renderer.picture(), "the last one is from home");
    assert!(drawn.pictures <= visitor.seen().len() as u64);
}

/// A viewer that changes the style of the picture, and resets it.
#[derive(Default)]
struct Restyler {
    worn: AtomicU64,
    asked: AtomicU64,
    seen: std::sync::Mutex<Vec<(u64, render::Picture)>>,
}

impl Restyler {
    fn pictures(&self) -> usize {
        self.seen.lock().unwrap().len()
    }
}

impl ViewClient for Restyler {
    fn settings(&self, _: &First) -> Result<RenderSettings, Box<dyn std::error::Error + Send + Sync>> {
        Ok(RenderSettings::new([64, 64], Transfer::preset("tissue", [0.0, 255.0])?))
    }

    fn style_revision(&self) -> u64 {
        self.asked.fetch_add(1, Ordering::Relaxed);
        self.worn.load(Ordering::Relaxed)
    }

    fn restyle(&self, settings: &mut RenderSettings) {
        if self.worn.load(Ordering::Relaxed) > 0 {
            settings.transfer = Transfer::preset("xray", [0.0, 255.0]).unwrap();
        }
    }

    fn turn(&self) -> Duration {
        Duration::from_millis(5)
    }

    fn shown(&self, drawn: &Drawn) {
        self.seen.lock().unwrap().push((drawn.slices, drawn.renderer.picture()));
    }
}

#[test]
fn new_style_renders_once_and_last_picture_is_as_configured() {
    let never = Visitor::new(true);
    let expected = visited(&never, |used| used == COUNT).drawn.unwrap();
    let viewer = Arc::new(Restyler::default());
    let begin_ns = begin();
    let set = Set::of(poses(begin_ns, COUNT).that_stays(), all_frames(begin_ns, COUNT));
    let set = Set { looks: Some(Arc::clone(&viewer) as Arc<dyn ViewClient>), ..set };
    let begun = Instant::now();
    let (mut step, mut asked, mut pictures) = (0, 0, 0);
    let (finished, _) = set.until(|_, _| {
        assert!(begun.elapsed() < Duration::from_secs(20), "step {step}");
        let now = viewer.asked.load(Ordering::Relaxed);
        let whole = viewer.seen.lock().unwrap().last().is_some_and(|(slices, _)| *slices == COUNT);
        match step {
            0 if whole => (step, pictures) = (1, viewer.pictures()),
            1 => {
                viewer.worn.store(1, Ordering::Relaxed);
                step = 2;
            }
            2 if viewer.pictures() > pictures => (step, asked) = (3, now),
            // It was rendered once, and is not rendered again.
            3 if now > asked + 5 => {
                assert_eq!(viewer.pictures(), pictures + 1);
                return true;
            }
            _ => {}
        }
        false
    });
    let seen = viewer.seen.lock().unwrap();
    assert!(seen[pictures - 1].1 == expected.renderer.picture() && seen[pictures].1 != expected.renderer.picture());
    let drawn = finished.drawn.unwrap();
    assert!(drawn.renderer.picture() == expected.renderer.picture(), "the last one is as configured");
}
