//! Live: devices to a volume and its picture, each stage in a thread of its own.
//!
//! ```text
//! capture (one a device) ─▶ intake ─▶ pairing ─▶ weaving ══ volume ══ picture
//!                             └───────┬──┴──────────┘
//!                                 recording ─▶ (replay: the same from pairing on)
//! ```
//!
//! | between | holds | when it is full |
//! |---|---|---|
//! | capture → pairing | 4096 readings, and of frames as many as fit 256 MB all stages together | the reading is dropped, counted as such; it is in the recording |
//! | pairing → weaving | 64 slices | the slice that comes is dropped, and counted: those that wait are older, and what they show would be lost for good |
//! | weaving → picture | the bricks that changed | never: a picture is of all slices there are when it is begun |
//! | all → recording | 4096 messages, frames 3072, and 64 MB in the writer | frames first, then everything; counted and said in the recording |
//!
//! What pairing does depends on what comes in, in which order and at which times, and on nothing else; the recording has these, and what was decided. So a replay redoes
//! every decision, compares, and comes to the same volume bit by bit, however fast it goes and however many threads weave and draw.
//!
//! - `session`: what a session is, and what it leaves.
//! - `capture`, `intake`: a device's thread, and the one way in.
//! - `pairing`, `frozen`: readings to posed slices; pictures that come again.
//! - `witness`: who looks on, at pictures, slices and sensors.
//! - `weave`, `fabric`, `changes`: slices into the volume, the lock that weaving and drawing share it by, and what has changed for who looks.
//! - `picture`, `reach`: the picture, and the box it is of.
//! - `reader`: who reads the volume while it grows.
//! - `held`: a session that is over, while its volume is looked at.
//! - `sections`, `swatch`: who looks at planes through it meanwhile, and the bricks that these are made of.
//! - `decision`, `seal`: what is decided upon frames, and what came of it all, as the recording has it.
//! - `recorder`: the session's file.
//! - `replay`, `precedent`: a recorded session as what comes in, and what it is held against.
//! - `walk`, `gather`: a recorded session's samples by themselves, and a running one's, of which nothing is woven.
//! - `priority`: which threads run before others.
//! - `zones`: frames that were taken where the tracker's field is bent.
//! - `board`, `timing`, `pulse`, `losses`: what the stages say of themselves.

mod board;
mod capture;
mod changes;
mod decision;
mod fabric;
mod frozen;
mod gather;
mod held;
mod intake;
mod losses;
mod pairing;
mod picture;
mod precedent;
mod priority;
mod pulse;
mod reach;
mod reader;
mod recorder;
mod replay;
mod seal;
mod sections;
mod session;
mod swatch;
mod timing;
mod walk;
mod weave;
mod witness;
mod zones;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{Builder, Scope, ScopedJoinHandle};
use std::time::{Duration, Instant};

pub use board::{Account, ClockBoard, DeviceBoard, REPLAYED, Written};
use crossbeam_channel::bounded;
use drivers::Device;
use drivers::clock::{Clock, Monotonic};
use drivers::recording::session::Speech;
pub use fabric::Bulk;
pub use gather::{Heard, gather};
pub use held::Held;
pub use picture::{Drawn, First, Looks};
pub use precedent::{Differences, Precedent};
pub use priority::{Granted, Standing};
pub use pulse::{Movement, Turns};
pub use reader::{Reader, Snapshot, Wants};
pub use recorder::{Recording, Unwritten};
pub use replay::Recorded;
pub use seal::Seal;
pub use sections::{Cut, CutWork, Cutter, Extent, Wanted};
pub use session::{Bed, Equipment, Finished, Instrument, Order, Record, Session};
pub use timing::{Quantiles, Spread};
pub use walk::{Latencies, walk};
pub use witness::{Glimpsed, Witness};
pub use zones::{InZones, Watch};

use super::PipelineError;
use board::Board;
use capture::InFlight;
use decision::Common;
use fabric::Shared;
use intake::Intake;
use losses::Losses;
use pairing::{FromDevices, Onward};
use picture::Wall;
use priority::Role;
use recorder::Recorder;
use zones::Warnings;

/// Readings between capture and pairing.
const READINGS: usize = 4096;
/// The same of a recording, which waits.
const RECORDED: usize = 64;
/// Slices between pairing and weaving.
const SLICES: usize = 64;
/// Memory that frames on their way may hold, bytes.
const FRAME_BYTES: u64 = 256 << 20;
/// Bytes of a frame of which nothing is known.
const USUAL_FRAME: u64 = 1920 * 1080;
/// Between two looks at whether the session is to end.
const TURN: Duration = Duration::from_millis(20);

/// Runs a session until it is told to end, or its devices have ended. `watch` is called now and then with what there is to say, and says what is to be done otherwise.
///
/// # Errors
/// [`PipelineError`] where nothing can be woven from the beginning on: no way to the world, settings that fit no slice, a recording to be gone on with that cannot be read.
/// Devices that are away, slices that cannot be used and disks that are full end nothing.
pub fn run(
    session: &Session,
    bed: Bed,
    clock: &dyn Clock,
    ends: &AtomicBool,
    watch: impl FnMut(&Account) -> Vec<Order>,
) -> Result<Finished, PipelineError> {
    Ok(hold(session, bed, clock, ends, watch)?.finish())
}

/// The same; what it has come to can still be looked at.
///
/// # Errors
/// As of [`run`].
pub fn hold<'a>(
    session: &'a Session,
    bed: Bed,
    clock: &dyn Clock,
    ends: &AtomicBool,
    mut watch: impl FnMut(&Account) -> Vec<Order>,
) -> Result<Held<'a>, PipelineError> {
    let Bed { equipment, record, resumed, mut standing } = bed;
    let fabric = session.loom();
    let begun = session.weave_earlier(resumed, &fabric, ends)?;
    let Parts { devices, instruments, speeches } = parts(equipment);
    let board = Board::new(&instruments, session.frozen_ns);
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
    let intake = Intake::new(common, names.clone(), deliver);
    let (pose, posed) = bounded(SLICES);
    let stage = session.pairing_stage(instruments, common, Onward::OrDrop(pose))?;
    let wall = session.looks.clone().map(Wall::new);

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
            spawn(scope, "sections", (&standing, Role::Usual), move || sections::run(shared, &**cutter));
        }
        let weave =
            spawn(scope, "weave", (&standing, Role::Weaving), move || weave::run(shared, &posed, common, true, None));
        let pair = spawn(scope, "pairing", (&standing, Role::Pairing), move || {
            stage.run(&mut FromDevices { from: &delivered, intake })
        });
        let captures = capturing(scope, devices, &names, &standing, common, ends, intake);
        // A device that ends by itself leaves the others; when none is left, or nothing can be woven, the session is over.
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
            for order in watch(&account) {
                match order {
                    Order::Latency(source, latency_ns) => drop(intake.latency(source, latency_ns)),
                    Order::Frozen(after_ns) => board.frozen_after(after_ns),
                    Order::Looks(looks) => wall_of.iter().for_each(|wall| wall.hang(&looks)),
                    Order::Pause(paused) => drop(intake.pause(paused)),
                    Order::Clear => drop(intake.clear()),
                    Order::KeepFree(bytes) => keep_free.store(bytes, Ordering::Relaxed),
                    Order::Note(kind, value) => common.recorder.note(kind, &value, clock.now_ns()),
                    Order::Say(note) => board.note(note),
                }
            }
        }
        ends.store(true, Ordering::Relaxed);
        // Whoever watches learns that it ends. What is ordered now comes too late.
        drop(watch(&board.snapshot()));
        captured(captures, &names, board);
        intake.close();
        joined(pair).into_iter().for_each(|note| board.note(note));
        let woven = joined(weave);
        drawn = picture.and_then(|picture| shown(joined(picture), board));
        if common.recorder.records() {
            let made = shared.seal(drawn.as_ref());
            common.recorder.note(seal::SEAL, &made, clock.now_ns());
            seal = Some(made);
        }
        common.recorder.close();
        recording = writer.map(joined);
        woven
    });
    woven?;
    let account = board.snapshot();
    losses.say(&account, Instant::now(), true);
    Ok(Held { session, fabric, wall, drawn, account, recording, seal })
}

/// Runs a recorded session again, after those that it goes on with: every reading at its turn, every decision made anew and held against the recorded one. Where it comes
/// to something else, [`Precedent::differences`] says so. Nothing is dropped but what was: a stage that is slower holds up the others.
///
/// # Errors
/// As of [`run`], and the recording's: [`PipelineError::Device`].
pub fn rerun(
    session: &Session,
    earlier: Vec<Recorded>,
    recorded: Recorded,
    ends: &AtomicBool,
    watch: impl FnMut(&Account),
) -> Result<(Finished, Precedent), PipelineError> {
    let (held, precedent) = rerun_and_hold(session, earlier, recorded, ends, watch)?;
    Ok((held.finish(), precedent))
}

/// The same; what it has come to can still be looked at.
///
/// # Errors
/// As of [`rerun`].
pub fn rerun_and_hold<'a>(
    session: &'a Session,
    earlier: Vec<Recorded>,
    recorded: Recorded,
    ends: &AtomicBool,
    mut watch: impl FnMut(&Account),
) -> Result<(Held<'a>, Precedent), PipelineError> {
    let fabric = session.loom();
    let begun = session.weave_earlier(earlier, &fabric, ends)?;
    let wall = session.looks.clone().map(Wall::new);
    let (mut account, drawn, precedent) =
        session.weave_recorded(recorded, &fabric, wall.as_ref(), true, ends, &mut watch)?;
    account.notes.splice(0..0, begun);
    let made = fabric.seal(drawn.as_ref());
    if !ends.load(Ordering::Relaxed) {
        precedent.sealed(&made);
    }
    Ok((Held { session, fabric, wall, drawn, account, recording: None, seal: Some(made) }, precedent))
}

impl Session {
    /// Weaves recorded sessions into a volume that is gone on with; what there is to say of it.
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
        wall: Option<&Wall>,
        is_last: bool,
        ends: &AtomicBool,
        watch: &mut dyn FnMut(&Account),
    ) -> Result<(Account, Option<Drawn>, Precedent), PipelineError> {
        let Recorded { replay, precedent, instruments } = recorded;
        let (clock, recorder, in_flight) = (Monotonic, Recorder::nowhere(), InFlight::new(u64::MAX));
        let board = Board::new(&instruments, self.frozen_ns);
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
        let stage = self.pairing_stage(instruments, common, Onward::Waits(pose))?;
        let (board, clock) = (&board, &clock);
        let pictured = wall.and_then(|wall| wall.looks().every());
        let mut drawn = None;
        std::thread::scope(|scope| {
            let usual = (&Standing::default(), Role::Usual);
            let picture = wall.map(|wall| {
                spawn(scope, "picture", (&Standing::default(), Role::Usual), move || {
                    picture::run(shared, wall, pictured.is_some(), clock, |drawn| board.drawn(drawn))
                })
            });
            for reader in self.readers.iter().filter(|_| is_last) {
                spawn(scope, "reader", usual, move || reader::run(shared, &**reader));
            }
            if let Some(cutter) = self.cutter.as_ref().filter(|_| is_last) {
                spawn(scope, "sections", usual, move || sections::run(shared, &**cutter));
            }
            let weave = spawn(scope, "weave", usual, move || weave::run(shared, &posed, common, is_last, pictured));
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

/// What devices, instruments and speeches there are, each in the order of the places.
struct Parts {
    devices: Vec<Box<dyn Device>>,
    instruments: Vec<Instrument>,
    speeches: Vec<Option<Speech>>,
}

fn parts(equipment: Vec<Equipment>) -> Parts {
    let mut parts = Parts { devices: Vec::new(), instruments: Vec::new(), speeches: Vec::new() };
    for Equipment { instrument, device, speech } in equipment {
        parts.devices.push(device);
        parts.instruments.push(instrument);
        parts.speeches.push(speech);
    }
    parts
}

/// A device's thread, which ends with it.
type Capturing<'scope> = ScopedJoinHandle<'scope, Result<(), drivers::Error>>;

/// A thread for each device.
fn capturing<'scope, 'env>(
    scope: &'scope Scope<'scope, 'env>,
    devices: Vec<Box<dyn Device>>,
    names: &[String],
    standing: &Standing,
    common: Common<'env>,
    ends: &'env AtomicBool,
    intake: &'env Intake<'env>,
) -> Vec<Capturing<'scope>> {
    let capture = |(source, mut device): (usize, Box<dyn Device>)| {
        spawn(scope, &format!("capture-{}", names[source]), (standing, Role::Capture), move || {
            let ran = capture::run(source, device.as_mut(), common, ends, intake);
            ran.inspect_err(|error| common.board.failed(source, error))
        })
    };
    devices.into_iter().enumerate().map(capture).collect()
}

/// Waits for them, and notes why those ended that did not end in good order.
fn captured(captures: Vec<Capturing<'_>>, names: &[String], board: &Board) {
    for (capture, name) in captures.into_iter().zip(names) {
        if let Err(error) = joined(capture) {
            board.note(format!("{name}: {error}"));
        }
    }
}

/// Bytes of a frame, by what the devices say.
fn frame_bytes(devices: &[Box<dyn Device>]) -> u64 {
    let sizes = devices.iter().filter_map(|device| device.describe().image_size);
    sizes.map(|[width, height]| u64::from(width) * u64::from(height)).max().unwrap_or(USUAL_FRAME)
}

/// The picture, or why there is none.
fn shown(drawn: Result<Option<Drawn>, Box<dyn std::error::Error + Send + Sync>>, board: &Board) -> Option<Drawn> {
    drawn.unwrap_or_else(|error| {
        board.note(format!("no picture: {error}"));
        None
    })
}

/// A thread with a name, and with what its role has a right to.
fn spawn<'scope, 'env, T: Send + 'scope>(
    scope: &'scope Scope<'scope, 'env>,
    name: &str,
    (standing, role): (&Standing, Role),
    run: impl FnOnce() -> T + Send + 'scope,
) -> ScopedJoinHandle<'scope, T> {
    let standing = standing.clone();
    let run = move || {
        standing.enter(role);
        run()
    };
    Builder::new().name(name.into()).spawn_scoped(scope, run).unwrap_or_else(|error| panic!("thread {name}: {error}"))
}

/// What a thread has come to; its panic is this one's.
fn joined<T>(thread: ScopedJoinHandle<'_, T>) -> T {
    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}
