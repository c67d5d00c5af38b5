//! Live: devices to a volume and its picture, each stage in a thread of its own.
//!
//! ```text
//! capture (one a device) ──▶ pairing ──▶ weaving ══ volume ══ picture
//!      └──────────┬────────────┴────────────┘
//!              recording
//! ```
//!
//! | between | holds | when it is full |
//! |---|---|---|
//! | capture → pairing | 4096 readings, and of frames as many as fit 256 MB all stages together | the reading is dropped, counted as such; it is in the recording |
//! | pairing → weaving | 64 slices | the slice that comes is dropped, and counted: those that wait are older, and what they show would be lost for good |
//! | weaving → picture | the bricks that changed | never: a picture is of all slices there are when it is begun |
//! | all → recording | 4096 messages, frames 3072, and 64 MB in the writer | frames first, then everything; counted and said in the recording |
//!
//! - `capture`: a device's thread.
//! - `pairing`: readings to posed slices.
//! - `weave`, `fabric`: slices into the volume, and the lock that weaving and drawing share it by.
//! - `picture`, `reach`: the picture, and the box it is of.
//! - `recorder`: the session's file.
//! - `board`, `timing`: what the stages say of themselves.

mod board;
mod capture;
mod fabric;
mod pairing;
mod picture;
mod reach;
mod recorder;
mod timing;
mod weave;

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{Builder, Scope, ScopedJoinHandle};
use std::time::Duration;

use crossbeam_channel::bounded;
use drivers::Device;
use drivers::clock::Clock;
use drivers::recording::session::{Crop, SessionWriter, Speech};

pub use board::{Account, DeviceBoard};
pub use picture::{Drawn, First, Looks};
pub use recorder::Recording;
pub use timing::{Quantiles, Spread};

use super::loom::{Loom, Plan};
use super::{OffPlane, Outcome, PipelineError};
use crate::ingest::live::{Gives, LiveIngest};
use crate::mask::MaskSettings;
use crate::path::{Chosen, PathChoice};
use crate::reconstruct::planar::PlanarSettings;
use crate::reconstruct::{Path, Settings};
use crate::sync::PairingOptions;
use crate::sync::bracket::{BracketOptions, Bracketing, Source};
use board::Board;
use capture::InFlight;
use fabric::Shared;
use pairing::{Common, Pairing, Part};
use recorder::Recorder;

/// Readings between capture and pairing.
const READINGS: usize = 4096;
/// Slices between pairing and weaving.
const SLICES: usize = 64;
/// Memory that frames on their way may hold, bytes.
const FRAME_BYTES: u64 = 256 << 20;
/// Bytes of a frame of which nothing is known.
const USUAL_FRAME: u64 = 1920 * 1080;
/// Between two looks at whether the session is to end.
const TURN: Duration = Duration::from_millis(20);

/// A device of a session.
pub struct Equipment {
    /// What it is called, in the recording too.
    pub name: String,
    /// The device, stopped.
    pub device: Box<dyn Device>,
    /// What it gives.
    pub gives: Gives,
    /// Of what gives poses: for each of its sources the frames that the pose maps between, from which and to which.
    pub frames: Vec<[String; 2]>,
    /// What its times lie behind its measurements beyond what its driver knows, ns.
    pub latency_ns: i64,
    /// What its lines speak, where their bytes are readings, too.
    pub speech: Option<Speech>,
}

/// What a session is to do.
pub struct Session<'a> {
    /// Its devices.
    pub equipment: Vec<Equipment>,
    /// The frames' names, and the constant transforms.
    pub pairing: PairingOptions,
    /// How long a frame waits for its pose, ns.
    pub wait_ns: i64,
    /// The longest time between two poses that a pose is made between, ns.
    pub longest_gap_ns: i64,
    /// After how long a time of equal pictures at changing poses the scanner counts as frozen, ns.
    pub frozen_ns: i64,
    /// What of the picture is data.
    pub mask: MaskSettings,
    /// The reconstructor's settings.
    pub settings: Settings,
    /// Who says which path slices go. Poses are not known beforehand, so that of itself it is the general one.
    pub path: PathChoice,
    /// The planar path's settings.
    pub planar: PlanarSettings,
    /// How the volume is looked at; nobody looks for `None`, and then nothing is drawn.
    pub looks: Option<&'a dyn Looks>,
    /// Where the session is recorded, if it is.
    pub record: Option<Record>,
}

/// How a session is recorded.
pub struct Record {
    /// The file, open.
    pub writer: SessionWriter,
    /// What of the picture is kept.
    pub crop: Option<Crop>,
    /// What to note at the beginning, by kind: settings, calibration.
    pub notes: Vec<(&'static str, serde_json::Value)>,
}

/// What a session leaves.
pub struct Finished {
    /// The volume, and what became of the frames; `None` where no slice was woven.
    pub outcome: Option<Outcome>,
    /// The picture of all slices, where somebody looked.
    pub drawn: Option<Drawn>,
    /// What there is to say of devices, frames and times.
    pub account: Account,
    /// The session's file.
    pub recording: Option<Recording>,
}

/// Runs a session until it is told to end, or its devices have ended. `watch` is called now and then with what there is to say.
///
/// # Errors
/// [`PipelineError`] where nothing can be woven from the beginning on: no way to the world, settings that fit no slice. Devices that are away, slices that cannot be
/// used and disks that are full end nothing.
pub fn run(
    session: Session<'_>,
    clock: &dyn Clock,
    ends: &AtomicBool,
    mut watch: impl FnMut(&Account),
) -> Result<Finished, PipelineError> {
    let Session { equipment, pairing, looks, record, .. } = session;
    let (mut devices, mut parts, mut sources, mut of_recorder) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut frame_bytes = None;
    for Equipment { name, device, gives, frames, latency_ns, speech } in equipment {
        let description = device.describe();
        if let (Gives::Pictures, Some([width, height])) = (&gives, description.image_size) {
            frame_bytes = Some(u64::from(width) * u64::from(height));
        }
        let grabs = matches!(gives, Gives::Pictures);
        of_recorder.push((name.clone(), speech, grabs));
        let own =
            frames.iter().map(|[from, to]| Source { longest_gap_ns: session.longest_gap_ns, ..Source::new(from, to) });
        let first = sources.len();
        sources.extend(own);
        parts.push(Part {
            name,
            ingest: LiveIngest::new(gives, description.timing, latency_ns),
            sources: (first..sources.len()).collect(),
        });
        devices.push(device);
    }
    let names: Vec<(String, bool)> = of_recorder.iter().map(|(name, _, grabs)| (name.clone(), *grabs)).collect();
    let board = Board::new(&names);
    let bracketing = Bracketing::new(BracketOptions {
        image: pairing.image,
        world: pairing.world,
        statics: pairing.statics,
        sources,
        wait_ns: session.wait_ns,
        ..BracketOptions::default()
    })?;
    let (world, route) = (bracketing.route().world().to_owned(), bracketing.route().describe());
    let chosen = match session.path {
        PathChoice::Planar => Chosen { path: Path::Planar, why: "it was asked for".into() },
        _ => Chosen::general("live poses are not known beforehand"),
    };
    let plan = Plan {
        choice: session.path,
        settings: session.settings,
        planar: session.planar,
        chosen,
        off_plane: OffPlane::Settings,
        poses: Vec::new(),
    };
    let fabric = Shared::new(Loom::of_any_size(plan, session.mask));
    let in_flight = InFlight::new(FRAME_BYTES / frame_bytes.unwrap_or(USUAL_FRAME).max(1));
    let (mut recorder, mut writing) = (Recorder::nowhere(), None);
    if let Some(Record { mut writer, crop, notes }) = record {
        let mut known = Vec::new();
        for ((name, speech, grabs), device) in of_recorder.iter().zip(&devices) {
            let crop = crop.filter(|_| *grabs);
            known.push(writer.device(name, speech.clone(), device.describe(), crop)?);
        }
        for (kind, note) in &notes {
            writer.note(kind, &note.to_string(), clock.now_ns())?;
        }
        let (of_stages, queue) = Recorder::new();
        (recorder, writing) = (of_stages, Some((queue, writer, known)));
    }

    let (deliver, delivered) = bounded(READINGS);
    let (pose, posed) = bounded(SLICES);
    let stage = Pairing::new(
        Common { clock, board: &board, recorder: &recorder, in_flight: &in_flight },
        parts,
        bracketing,
        session.frozen_ns,
        pose,
    );
    let common = Common { clock, board: &board, recorder: &recorder, in_flight: &in_flight };
    let (shared, board) = (&fabric, &board);
    let mut recording = None;
    let mut drawn = None;
    let woven = std::thread::scope(|scope| {
        let writer = writing.map(|(queue, writer, known)| {
            spawn(scope, "recorder", move || {
                recorder::run(&queue, writer, &known, clock, |account, room| board.recording(account, room))
            })
        });
        let picture = looks.map(|looks| spawn(scope, "picture", move || picture::run(shared, looks, clock, |_| {})));
        let weave = spawn(scope, "weave", move || weave::run(shared, &posed, common));
        let pair = spawn(scope, "pairing", move || stage.run(&delivered));
        let captures: Vec<_> = devices
            .into_iter()
            .enumerate()
            .map(|(source, mut device)| {
                let deliver = deliver.clone();
                spawn(scope, &format!("capture-{}", names[source].0), move || {
                    capture::run(source, device.as_mut(), common, ends, &deliver)
                })
            })
            .collect();
        drop(deliver);
        // A device that ends by itself leaves the others; when none is left, or nothing can be woven, the session is over.
        while !ends.load(Ordering::Relaxed)
            && !captures.iter().all(ScopedJoinHandle::is_finished)
            && !weave.is_finished()
        {
            std::thread::sleep(TURN);
            watch(&board.snapshot());
        }
        ends.store(true, Ordering::Relaxed);
        for (capture, (name, _)) in captures.into_iter().zip(&names) {
            if let Err(error) = joined(capture) {
                board.note(format!("{name}: {error}"));
            }
        }
        joined(pair).into_iter().for_each(|note| board.note(note));
        let woven = joined(weave);
        if let Some(picture) = picture {
            match joined(picture) {
                Ok(picture) => drawn = picture,
                Err(error) => board.note(format!("no picture: {error}")),
            }
        }
        common.recorder.close();
        recording = writer.map(joined);
        woven
    });
    woven?;
    let mut account = board.snapshot();
    if let Some(recording) = &mut recording {
        [recording.lost_frames, recording.lost_others] = recorder.lost();
    }
    let outcome = fabric.into_inner().loom.finish().map(|cloth| {
        let notes = account.notes.iter().cloned().chain(cloth.notes).collect();
        Outcome {
            world,
            route,
            voxels_updated: cloth.weaver.work().voxels_updated,
            reconstructor: cloth.weaver,
            chosen: cloth.chosen,
            ledger: account.ledger.clone(),
            mask: cloth.mask,
            reached: None,
            slice_axes: cloth.slice_axes,
            insert_ms: Vec::new(),
            pixels: cloth.pixels,
            notes,
        }
    });
    account.frozen_s = None;
    Ok(Finished { outcome, drawn, account, recording })
}

/// A thread with a name.
fn spawn<'scope, 'env, T: Send + 'scope>(
    scope: &'scope Scope<'scope, 'env>,
    name: &str,
    run: impl FnOnce() -> T + Send + 'scope,
) -> ScopedJoinHandle<'scope, T> {
    Builder::new().name(name.into()).spawn_scoped(scope, run).unwrap_or_else(|error| panic!("thread {name}: {error}"))
}

/// What a thread has come to; its panic is this one's.
fn joined<T>(thread: ScopedJoinHandle<'_, T>) -> T {
    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}
