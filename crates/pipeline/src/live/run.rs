//! The wiring of a session: starts its threads, follows instructions, and waits for its end.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::ScopedJoinHandle;
use std::time::{Duration, Instant};

use crossbeam_channel::bounded;

use sonoweave_core::Error;
use sonoweave_core::clock::{Clock, Monotonic};

use super::capture::{Capturing, Parts, captured, capturing, frame_bytes, parts};
use super::common::{Common, InFlight};
use super::digest::{self, ResultDigest};
use super::ended::EndedSession;
use super::losses::Losses;
use super::pairing::SliceSink;
use super::picture::{self, Drawn, SharedViewClient};
use super::priority::{Role, SchedulingPolicy};
use super::recorded_decisions::{PATH_BY_REACH, RecordedDecisions};
use super::recorder::{self, Recorder, Recording};
use super::replay::{self, FromRecording, Recorded};
use super::sequencer::{EventSequencer, FromDevices};
use super::session::{Session, SessionInputs, Source};
use super::shared_volume::Shared;
use super::status::{SessionStatus, StatusCollector};
use super::threads::{joined, spawn};
use super::zones::Warnings;
use super::{insert, plane_viewer, reader};
use crate::PipelineError;
use crate::command::{Command, Instruction, Setting};

/// Capacity of the queue between capture and pairing, readings.
pub(super) const READINGS: usize = 4096;
/// The same for a recording, which waits for room.
const RECORDED: usize = 64;
/// Capacity of the queue between pairing and insertion, slices.
const SLICES: usize = 64;
/// Memory that frames on their way may hold, bytes.
pub(super) const FRAME_BYTES: u64 = 256 << 20;
/// Interval at which `ends` is checked.
pub(super) const TURN: Duration = Duration::from_millis(20);

/// Runs a session until `ends` is set, its devices have ended, or its recording has. Calls `watch`
/// every 20 ms with the status; follows the instructions it returns. The result can still be
/// viewed.
///
/// # Errors
/// [`PipelineError`] if nothing can be inserted from the beginning: no route to the world,
/// settings that fit no slice, or an unreadable recording. Absent devices, unusable slices and
/// full disks do not end a session.
pub fn run<'a>(
    session: &'a Session,
    inputs: SessionInputs,
    clock: &dyn Clock,
    ends: &AtomicBool,
    mut watch: impl FnMut(&SessionStatus) -> Vec<Instruction>,
) -> Result<EndedSession<'a>, PipelineError> {
    let SessionInputs { source, resumed, mut policy } = inputs;
    let volume = match (resumed.first(), &source) {
        (Some(first), _) | (None, Source::Recording(first)) => {
            session.volume(first.instruments.iter(), first.precedent.is_path_by_reach())?
        }
        (None, Source::Devices { devices, .. }) => {
            session.volume(devices.iter().map(|device| &device.instrument), true)?
        }
    };
    let mut notes = Vec::new();
    for recorded in resumed {
        let path = recorded.replay.settings().path.display().to_string();
        let wiring = Wiring { session, volume: &volume, view: None, is_last: false, clock: &Monotonic, ends };
        let ran = wiring
            .run(Source::Recording(recorded), &mut SchedulingPolicy::default(), Vec::new(), &mut |_| Vec::new())?;
        notes.push(format!("the session continues {path}: {} slices are in the volume", volume.goes_on()));
        if let Some(first) = ran.decisions.and_then(|decisions| decisions.differences().first) {
            notes.push(format!("{path}: {first}"));
        }
    }
    let view = session.view_client.clone().map(SharedViewClient::new);
    let wiring = Wiring { session, volume: &volume, view: view.as_ref(), is_last: true, clock, ends };
    let Ran { account, drawn, recording, seal, decisions } = wiring.run(source, &mut policy, notes, &mut watch)?;
    Ok(EndedSession { session, volume, view, drawn, account, recording, seal, decisions })
}

/// The results of a source.
struct Ran {
    account: SessionStatus,
    drawn: Option<Drawn>,
    recording: Option<Recording>,
    seal: Option<ResultDigest>,
    decisions: Option<RecordedDecisions>,
}

/// The threads that deliver the events.
enum Delivering<'scope> {
    Captures(Vec<Capturing<'scope>>),
    Replay(ScopedJoinHandle<'scope, Result<(), Error>>),
}

/// A session's parts that its threads share.
#[derive(Clone, Copy)]
struct Wiring<'a> {
    session: &'a Session,
    volume: &'a Shared,
    view: Option<&'a SharedViewClient>,
    /// Whether no source follows.
    is_last: bool,
    clock: &'a dyn Clock,
    ends: &'a AtomicBool,
}

impl Wiring<'_> {
    /// Runs one source to its end.
    fn run(
        self,
        source: Source,
        policy: &mut SchedulingPolicy,
        notes: Vec<String>,
        watch: &mut dyn FnMut(&SessionStatus) -> Vec<Instruction>,
    ) -> Result<Ran, PipelineError> {
        let Self { session, volume, view, is_last, clock, ends } = self;
        let (Parts { devices, instruments, speeches }, record, recorded) = match source {
            Source::Devices { devices, record } => (parts(devices), record, None),
            Source::Recording(Recorded { replay, precedent, instruments }) => {
                (Parts { devices: Vec::new(), instruments, speeches: Vec::new() }, None, Some((replay, precedent)))
            }
        };
        let (replay, decisions) = recorded.unzip();
        let is_live = replay.is_none();
        let board = StatusCollector::new(&instruments, session.stuck_after_ns);
        notes.into_iter().for_each(|note| board.note(note));
        let in_flight = InFlight::new(if is_live { FRAME_BYTES / frame_bytes(&devices).max(1) } else { u64::MAX });
        let keep_free = Arc::new(AtomicU64::new(record.as_ref().map_or(0, |record| record.keep_free_bytes)));
        let (recorder, writing) = match record {
            Some(record) => {
                let speakers = instruments.iter().zip(&devices).zip(speeches);
                let about = speakers.map(|((device, open), speech)| (&*device.name, speech, open.describe()));
                let (recorder, writing) = recorder::open(record, about, session.mask, &keep_free, clock)?;
                (recorder, Some(writing))
            }
            None => (Recorder::nowhere(), None),
        };
        let names: Vec<String> = instruments.iter().map(|instrument| instrument.name.clone()).collect();
        let (deliver, delivered) = bounded(if is_live { READINGS } else { RECORDED });
        let common = Common {
            clock,
            board: &board,
            recorder: &recorder,
            in_flight: &in_flight,
            precedent: decisions.as_ref(),
            observers: &session.observers,
        };
        let sequencer = EventSequencer::new(common, names.clone(), deliver.clone());
        let (pose, posed) = bounded(SLICES);
        let sink = if is_live { SliceSink::OrDrop(pose) } else { SliceSink::Waits(pose) };
        let stage = session.pairing_stage(instruments, common, sink)?;
        if is_live {
            board.granted(policy.granted());
            recorder.note(PATH_BY_REACH, &true, clock.now_ns());
        } else {
            board.replayed();
        }
        if !is_live {
            // The recording has its own events.
            sequencer.close();
        }
        let pictured = view.filter(|_| !is_live).and_then(|view| view.looks().every());
        let (board, sequencer, names) = (&board, &sequencer, &names);
        let (mut recording, mut drawn, mut seal) = (None, None, None);
        let (mut losses, mut warnings) = (Losses::default(), Warnings::default());
        std::thread::scope(|scope| {
            let usual = (&*policy, Role::Usual);
            let writer = writing.map(|(queue, file)| {
                spawn(scope, "recorder", usual, move || {
                    recorder::run(&queue, file, clock, |recording| board.recording(recording))
                })
            });
            let picture = view.map(|view| {
                spawn(scope, "picture", usual, move || {
                    picture::run(volume, view, pictured.is_some(), clock, |drawn| board.drawn(drawn))
                })
            });
            for reader in session.readers.iter().filter(|_| is_last) {
                spawn(scope, "reader", usual, move || reader::run(volume, &**reader));
            }
            if let Some(viewer) = session.plane_viewer.as_ref().filter(|_| is_last) {
                spawn(scope, "sections", usual, move || plane_viewer::run(volume, &**viewer));
            }
            let insert = spawn(scope, "weave", (&*policy, Role::Weaving), move || {
                insert::run(volume, &posed, common, is_last, pictured)
            });
            let pair = spawn(scope, "pairing", (&*policy, Role::Pairing), move || match is_live {
                true => stage.run(&mut FromDevices { from: &delivered, intake: sequencer }),
                false => stage.run(&mut FromRecording(delivered)),
            });
            let delivering = match replay {
                Some(replay) => Delivering::Replay(spawn(scope, "replay", usual, move || {
                    replay::run(replay, names, common, ends, &deliver)
                })),
                None => {
                    drop(deliver);
                    Delivering::Captures(capturing(scope, devices, names, policy, common, ends, sequencer))
                }
            };
            // A device that ends by itself leaves the others running. A live session ends when no
            // device is left or insertion has failed.
            let is_over = || match &delivering {
                Delivering::Captures(captures) => {
                    ends.load(Ordering::Relaxed)
                        || captures.iter().all(ScopedJoinHandle::is_finished)
                        || insert.is_finished()
                }
                Delivering::Replay(replay) => replay.is_finished() && pair.is_finished() && insert.is_finished(),
            };
            while !is_over() {
                std::thread::sleep(TURN);
                if is_live && policy.watch() {
                    board.granted(policy.granted());
                }
                let account = board.snapshot();
                if is_live {
                    losses.say(&account, Instant::now(), false);
                    warnings.say(account.distortion, Instant::now());
                }
                for instruction in watch(&account) {
                    match instruction {
                        Instruction::Command(Command::Freeze(on)) => drop(sequencer.freeze(on)),
                        Instruction::Command(Command::Clear) => drop(sequencer.clear()),
                        Instruction::Command(Command::Stop) => ends.store(true, Ordering::Relaxed),
                        Instruction::Command(Command::Set(setting)) => match setting {
                            Setting::Latency { device, ns } => drop(sequencer.latency(device, ns)),
                            Setting::StuckAfter(ns) => board.stuck_after(ns),
                            Setting::View => view.iter().for_each(|view| view.changed()),
                            Setting::KeepFree(bytes) => keep_free.store(bytes, Ordering::Relaxed),
                        },
                        // The session controller executes these: they concern the next session,
                        // or the reader that saves.
                        Instruction::Command(Command::Record | Command::Scan | Command::Save) => {}
                        Instruction::Note(kind, value) => common.recorder.note(kind, &value, clock.now_ns()),
                        Instruction::Report(sentence) => board.note(sentence),
                    }
                }
            }
            let delivered = match delivering {
                Delivering::Captures(captures) => {
                    ends.store(true, Ordering::Relaxed);
                    // `watch` sees the end. Instructions returned now are too late.
                    drop(watch(&board.snapshot()));
                    captured(captures, names, board);
                    Ok(())
                }
                Delivering::Replay(replay) => joined(replay),
            };
            sequencer.close();
            joined(pair).into_iter().for_each(|note| board.note(note));
            let inserted = joined(insert);
            drawn = picture.and_then(|picture| shown(joined(picture), board));
            if common.recorder.records() {
                let made = volume.seal(drawn.as_ref().map(|drawn| &drawn.renderer));
                common.recorder.note(digest::SEAL, &made, clock.now_ns());
                seal = Some(made);
            }
            common.recorder.close();
            recording = writer.map(joined);
            inserted?;
            delivered.map_err(PipelineError::from)
        })?;
        let account = board.snapshot();
        if is_live {
            losses.say(&account, Instant::now(), true);
        }
        if let Some(decisions) = decisions.as_ref().filter(|_| is_last) {
            let made = volume.seal(drawn.as_ref().map(|drawn| &drawn.renderer));
            if !ends.load(Ordering::Relaxed) {
                decisions.sealed(&made);
            }
            seal = Some(made);
        }
        Ok(Ran { account, drawn, recording, seal, decisions })
    }
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
