//! Commands of viewers to a running session: freeze it, clear its volume, view it after its end.
//! All are in the recording.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use drivers::replay::Pace;
use formats::session::WriterOptions;
use mask::MaskShape;
use pipeline::MaskOrigin;
use pipeline::command::{Command, MaskChange};
use pipeline::session::{Drawn, First, NoVolume, Reader, Session, Snapshot, ViewClient, VolumeRequest, run};
use render::classify::transfer::Transfer;
use render::{RenderSettings, Renderer};
use sonoweave_core::clock::{Monotonic, SECOND};
use sonoweave_core::refusal::Reason;
use sonoweave_core::region::ClipRect;

use crate::replay::again;
use crate::script::{FRAME, begin, frames as all_frames, height_mm, poses};
use crate::set::{Memory, Set, frames, seen_at, stages};

const FRAMES: u64 = 90;

/// A viewer that counts.
#[derive(Default)]
struct Eye {
    pictures: AtomicU64,
    /// Whether the last picture was empty.
    blank: AtomicBool,
    blanks: AtomicU64,
    /// Number of occasions to ask questions about the picture.
    moments: AtomicU64,
}

impl ViewClient for Eye {
    fn settings(&self, _: &First) -> Result<RenderSettings, Box<dyn std::error::Error + Send + Sync>> {
        Ok(RenderSettings::new([32, 32], Transfer::preset("tissue", [0.0, 255.0])?))
    }

    fn answer(&self, shown: Option<&Renderer>) {
        self.moments.fetch_add(u64::from(shown.is_some()), Ordering::Relaxed);
    }

    fn shown(&self, drawn: &Drawn) {
        let blank = drawn.renderer.picture().pixels.iter().all(|[red, green, blue, _]| red + green + blue == 0.0);
        self.pictures.fetch_add(1, Ordering::Relaxed);
        self.blanks.fetch_add(u64::from(blank), Ordering::Relaxed);
        self.blank.store(blank, Ordering::Relaxed);
    }
}

#[test]
fn session_ends_if_its_watcher_panics() {
    // Devices that send for 20 s.
    let (begin_ns, frames, disk) = (begin(), 500, Memory::default());
    let set = Set::of(poses(begin_ns, frames), all_frames(begin_ns, frames));
    let set = Set { looks: Some(Arc::new(Eye::default()) as Arc<dyn ViewClient>), ..set };
    let set = set.recorded(disk.clone(), WriterOptions::new("a test"), 0);
    let session = std::thread::spawn(|| {
        set.until(|status, _| {
            assert!(status.ledger.frames.used < 3, "as planned");
            false
        })
    });
    // One that does not end must not hang the tests.
    let begun = Instant::now();
    while !session.is_finished() {
        assert!(begun.elapsed() < Duration::from_secs(120), "it goes on");
        std::thread::sleep(Duration::from_millis(10));
    }
    assert!(session.join().is_err());
    let recorded = again(&disk, SECOND, Pace::Unpaced, false, |_, _| {}).0.status.ledger.frames.total;
    assert!((3..frames / 2).contains(&recorded), "{recorded} frames are recorded");
}

#[test]
fn freezing_and_clearing_are_repeated_by_the_replay() {
    let begin_ns = begin();
    let disk = Memory::default();
    let eye = Arc::new(Eye::default());
    let mut set = Set::of(poses(begin_ns, FRAMES), all_frames(begin_ns, FRAMES)).waits(SECOND).recorded(
        disk.clone(),
        WriterOptions::new("a test"),
        0,
    );
    set.looks = Some(Arc::clone(&eye) as Arc<dyn ViewClient>);
    let mut done = 0;
    let (live, _) = set.instructed(|status, _| {
        let used = status.ledger.frames.used;
        let frozen = status.ledger.frames.refused.get(&Reason::Frozen).copied().unwrap_or(0);
        let (due, command) = match done {
            0 => (used >= 20, Command::Freeze(true)),
            1 => (frozen >= 10, Command::Freeze(false)),
            2 => (used >= 40, Command::Clear),
            _ => (false, Command::Clear),
        };
        assert!(status.frozen || done != 1 || frozen == 0, "what is frozen says so");
        Some(if due {
            done += 1;
            vec![command.into()]
        } else {
            Vec::new()
        })
    });
    assert_eq!(done, 3);
    let (total, used, refused) = frames(&live);
    let [(Reason::Frozen, frozen)] = refused[..] else { panic!("{refused:?}") };
    assert!(frozen >= 10, "{frozen}");
    assert_eq!((total, used + frozen), (FRAMES, FRAMES));
    // The slices before the clearing and those while frozen are absent; the later ones are
    // present.
    assert!(!seen_at(&live, height_mm(5 * FRAME)) && seen_at(&live, height_mm((FRAMES as i64 - 2) * FRAME)));
    let digest = live.digest.clone().unwrap();
    assert!(digest.slices < used && digest.slices >= 5, "{digest:?} of {used}");
    assert_eq!(live.status.volume.unwrap().slices, digest.slices);
    assert!(eye.blanks.load(Ordering::Relaxed) >= 1, "a volume that is cleared is seen to be empty");
    assert!(!eye.blank.load(Ordering::Relaxed));
    for pace in [Pace::Unpaced, Pace::Factor(4.0)] {
        let (replayed, decisions) = again(&disk, SECOND, pace, false, |session, _| {
            session.view_client = Some(Arc::new(Eye::default()) as Arc<dyn ViewClient>);
        });
        assert_eq!(decisions.differences().first, None);
        assert_eq!(replayed.digest.as_ref(), Some(&digest));
        assert_eq!(frames(&replayed), (total, used, refused.clone()));
    }
}

#[test]
fn changed_mask_holds_for_later_slices_and_is_replayed() {
    let begin_ns = begin();
    let disk = Memory::default();
    let set = Set::of(poses(begin_ns, FRAMES), all_frames(begin_ns, FRAMES)).waits(SECOND).recorded(
        disk.clone(),
        WriterOptions::new("a test"),
        0,
    );
    let mut done = 0;
    let rect = Mutex::new(None);
    let (live, _) = set.instructed(|status, _| {
        let used = status.ledger.frames.used;
        let Some(mask) = &status.mask else { return Some(Vec::new()) };
        let [width, height] = mask.size_px;
        let half = ClipRect { x: 0, y: 0, width: width / 2, height };
        *rect.lock().unwrap() = Some(half);
        let beyond = ClipRect { width: width + 1, ..half };
        let (due, change) = match done {
            0 => (used >= 10, MaskChange::Keep),
            1 => (used >= 20, MaskChange::Rectangle(half)),
            // The controller refuses this one; a session that receives it keeps its mask.
            2 => (used >= 30, MaskChange::Rectangle(beyond)),
            _ => (false, MaskChange::Keep),
        };
        Some(if due {
            done += 1;
            vec![Command::Mask(change).into()]
        } else {
            Vec::new()
        })
    });
    assert_eq!(done, 3);
    let (total, used, _) = frames(&live);
    assert_eq!((total, used), (FRAMES, FRAMES), "no frame is lost");
    let mask = live.status.mask.clone().unwrap();
    let half = rect.lock().unwrap().unwrap();
    assert_eq!((mask.origin, mask.found.shape), (MaskOrigin::Operator, MaskShape::Rectangle(half)));
    assert!(
        live.status.notes.iter().any(|note| note.starts_with("the mask is not changed: ")),
        "{:?}",
        live.status.notes
    );
    let outcome = live.outcome.as_ref().unwrap();
    assert_eq!(outcome.mask.mask.bounds(), Some(half));
    let pixels = outcome.reconstructor.work().filter.pixels;
    let of_frame = u64::from(mask.size_px[0] * mask.size_px[1]);
    assert!(pixels > FRAMES * of_frame / 2 && pixels < FRAMES * of_frame, "{pixels}: only later slices are halved");
    for pace in [Pace::Unpaced, Pace::Factor(4.0)] {
        let (replayed, decisions) = again(&disk, SECOND, pace, false, |_, _| {});
        assert_eq!(decisions.differences().first, None);
        assert_eq!(replayed.digest, live.digest);
        assert_eq!(replayed.status.mask.unwrap(), mask);
    }
}

#[test]
fn cleared_empty_volume_gives_no_outputs() {
    let begin_ns = begin();
    let disk = Memory::default();
    let mut set = Set::of(poses(begin_ns, 40), all_frames(begin_ns, 40)).waits(SECOND).recorded(
        disk.clone(),
        WriterOptions::new("a test"),
        0,
    );
    set.looks = Some(Arc::new(Eye::default()) as Arc<dyn ViewClient>);
    let mut done = false;
    let (live, _) = set.instructed(|status, _| {
        let due = !done && status.ledger.frames.used >= 20;
        done |= due;
        Some(if due { vec![Command::Freeze(true).into(), Command::Clear.into()] } else { Vec::new() })
    });
    assert!(live.outcome.is_none() && live.drawn.is_none() && live.status.volume.is_none());
    let (replayed, decisions) = again(&disk, SECOND, Pace::Unpaced, false, |session, _| {
        session.view_client = Some(Arc::new(Eye::default()) as Arc<dyn ViewClient>);
    });
    assert_eq!(decisions.differences().first, None);
    assert_eq!(replayed.digest, live.digest);
}

#[test]
fn stop_command_ends_session_with_slices_so_far() {
    let begin_ns = begin();
    let set = Set::of(poses(begin_ns, FRAMES), all_frames(begin_ns, FRAMES)).waits(SECOND);
    let (live, _) = set.instructed(|status, _| {
        let due = status.ledger.frames.used >= 20;
        Some(if due { vec![Command::Stop.into()] } else { Vec::new() })
    });
    let (_, used, _) = frames(&live);
    assert!((20..FRAMES).contains(&used) && live.outcome.is_some(), "{used}");
}

/// A reader that requests a volume once.
#[derive(Default)]
struct Once {
    wants: AtomicBool,
    got: Mutex<Option<Result<Snapshot, NoVolume>>>,
    shares: Mutex<Vec<f64>>,
}

impl Reader for Once {
    fn request(&self) -> VolumeRequest {
        if self.wants.swap(false, Ordering::Relaxed) { VolumeRequest::Now } else { VolumeRequest::None }
    }

    fn volume(&self, volume: Result<Snapshot, NoVolume>) {
        *self.got.lock().unwrap() = Some(volume);
    }

    fn with_weights(&self) -> bool {
        true
    }

    fn progress(&self, share: f64) {
        self.shares.lock().unwrap().push(share);
    }

    fn max_bytes(&self) -> u64 {
        1 << 30
    }
}

#[test]
fn ended_session_is_rendered_and_read_while_viewed() {
    let begin_ns = begin();
    let eye = Arc::new(Eye::default());
    let once = Arc::new(Once::default());
    let set = Set::of(poses(begin_ns, 30), all_frames(begin_ns, 30));
    let session = Session {
        readers: vec![Arc::clone(&once) as Arc<dyn Reader>],
        ..stages(SECOND, Some(Arc::clone(&eye) as Arc<dyn ViewClient>))
    };
    let held = run(&session, set.inputs(), &Monotonic, &AtomicBool::new(false), |_| Vec::new()).unwrap();
    assert_eq!(held.status().ledger.frames.used, 30);
    assert!(held.has_volume() && once.got.lock().unwrap().is_none());
    let before = eye.pictures.load(Ordering::Relaxed);
    assert!(eye.moments.swap(0, Ordering::Relaxed) > 0, "who looks may ask");
    once.wants.store(true, Ordering::Relaxed);
    let (ends, began) = (AtomicBool::new(false), Instant::now());
    held.serve(&ends, |status| {
        assert_eq!(status.ledger.frames.used, 30);
        let drawn = eye.pictures.load(Ordering::Relaxed) > before && eye.moments.load(Ordering::Relaxed) > 2;
        let seen = drawn && once.got.lock().unwrap().is_some();
        ends.store(seen || began.elapsed() > Duration::from_secs(30), Ordering::Relaxed);
        Vec::new()
    });
    assert!(eye.pictures.load(Ordering::Relaxed) > before && !eye.blank.load(Ordering::Relaxed));
    assert!(eye.moments.load(Ordering::Relaxed) > 2, "of what is over, too");
    let snapshot = once.got.lock().unwrap().take().unwrap().unwrap();
    let voxels = snapshot.space.grid.voxels().unwrap() as usize;
    let weights = snapshot.weights.unwrap();
    assert_eq!((snapshot.slices, snapshot.bytes.len(), weights.len()), (30, voxels, 4 * voxels));
    let seen = weights.chunks_exact(4).filter(|weight| f32::from_ne_bytes((*weight).try_into().unwrap()) > 0.0).count();
    assert!(seen > voxels / 4, "{seen} of {voxels}");
    assert_eq!(once.shares.lock().unwrap().last(), Some(&1.0));
    // The ended session was only viewed: its results are unchanged.
    let (low, _) = held.finish().outcome.unwrap().reconstructor.volume().seen_bounds().unwrap();
    assert_eq!(low, snapshot.space.first);
}
