//! Live pipeline: devices to a volume and its picture, one thread per stage.
//!
//! ```text
//! capture (one per device) ─▶ sequencer ─▶ pairing ─▶ insertion ══ volume ══ picture
//!                                 └─────────┬─┴───────────┘
//!                                       recording ─▶ (replay: the same from pairing on)
//! ```
//!
//! | between | holds | when it is full |
//! |---|---|---|
//! | capture → pairing | 4096 readings; frames of all stages together at most 256 MB | the reading is dropped and counted; it is in the recording |
//! | pairing → insertion | 64 slices | the new slice is dropped and counted: the waiting ones are older, and their content would be lost for good |
//! | insertion → picture | the changed bricks | never: a picture shows all slices present when it is begun |
//! | all → recording | 4096 messages, of which 3072 frames, and 64 MB in the writer | frames are dropped first, then everything; counted, also in the recording |
//!
//! Pairing depends only on the session events, their order and their times. The recording has
//! these, and the decisions. So a replay repeats every decision, compares it, and reproduces the
//! volume bit by bit, at any speed and with any number of threads.
//!
//! - `session`: a session's inputs and its results.
//! - `capture`, `intake`: a device's thread, and the event sequencer.
//! - `pairing`, `stuck`: readings to posed slices; repeated frames.
//! - `frame_observer`: observers of frames, slices and sensors.
//! - `insert`, `fabric`, `changes`: insertion of slices, the lock on the shared volume, and the
//!   changes pending for its readers.
//! - `picture`, `reach`: the picture, and the box that it shows.
//! - `reader`: export of the volume while it grows.
//! - `ended`: an ended session whose volume is still viewed.
//! - `plane_viewer`, `swatch`: the plane viewer, and the copied bricks that it samples.
//! - `decision`, `seal`: recorded decisions about frames, and the digest of the result.
//! - `recorder`: the session's file.
//! - `replay`, `precedent`: a recorded session as a source of events, and its decisions for
//!   comparison.
//! - `walk`, `record_only`: a recorded session's samples by themselves, and a session that only
//!   records.
//! - `priority`: thread priorities.
//! - `zones`: frames taken where the tracker's field is distorted.
//! - `status`, `timing`, `pulse`, `losses`: the status of the stages.

mod brick_subset;
mod capture;
mod changes;
mod decision;
mod digest;
mod ended;
mod frame_observer;
mod insert;
mod losses;
mod pairing;
mod picture;
mod plane_viewer;
mod priority;
mod pulse;
mod reach;
mod reader;
mod record_only;
mod recorded_decisions;
mod recorder;
mod replay;
mod sequencer;
mod session;
mod shared_volume;
mod status;
mod stuck;
mod timing;
mod walk;
mod zones;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{Builder, Scope, ScopedJoinHandle};
use std::time::{Duration, Instant};

use crossbeam_channel::bounded;
pub use digest::ResultDigest;
pub use ended::EndedSession;
use formats::session::LineProtocol;
pub use frame_observer::{CapturedFrame, FrameObserver};
pub use picture::{Drawn, First, ViewClient};
pub use plane_viewer::{CutWork, Extent, PlaneImage, PlaneRequest, PlaneViewer};
pub use priority::{SchedulingGrant, SchedulingPolicy};
pub use pulse::{Movement, Turns};
pub use reader::{Reader, Snapshot, Wants};
pub use record_only::{RecordEvent, record_only};
pub use recorded_decisions::{Differences, RecordedDecisions};
pub use recorder::{Recording, Unwritten};
pub use replay::Recorded;
pub use session::{DeviceRole, Finished, Record, Session, SessionDevice, SessionInputs};
pub use shared_volume::Bulk;
use sonoweave_core::Device;
use sonoweave_core::clock::{Clock, Monotonic};
pub use status::{ClockBoard, DeviceBoard, REPLAYED, SessionStatus, Written};
pub use timing::{Quantiles, Spread};
pub use walk::{Latencies, walk};
pub use zones::{InZones, Watch};

use super::PipelineError;
use super::command::{Command, Instruction, Setting};
use capture::InFlight;
use decision::Common;
use losses::Losses;
use pairing::{FromDevices, SliceSink};
use picture::SharedViewClient;
use priority::Role;
use recorder::Recorder;
use sequencer::EventSequencer;
use shared_volume::Shared;
use status::StatusCollector;
use zones::Warnings;

/// Capacity of the queue between capture and pairing, readings.
const READINGS: usize = 4096;
/// The same for a recording, which waits for room.
const RECORDED: usize = 64;
/// Capacity of the queue between pairing and insertion, slices.
const SLICES: usize = 64;
/// Memory that frames on their way may hold, bytes.
const FRAME_BYTES: u64 = 256 << 20;
/// Assumed size of an unknown frame, bytes.
const USUAL_FRAME: u64 = 1920 * 1080;
/// Interval at which `ends` is checked.
const TURN: Duration = Duration::from_millis(20);

/// Runs a session until `ends` is set or its devices have ended. Calls `watch` every 20 ms with
/// the status; follows the instructions it returns.
///
/// # Errors
/// [`PipelineError`] if nothing can be inserted from the beginning: no route to the world,
/// settings that fit no slice, or an unreadable recording to be continued. Absent devices,
/// unusable slices and full disks do not end a session.
pub fn run(
    session: &Session,
    bed: SessionInputs,
    clock: &dyn Clock,
    ends: &AtomicBool,
    watch: impl FnMut(&SessionStatus) -> Vec<Instruction>,
) -> Result<Finished, PipelineError> {
    Ok(hold(session, bed, clock, ends, watch)?.finish())
}

/// Runs a session like [`run`]; its result can still be viewed.
///
/// # Errors
/// Same as [`run`].
pub fn hold<'a>(
    session: &'a Session,
    bed: SessionInputs,
    clock: &dyn Clock,
    ends: &AtomicBool,
    mut watch: impl FnMut(&SessionStatus) -> Vec<Instruction>,
) -> Result<EndedSession<'a>, PipelineError> {
    let SessionInputs { equipment, record, resumed, mut standing } = bed;
    let fabric = session.loom();
    let begun = session.weave_earlier(resumed, &fabric, ends)?;
    let Parts { devices, instruments, speeches } = parts(equipment);
    let board = StatusCollector::new(&instruments, session.stuck_after_ns);
    board.granted(standing.granted());
    begun.into_iter().for_each(|note| board.note(note));
    let in_flight = InFlight::new(FRAME_BYTES / frame_bytes(&devices).max(1));
    let keep_free = Arc::new(AtomicU64::new(record.as_ref().map_or(0, |record| record.keep_free_bytes)));
    let (recorder, writing) = match record {
        Some(record) => {
            let speakers = instruments.iter().zip(&devices).zip(speeches);
            let told = speakers.map(|((instrument, device), speech)| (&*instrument.name, speech, device.describe()));
            let (recorder, writing) = recorder::open(record, told, session.mask, &keep_free, clock)?;
            (recorder, Some(writing))
        }
        None => (Recorder::nowhere(), None),
    };
    let names: Vec<String> = instruments.iter().map(|instrument| instrument.name.clone()).collect();
    let (deliver, delivered) = bounded(READINGS);
    let common = Common { clock, board: &board, recorder: &recorder, in_flight: &in_flight, precedent: None };
    let intake = EventSequencer::new(common, names.clone(), deliver);
    let (pose, posed) = bounded(SLICES);
    let stage = session.pairing_stage(instruments, common, SliceSink::OrDrop(pose))?;
    let wall = session.looks.clone().map(SharedViewClient::new);

    let (board, shared, wall_of, intake) = (&board, &fabric, wall.as_ref(), &intake);
    let (mut recording, mut drawn, mut seal) = (None, None, None);
    let (mut losses, mut warnings) = (Losses::default(), Warnings::default());
    let woven = std::thread::scope(|scope| {
        let writer = writing.map(|(queue, file)| {
            spawn(scope, "recorder", (&standing, Role::Usual), move || {
                recorder::run(&queue, file, clock, |recording| board.recording(recording))
            })
        });
        let picture = wall_of.map(|wall| {
            spawn(scope, "picture", (&standing, Role::Usual), move || {
                picture::run(shared, wall, false, clock, |drawn| board.drawn(drawn))
            })
        });
        for reader in &session.readers {
            spawn(scope, "reader", (&standing, Role::Usual), move || reader::run(shared, &**reader));
        }
        if let Some(cutter) = &session.cutter {
            spawn(scope, "sections", (&standing, Role::Usual), move || plane_viewer::run(shared, &**cutter));
        }
        let weave =
            spawn(scope, "weave", (&standing, Role::Weaving), move || insert::run(shared, &posed, common, true, None));
        let pair = spawn(scope, "pairing", (&standing, Role::Pairing), move || {
            stage.run(&mut FromDevices { from: &delivered, intake })
        });
        let captures = capturing(scope, devices, &names, &standing, common, ends, intake);
        // A device that ends by itself leaves the others running. The session ends when no
        // device is left or insertion has failed.
        while !ends.load(Ordering::Relaxed)
            && !captures.iter().all(ScopedJoinHandle::is_finished)
            && !weave.is_finished()
        {
            std::thread::sleep(TURN);
            if standing.watch() {
                board.granted(standing.granted());
            }
            let account = board.snapshot();
            losses.say(&account, Instant::now(), false);
            warnings.say(&account, Instant::now());
            for instruction in watch(&account) {
                match instruction {
                    Instruction::Command(Command::Freeze(on)) => drop(intake.freeze(on)),
                    Instruction::Command(Command::Clear) => drop(intake.clear()),
                    Instruction::Command(Command::Stop) => ends.store(true, Ordering::Relaxed),
                    Instruction::Command(Command::Set(setting)) => match setting {
                        Setting::Latency { device, ns } => drop(intake.latency(device, ns)),
                        Setting::StuckAfter(ns) => board.stuck_after(ns),
                        Setting::View => wall_of.iter().for_each(|wall| wall.changed()),
                        Setting::KeepFree(bytes) => keep_free.store(bytes, Ordering::Relaxed),
                    },
                    // The session controller executes these: they concern the next session, or
                    // the reader that saves.
                    Instruction::Command(Command::Record | Command::Scan | Command::Save) => {}
                    Instruction::Note(kind, value) => common.recorder.note(kind, &value, clock.now_ns()),
                    Instruction::Report(sentence) => board.note(sentence),
                }
            }
        }
        ends.store(true, Ordering::Relaxed);
        // `watch` sees the end. Instructions returned now are too late.
        drop(watch(&board.snapshot()));
        captured(captures, &names, board);
        intake.close();
        joined(pair).into_iter().for_each(|note| board.note(note));
        let woven = joined(weave);
        drawn = picture.and_then(|picture| shown(joined(picture), board));
        if common.recorder.records() {
            let made = shared.seal(drawn.as_ref());
            common.recorder.note(digest::SEAL, &made, clock.now_ns());
            seal = Some(made);
        }
        common.recorder.close();
        recording = writer.map(joined);
        woven
    });
    woven?;
    let account = board.snapshot();
    losses.say(&account, Instant::now(), true);
    Ok(EndedSession { session, fabric, wall, drawn, account, recording, seal })
}

/// Replays a recorded session, after those that it continues. Every decision is made again and
/// compared with the recorded one; [`RecordedDecisions::differences`] reports deviations. Only the
/// frames dropped then are dropped: a slow stage delays the others.
///
/// # Errors
/// Same as [`run`], and the recording's: [`PipelineError::Device`].
pub fn rerun(
    session: &Session,
    earlier: Vec<Recorded>,
    recorded: Recorded,
    ends: &AtomicBool,
    watch: impl FnMut(&SessionStatus),
) -> Result<(Finished, RecordedDecisions), PipelineError> {
    let (held, precedent) = rerun_and_hold(session, earlier, recorded, ends, watch)?;
    Ok((held.finish(), precedent))
}

/// Replays a recorded session like [`rerun`]; its result can still be viewed.
///
/// # Errors
/// Same as [`rerun`].
pub fn rerun_and_hold<'a>(
    session: &'a Session,
    earlier: Vec<Recorded>,
    recorded: Recorded,
    ends: &AtomicBool,
    mut watch: impl FnMut(&SessionStatus),
) -> Result<(EndedSession<'a>, RecordedDecisions), PipelineError> {
    let fabric = session.loom();
    let begun = session.weave_earlier(earlier, &fabric, ends)?;
    let wall = session.looks.clone().map(SharedViewClient::new);
    let (mut account, drawn, precedent) =
        session.weave_recorded(recorded, &fabric, wall.as_ref(), true, ends, &mut watch)?;
    account.notes.splice(0..0, begun);
    let made = fabric.seal(drawn.as_ref());
    if !ends.load(Ordering::Relaxed) {
        precedent.sealed(&made);
    }
    Ok((EndedSession { session, fabric, wall, drawn, account, recording: None, seal: Some(made) }, precedent))
}

impl Session {
    /// Inserts recorded sessions into the volume that is continued; returns notes for the user.
    fn weave_earlier(
        &self,
        earlier: Vec<Recorded>,
        shared: &Shared,
        ends: &AtomicBool,
    ) -> Result<Vec<String>, PipelineError> {
        let mut notes = Vec::new();
        for recorded in earlier {
            let path = recorded.replay.settings().path.display().to_string();
            let (_, _, precedent) = self.weave_recorded(recorded, shared, None, false, ends, &mut |_| {})?;
            let slices = shared.goes_on();
            notes.push(format!("{path} is gone on with: {slices} slices are in the volume"));
            if let Some(first) = precedent.differences().first {
                notes.push(format!("{path}: {first}"));
            }
        }
        Ok(notes)
    }

    fn weave_recorded(
        &self,
        recorded: Recorded,
        shared: &Shared,
        wall: Option<&SharedViewClient>,
        is_last: bool,
        ends: &AtomicBool,
        watch: &mut dyn FnMut(&SessionStatus),
    ) -> Result<(SessionStatus, Option<Drawn>, RecordedDecisions), PipelineError> {
        let Recorded { replay, precedent, instruments } = recorded;
        let (clock, recorder, in_flight) = (Monotonic, Recorder::nowhere(), InFlight::new(u64::MAX));
        let board = StatusCollector::new(&instruments, self.stuck_after_ns);
        board.replayed();
        let common = Common {
            clock: &clock,
            board: &board,
            recorder: &recorder,
            in_flight: &in_flight,
            precedent: Some(&precedent),
        };
        let names: Vec<String> = instruments.iter().map(|instrument| instrument.name.clone()).collect();
        let (deliver, delivered) = bounded(RECORDED);
        let (pose, posed) = bounded(SLICES);
        let stage = self.pairing_stage(instruments, common, SliceSink::Waits(pose))?;
        let (board, clock) = (&board, &clock);
        let pictured = wall.and_then(|wall| wall.looks().every());
        let mut drawn = None;
        std::thread::scope(|scope| {
            let usual = (&SchedulingPolicy::default(), Role::Usual);
            let picture = wall.map(|wall| {
                spawn(scope, "picture", (&SchedulingPolicy::default(), Role::Usual), move || {
                    picture::run(shared, wall, pictured.is_some(), clock, |drawn| board.drawn(drawn))
                })
            });
            for reader in self.readers.iter().filter(|_| is_last) {
                spawn(scope, "reader", usual, move || reader::run(shared, &**reader));
            }
            if let Some(cutter) = self.cutter.as_ref().filter(|_| is_last) {
                spawn(scope, "sections", usual, move || plane_viewer::run(shared, &**cutter));
            }
            let weave = spawn(scope, "weave", usual, move || insert::run(shared, &posed, common, is_last, pictured));
            let pair = spawn(scope, "pairing", usual, move || stage.run(&mut replay::FromRecording(delivered)));
            let feed = spawn(scope, "replay", usual, move || replay::run(replay, &names, common, ends, &deliver));
            while !feed.is_finished() || !pair.is_finished() || !weave.is_finished() {
                std::thread::sleep(TURN);
                watch(&board.snapshot());
            }
            let fed = joined(feed);
            joined(pair).into_iter().for_each(|note| board.note(note));
            let woven = joined(weave);
            drawn = picture.and_then(|picture| shown(joined(picture), board));
            woven?;
            fed.map_err(PipelineError::from)
        })?;
        Ok((board.snapshot(), drawn, precedent))
    }
}

/// Devices, instruments and unit protocols, each in the order of the devices' indices.
struct Parts {
    devices: Vec<Box<dyn Device>>,
    instruments: Vec<DeviceRole>,
    speeches: Vec<Option<LineProtocol>>,
}

fn parts(equipment: Vec<SessionDevice>) -> Parts {
    let mut parts = Parts { devices: Vec::new(), instruments: Vec::new(), speeches: Vec::new() };
    for SessionDevice { instrument, device, speech } in equipment {
        parts.devices.push(device);
        parts.instruments.push(instrument);
        parts.speeches.push(speech);
    }
    parts
}

/// A device's thread, which ends with its device.
type Capturing<'scope> = ScopedJoinHandle<'scope, Result<(), sonoweave_core::Error>>;

/// Starts a thread for each device.
fn capturing<'scope, 'env>(
    scope: &'scope Scope<'scope, 'env>,
    devices: Vec<Box<dyn Device>>,
    names: &[String],
    standing: &SchedulingPolicy,
    common: Common<'env>,
    ends: &'env AtomicBool,
    intake: &'env EventSequencer<'env>,
) -> Vec<Capturing<'scope>> {
    let capture = |(source, mut device): (usize, Box<dyn Device>)| {
        spawn(scope, &format!("capture-{}", names[source]), (standing, Role::Capture), move || {
            let ran = capture::run(source, device.as_mut(), common, ends, intake);
            ran.inspect_err(|error| common.board.failed(source, error))
        })
    };
    devices.into_iter().enumerate().map(capture).collect()
}

/// Waits for the capture threads, and notes the errors of those that failed.
fn captured(captures: Vec<Capturing<'_>>, names: &[String], board: &StatusCollector) {
    for (capture, name) in captures.into_iter().zip(names) {
        if let Err(error) = joined(capture) {
            board.note(format!("{name}: {error}"));
        }
    }
}

/// Returns the size of a frame in bytes, by the devices' descriptions.
fn frame_bytes(devices: &[Box<dyn Device>]) -> u64 {
    let sizes = devices.iter().filter_map(|device| device.describe().image_size);
    sizes.map(|[width, height]| u64::from(width) * u64::from(height)).max().unwrap_or(USUAL_FRAME)
}

/// Returns the picture; adds a note if it failed.
fn shown(
    drawn: Result<Option<Drawn>, Box<dyn std::error::Error + Send + Sync>>,
    board: &StatusCollector,
) -> Option<Drawn> {
    drawn.unwrap_or_else(|error| {
        board.note(format!("no picture: {error}"));
        None
    })
}

/// Starts a named thread with the scheduling grant of its role.
fn spawn<'scope, 'env, T: Send + 'scope>(
    scope: &'scope Scope<'scope, 'env>,
    name: &str,
    (standing, role): (&SchedulingPolicy, Role),
    run: impl FnOnce() -> T + Send + 'scope,
) -> ScopedJoinHandle<'scope, T> {
    let standing = standing.clone();
    let run = move || {
        standing.enter(role);
        run()
    };
    Builder::new().name(name.into()).spawn_scoped(scope, run).unwrap_or_else(|error| panic!("thread {name}: {error}"))
}

/// Waits for a thread and returns its result; a panic is propagated.
fn joined<T>(thread: ScopedJoinHandle<'_, T>) -> T {
    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}
