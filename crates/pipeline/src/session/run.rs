//! The wiring of a session: starts its threads, follows instructions, and waits for its end.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::ScopedJoinHandle;
use std::time::{Duration, Instant};

use crossbeam_channel::{RecvTimeoutError, Sender, bounded};

use drivers::replay::SessionReplay;
use sonoweave_core::clock::{Clock, Monotonic};
use sonoweave_core::{Device, Error};

use super::capture_thread::{Capturing, Parts, captured, capturing, frame_bytes, parts};
use super::common::{Common, InFlight};
use super::digest::{self, ResultDigest};
use super::ended::EndedSession;
use super::insertion_thread::{self, InsertMessage, Insertion};
use super::losses::Losses;
use super::memory::places;
use super::pairing_thread::{Pairing, SliceSink};
use super::priority::{Role, SchedulingPolicy};
use super::recorded_decisions::{MARKER, RecordedDecisions};
use super::recorder::{self, Recorder, Recording};
use super::render_thread::{self, Drawn, SharedViewClient};
use super::replay::{self, FromRecording, Recorded};
use super::sequence::{self, Sequence};
use super::sequencer::{EventSequencer, FromDevices};
use super::settings::{Session, SessionInputs, Source};
use super::shared_volume::Shared;
use super::spawn::{EndOnPanic, joined, spawn};
use super::status::{SessionStatus, StatusCollector};
use super::zones::Warnings;
use super::{brick_viewer, plane_viewer, reader};
use crate::PipelineError;
use crate::command::{Command, Instruction, Setting};

/// Capacity of the queue between capture and pairing, readings.
pub(super) const READINGS: usize = 4096;
/// The same for a recording, which waits for room.
pub(super) const RECORDED: usize = 64;
/// Capacity of the queue between pairing and insertion, slices.
const SLICES: usize = 64;
/// The same for a sequence, which is read while slices are inserted, and waits for room.
const READ_AHEAD: usize = 8;
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
        (Some(first), _) | (None, Source::Recording(first)) => session.volume_of_recording(first)?,
        (None, Source::Devices { devices, .. }) => {
            session.volume(devices.iter().map(|device| &device.role), true, false)?
        }
        (None, Source::Sequence(sequence)) => session.volume_of_sequence(sequence)?,
    };
    let notes = resume(session, &volume, resumed, ends)?;
    let view = session.view_client.clone().map(SharedViewClient::new);
    let wiring = Wiring { session, volume: &volume, view: view.as_ref(), is_last: true, clock, ends };
    let ran = wiring.run(source, &mut policy, notes, &mut watch)?;
    let Ran { status, drawn, recording, digest, decisions, insert_ms } = ran;
    Ok(EndedSession { session, volume, view, drawn, status, recording, digest, decisions, insert_ms })
}

/// Inserts the slices of the sessions that a session continues. Returns notes for the user.
pub(super) fn resume(
    session: &Session,
    volume: &Shared,
    resumed: Vec<Recorded>,
    ends: &AtomicBool,
) -> Result<Vec<String>, PipelineError> {
    let mut notes = Vec::new();
    for recorded in resumed {
        let path = recorded.replay.settings().path.display().to_string();
        let wiring = Wiring { session, volume, view: None, is_last: false, clock: &Monotonic, ends };
        let ran = wiring
            .run(Source::Recording(recorded), &mut SchedulingPolicy::default(), Vec::new(), &mut |_| Vec::new())?;
        notes.push(format!("the session continues {path}: {} slices are in the volume", volume.resume()));
        if let Some(first) = ran.decisions.and_then(|decisions| decisions.differences().first) {
            notes.push(format!("{path}: {first}"));
        }
    }
    Ok(notes)
}

/// The results of a source.
pub(super) struct Ran {
    pub(super) status: SessionStatus,
    drawn: Option<Drawn>,
    recording: Option<Recording>,
    digest: Option<ResultDigest>,
    pub(super) decisions: Option<RecordedDecisions>,
    pub(super) insert_ms: Vec<f64>,
}

/// A source, opened.
#[allow(clippy::large_enum_variant, reason = "a session has one, moved once")]
enum Opened {
    Devices(Vec<Box<dyn Device>>),
    Recording(SessionReplay),
    Sequence(Sequence),
}

/// A source, with the stage or the queue that receives its data.
#[allow(clippy::large_enum_variant, reason = "a session has one, moved once")]
enum Feeding<'a> {
    Devices(Vec<Box<dyn Device>>, Pairing<'a>),
    Recording(SessionReplay, Pairing<'a>),
    Sequence(Sequence, Sender<InsertMessage>),
}

/// The threads before insertion. Pairing returns notes for the user.
enum Delivering<'scope> {
    Devices { captures: Vec<Capturing<'scope>>, pairing: ScopedJoinHandle<'scope, Vec<String>> },
    Recording { replay: ScopedJoinHandle<'scope, Result<(), Error>>, pairing: ScopedJoinHandle<'scope, Vec<String>> },
    Sequence(ScopedJoinHandle<'scope, Result<Vec<String>, PipelineError>>),
}

/// A session's parts that its threads share.
#[derive(Clone, Copy)]
pub(super) struct Wiring<'a> {
    pub(super) session: &'a Session,
    pub(super) volume: &'a Shared,
    pub(super) view: Option<&'a SharedViewClient>,
    /// Whether no source follows.
    pub(super) is_last: bool,
    pub(super) clock: &'a dyn Clock,
    pub(super) ends: &'a AtomicBool,
}

impl Wiring<'_> {
    /// Runs one source to its end.
    pub(super) fn run(
        self,
        source: Source,
        policy: &mut SchedulingPolicy,
        notes: Vec<String>,
        watch: &mut dyn FnMut(&SessionStatus) -> Vec<Instruction>,
    ) -> Result<Ran, PipelineError> {
        let Self { session, volume, view, is_last, clock, ends } = self;
        let (opened, roles, protocols, record, decisions) = match source {
            Source::Devices { devices, record } => {
                let Parts { devices, roles, protocols } = parts(devices);
                (Opened::Devices(devices), roles, protocols, record, None)
            }
            Source::Recording(Recorded { replay, decisions, roles }) => {
                (Opened::Recording(replay), roles, Vec::new(), None, Some(decisions))
            }
            Source::Sequence(sequence) => {
                let roles = vec![sequence.role()];
                (Opened::Sequence(sequence), roles, Vec::new(), None, None)
            }
        };
        let devices: &[Box<dyn Device>] = if let Opened::Devices(devices) = &opened { devices } else { &[] };
        let is_live = matches!(opened, Opened::Devices(_));
        let recorded = record.as_ref().filter(|record| !record.full_frame).map(|_| session.mask);
        let status = StatusCollector::new(&roles, session.stuck_after_ns).recording_of(recorded);
        let prepared_bytes = devices.iter().map(|device| device.prepared_bytes()).sum();
        let status = status.with_memory(frame_bytes(devices), prepared_bytes);
        notes.into_iter().for_each(|note| status.note(note));
        status.lock().pose_noise = session.pose_noise;
        let in_flight = InFlight::new(if is_live { FRAME_BYTES / frame_bytes(devices).max(1) } else { u64::MAX });
        let keep_free = Arc::new(AtomicU64::new(record.as_ref().map_or(0, |record| record.keep_free_bytes)));
        let (recorder, writing) = match record {
            Some(record) => {
                let described = roles.iter().zip(devices).zip(protocols);
                let described = described.map(|((role, device), protocol)| (&*role.name, protocol, device.describe()));
                let (recorder, writing) = recorder::open(record, described, session.mask, &keep_free, clock)?;
                (recorder, Some(writing))
            }
            None => (Recorder::nowhere(), None),
        };
        let names: Vec<String> = roles.iter().map(|role| role.name.clone()).collect();
        let (deliver, delivered) = bounded(if is_live { READINGS } else { RECORDED });
        let common = Common {
            clock,
            status: &status,
            recorder: &recorder,
            in_flight: &in_flight,
            decisions: decisions.as_ref(),
            observers: &session.observers,
        };
        let sequencer = EventSequencer::new(common, names.clone(), deliver.clone());
        let (slices, posed) = bounded(if matches!(opened, Opened::Sequence(_)) { READ_AHEAD } else { SLICES });
        status.queue_places(recorder.place_bytes() + places(&deliver) + places(&slices));
        let feeding = match opened {
            Opened::Devices(devices) => {
                Feeding::Devices(devices, session.pairing_stage(roles, common, SliceSink::OrDrop(slices))?)
            }
            Opened::Recording(replay) => {
                Feeding::Recording(replay, session.pairing_stage(roles, common, SliceSink::Waits(slices))?)
            }
            Opened::Sequence(sequence) => Feeding::Sequence(sequence, slices),
        };
        if is_live {
            status.granted(policy.granted());
            recorder.note_rules(clock.now_ns());
        } else {
            status.replayed();
            // The recording has its own events.
            sequencer.close();
        }
        let every = view.filter(|_| !is_live).and_then(|view| view.client().every());
        let insertion = Insertion { is_last, every, of_sequence: matches!(feeding, Feeding::Sequence(..)) };
        let (status, sequencer, names) = (&status, &sequencer, &names);
        let (mut recording, mut drawn, mut digest, mut insert_ms) = (None, None, None, Vec::new());
        let (mut losses, mut warnings) = (Losses::default(), Warnings::default());
        // Each thread that ends by itself has a sender, so that the last end is noticed at once.
        let (running, ended) = bounded::<()>(0);
        std::thread::scope(|scope| {
            let _end = EndOnPanic(|| {
                ends.store(true, Ordering::Relaxed);
                sequencer.close();
                common.recorder.close();
            });
            let usual = (&*policy, Role::Usual);
            let writer = writing.map(|writing| {
                recorder::start(scope, policy, writing, clock, move |recording| status.recording(recording))
            });
            let picture = view.map(|view| {
                spawn(scope, "picture", usual, move || {
                    render_thread::run(volume, view, every.is_some(), clock, |drawn| status.drawn(drawn))
                })
            });
            for reader in session.readers.iter().filter(|_| is_last) {
                spawn(scope, "reader", usual, move || reader::run(volume, &**reader));
            }
            if let Some(viewer) = session.plane_viewer.as_ref().filter(|_| is_last) {
                spawn(scope, "sections", usual, move || plane_viewer::run(volume, &**viewer, Some(common.status)));
            }
            if let Some(viewer) = session.brick_viewer.as_ref().filter(|_| is_last) {
                spawn(scope, "bricks", usual, move || brick_viewer::run(volume, &**viewer));
            }
            let inserting = running.clone();
            let insert = spawn(scope, "insertion", (&*policy, Role::Insertion), move || {
                let _inserting = inserting;
                insertion_thread::run(volume, &posed, common, insertion)
            });
            let pairing = (&*policy, Role::Pairing);
            let delivering = match feeding {
                Feeding::Devices(devices, stage) => {
                    drop((running, deliver));
                    Delivering::Devices {
                        pairing: spawn(scope, "pairing", pairing, move || {
                            stage.run(&mut FromDevices { events: &delivered, sequencer })
                        }),
                        captures: capturing(scope, devices, names, policy, common, ends, sequencer),
                    }
                }
                Feeding::Recording(replay, stage) => Delivering::Recording {
                    pairing: spawn(scope, "pairing", pairing, move || stage.run(&mut FromRecording(delivered))),
                    replay: spawn(scope, "replay", usual, move || {
                        let _running = running;
                        replay::run(replay, names, common, ends, &deliver)
                    }),
                },
                Feeding::Sequence(sequence, slices) => {
                    Delivering::Sequence(spawn(scope, "pairing", pairing, move || {
                        let _running = running;
                        sequence::run(sequence, session.pairing.clone(), common, ends, &slices)
                    }))
                }
            };
            // A device that ends by itself leaves the others running. A live session ends when no
            // device is left or insertion has failed.
            let is_over = || match &delivering {
                Delivering::Devices { captures, .. } => {
                    ends.load(Ordering::Relaxed) || captures.iter().all(ScopedJoinHandle::is_finished)
                }
                Delivering::Recording { .. } | Delivering::Sequence(_) => false,
            };
            while !is_over() && ended.recv_timeout(TURN) == Err(RecvTimeoutError::Timeout) {
                if is_live && policy.watch() {
                    status.granted(policy.granted());
                }
                status.count_page_faults();
                let now = status.snapshot();
                if is_live {
                    losses.log(&now, Instant::now(), false);
                    warnings.log(now.distortion, Instant::now());
                }
                for instruction in watch(&now) {
                    match instruction {
                        Instruction::Command(Command::Freeze(on)) => drop(sequencer.freeze(on)),
                        Instruction::Command(Command::Clear) => drop(sequencer.clear()),
                        Instruction::Command(Command::Mask(change)) => drop(sequencer.mask(change)),
                        Instruction::Command(Command::Mark(marker)) => {
                            common.recorder.note(MARKER, &marker, clock.now_ns());
                        }
                        Instruction::Command(Command::Stop) => ends.store(true, Ordering::Relaxed),
                        Instruction::Command(Command::Set(setting)) => match setting {
                            Setting::Latency { device, ns } => drop(sequencer.latency(device, ns)),
                            Setting::StuckAfter(ns) => status.stuck_after(ns),
                            Setting::View => view.iter().for_each(|view| view.changed()),
                            Setting::KeepFree(bytes) => keep_free.store(bytes, Ordering::Relaxed),
                        },
                        // The session controller executes these: they concern the next session,
                        // or the reader that saves.
                        Instruction::Command(Command::Record | Command::Scan | Command::Save) => {}
                        Instruction::Note(kind, value) => common.recorder.note(kind, &value, clock.now_ns()),
                        Instruction::Report(sentence) => status.note(sentence),
                    }
                }
            }
            let delivered = match delivering {
                Delivering::Devices { captures, pairing } => {
                    ends.store(true, Ordering::Relaxed);
                    // `watch` sees the end. Instructions returned now are too late.
                    drop(watch(&status.snapshot()));
                    captured(captures, names, status);
                    sequencer.close();
                    Ok(joined(pairing))
                }
                Delivering::Recording { replay, pairing } => {
                    let (notes, delivered) = (joined(pairing), joined(replay));
                    notes.into_iter().for_each(|note| status.note(note));
                    delivered.map(|()| Vec::new()).map_err(PipelineError::from)
                }
                Delivering::Sequence(reading) => joined(reading),
            };
            let inserted = joined(insert);
            drawn = picture.and_then(|picture| last_picture(joined(picture), status));
            if common.recorder.records() {
                let made = volume.digest(drawn.as_ref().map(|drawn| &drawn.renderer));
                common.recorder.note(digest::DIGEST, &made, clock.now_ns());
                digest = Some(made);
            }
            common.recorder.close();
            recording = writer.map(joined);
            insert_ms = inserted?;
            delivered?.into_iter().for_each(|note| status.note(note));
            Ok::<(), PipelineError>(())
        })?;
        let status = status.snapshot();
        if is_live {
            losses.log(&status, Instant::now(), true);
        }
        if let Some(decisions) = decisions.as_ref().filter(|_| is_last) {
            let made = volume.digest(drawn.as_ref().map(|drawn| &drawn.renderer));
            if !ends.load(Ordering::Relaxed) {
                decisions.compare_digest(&made);
            }
            digest = Some(made);
        }
        Ok(Ran { status, drawn, recording, digest, decisions, insert_ms })
    }
}

/// Returns the picture; adds a note if it failed.
fn last_picture(
    drawn: Result<Option<Drawn>, Box<dyn std::error::Error + Send + Sync>>,
    board: &StatusCollector,
) -> Option<Drawn> {
    drawn.unwrap_or_else(|error| {
        board.note(format!("no picture: {error}"));
        None
    })
}
