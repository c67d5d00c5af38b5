//! Whoever looks may be slow, stuck or unable to: what is woven is not.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use sonoweave::pipeline::live::{Drawn, First, Looks};
use sonoweave::render::RenderSettings;
use sonoweave::render::camera::View;
use sonoweave::render::transfer::Transfer;

use crate::script::{begin, frames as all_frames, poses};
use crate::set::{Set, frames};

/// Frames of each of these sessions.
const COUNT: u64 = 50;

/// Somebody who looks.
struct Viewer {
    /// Nothing is answered until this is set.
    answers: Arc<AtomicBool>,
    unable: bool,
    most_hz: f64,
}

impl Looks for Viewer {
    fn settings(&self, _: &First) -> Result<RenderSettings, Box<dyn std::error::Error + Send + Sync>> {
        // A session that waits for it has failed then, and is to end.
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

fn looked_at(viewer: Viewer) -> Set {
    let begin_ns = begin();
    let set = Set::of(poses(begin_ns, COUNT), all_frames(begin_ns, COUNT));
    Set { looks: Some(Arc::new(viewer)), ..set }
}

#[test]
fn a_viewer_that_is_stuck_stops_no_slice_and_what_it_skipped_is_counted() {
    let answers = Arc::new(AtomicBool::new(false));
    let mut woven_meanwhile = 0;
    let set = looked_at(Viewer { answers: Arc::clone(&answers), unable: false, most_hz: 1e9 });
    let (finished, _) = set.until(|account, _| {
        if !answers.load(Ordering::Relaxed) {
            woven_meanwhile = account.ledger.frames.used;
            answers.store(woven_meanwhile >= 30, Ordering::Relaxed);
        }
        false
    });
    assert!(woven_meanwhile >= 30, "slices are woven while nobody answers");
    assert_eq!(frames(&finished), (COUNT, COUNT, vec![]));
    let drawn = finished.drawn.as_ref().unwrap();
    // Each slice is drawn by itself or with a later one.
    assert_eq!(drawn.pictures + drawn.skipped, COUNT, "{} {}", drawn.pictures, drawn.skipped);
    assert!(drawn.skipped >= 29, "{}", drawn.skipped);
    assert_eq!(drawn.held.quantiles().unwrap().count, drawn.pictures);
    println!("held {:?}, drawn {:?}", drawn.held.quantiles(), drawn.draw.quantiles());
}

#[test]
fn a_viewer_that_is_unable_to_look_is_told_of_and_the_volume_is_whole() {
    let (finished, _) = looked_at(Viewer { answers: Arc::new(true.into()), unable: true, most_hz: 30.0 }).run();
    assert_eq!(frames(&finished), (COUNT, COUNT, vec![]));
    assert!(finished.drawn.is_none() && finished.outcome.is_some());
    let notes = &finished.account.notes;
    assert!(notes.iter().any(|note| note == "no picture: there is no such transfer function any more"), "{notes:?}");
}

#[test]
fn no_more_pictures_are_drawn_than_are_asked_for_and_the_last_is_of_all_slices() {
    let begun = Instant::now();
    let (finished, _) = looked_at(Viewer { answers: Arc::new(true.into()), unable: false, most_hz: 4.0 }).run();
    let seconds = begun.elapsed().as_secs_f64();
    let drawn = finished.drawn.as_ref().unwrap();
    // The first and the last come on top.
    assert!(drawn.pictures as f64 <= 4.0 * seconds + 2.0, "{} in {seconds} s", drawn.pictures);
    assert!(drawn.pictures >= 2);
    assert_eq!(drawn.pictures + drawn.skipped, COUNT);
}

/// Somebody who notes how nice the threads are that ask him something.
#[derive(Default)]
struct Weighed {
    /// Those that draw, and that which reads the volume.
    draw: std::sync::Mutex<Vec<i32>>,
    read: std::sync::Mutex<Vec<i32>>,
}

fn nice() -> i32 {
    rustix::process::getpriority_process(None).unwrap()
}

impl Looks for Weighed {
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
fn drawing_gives_way_and_who_holds_the_volume_does_not() {
    let weighed = Arc::new(Weighed::default());
    let begin_ns = begin();
    let set = Set::of(poses(begin_ns, COUNT), all_frames(begin_ns, COUNT));
    let (finished, _) = Set { looks: Some(Arc::clone(&weighed) as Arc<dyn Looks>), ..set }.run();
    assert_eq!(frames(&finished), (COUNT, COUNT, vec![]));
    let [draw, read] = [&weighed.draw, &weighed.read].map(|of| of.lock().unwrap().clone());
    let own = nice();
    assert!(draw.len() > 1 && draw.iter().all(|nice| *nice == own.max(10)), "{draw:?}");
    assert!(!read.is_empty() && read.iter().all(|nice| *nice == own), "{read:?}");
}

/// Somebody who comes when he is told to, looks from another side then, and leaves.
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

impl Looks for Visitor {
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

/// A session that goes on until it is told to end.
fn visited(visitor: &Arc<Visitor>, mut ends: impl FnMut(u64) -> bool) -> sonoweave::pipeline::live::Finished {
    let begin_ns = begin();
    let set = Set::of(poses(begin_ns, COUNT).that_stays(), all_frames(begin_ns, COUNT));
    let begun = Instant::now();
    let set = Set { looks: Some(Arc::clone(visitor) as Arc<dyn Looks>), ..set };
    let (finished, _) =
        set.until(|account, _| ends(account.ledger.frames.used) || begun.elapsed() > Duration::from_secs(20));
    assert_eq!(frames(&finished), (COUNT, COUNT, vec![]));
    finished
}

#[test]
fn while_nobody_looks_nothing_is_drawn_and_in_the_end_only_what_is_wanted() {
    let visitor = Visitor::new(false);
    let finished = visited(&visitor, |used| used == COUNT);
    assert_eq!((visitor.seen(), finished.account.pictures), (Vec::new(), 0));
    assert!(finished.drawn.is_none());
    let visitor = Visitor::new(true);
    let finished = visited(&visitor, |used| used == COUNT);
    let drawn = finished.drawn.unwrap();
    assert_eq!((visitor.seen(), drawn.pictures, drawn.slices), (vec![(false, COUNT)], 1, COUNT));
}

#[test]
fn who_comes_late_sees_all_that_there_is_turns_it_and_the_last_picture_is_from_home_to_the_bit() {
    let never = Visitor::new(true);
    let expected = visited(&never, |used| used == COUNT).drawn.unwrap();
    let visitor = Visitor::new(true);
    let finished = visited(&visitor, |used| {
        if used < COUNT {
            return false;
        }
        // All is woven, and nobody has looked yet.
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

/// Somebody who puts another look on what is drawn, and takes it off again.
#[derive(Default)]
struct Dresser {
    worn: AtomicU64,
    asked: AtomicU64,
    seen: std::sync::Mutex<Vec<(u64, sonoweave::render::Picture)>>,
}

impl Dresser {
    fn pictures(&self) -> usize {
        self.seen.lock().unwrap().len()
    }
}

impl Looks for Dresser {
    fn settings(&self, _: &First) -> Result<RenderSettings, Box<dyn std::error::Error + Send + Sync>> {
        Ok(RenderSettings::new([64, 64], Transfer::preset("tissue", [0.0, 255.0])?))
    }

    fn dressing(&self) -> u64 {
        self.asked.fetch_add(1, Ordering::Relaxed);
        self.worn.load(Ordering::Relaxed)
    }

    fn dress(&self, settings: &mut RenderSettings) {
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
fn another_look_is_drawn_once_and_the_last_picture_is_as_configured_to_the_bit() {
    let never = Visitor::new(true);
    let expected = visited(&never, |used| used == COUNT).drawn.unwrap();
    let dresser = Arc::new(Dresser::default());
    let begin_ns = begin();
    let set = Set::of(poses(begin_ns, COUNT).that_stays(), all_frames(begin_ns, COUNT));
    let set = Set { looks: Some(Arc::clone(&dresser) as Arc<dyn Looks>), ..set };
    let begun = Instant::now();
    let (mut step, mut asked, mut pictures) = (0, 0, 0);
    let (finished, _) = set.until(|_, _| {
        assert!(begun.elapsed() < Duration::from_secs(20), "step {step}");
        let now = dresser.asked.load(Ordering::Relaxed);
        let whole = dresser.seen.lock().unwrap().last().is_some_and(|(slices, _)| *slices == COUNT);
        match step {
            0 if whole => (step, pictures) = (1, dresser.pictures()),
            1 => {
                dresser.worn.store(1, Ordering::Relaxed);
                step = 2;
            }
            2 if dresser.pictures() > pictures => (step, asked) = (3, now),
            // It was drawn, and is not drawn again.
            3 if now > asked + 5 => {
                assert_eq!(dresser.pictures(), pictures + 1);
                return true;
            }
            _ => {}
        }
        false
    });
    let seen = dresser.seen.lock().unwrap();
    assert!(seen[pictures - 1].1 == expected.renderer.picture() && seen[pictures].1 != expected.renderer.picture());
    let drawn = finished.drawn.unwrap();
    assert!(drawn.renderer.picture() == expected.renderer.picture(), "the last one is as configured");
}
