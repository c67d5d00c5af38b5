//! Session controller: the commands that viewers can send to a session, and the session's
//! phase.
//!
//! ```text
//!            ┌──────────── record, scan ───────────┐
//!            ▼                                     │
//! opening ─▶ running ── stop ─▶ ending ─▶ over ────┘
//!            │   ▲
//!            └───┘ freeze, clear, mark, save
//! ```
//!
//! A recorded session holds all of its volume in its recording, so that it can be replayed.
//! Recording therefore begins a new volume, and ends with the session. An ended session stays
//! visible until the next one begins. Freeze and clear commands pass through the same queue as
//! readings ([`crate::session`]) and are in the recording, too.
//!
//! A recorded session ([`Replayed`]) runs and ends in the same way. It records and omits
//! nothing, but it can be replayed with other settings. After its end, its frames can be viewed
//! one by one.
//!
//! Commands are answered at once, and nobody waits for them. [`ControlStatus::events`] reports the
//! result of longer operations.

pub mod keep;
mod refusal;
mod replayed;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use serde::Serialize;

use config::bedside::SettingsOverride;
use mask::MaskChange;
use reconstruct::Path as InsertionPath;

use crate::command::Command;
use crate::session::{NoVolume, Reader, SessionStatus, Snapshot, VolumeRequest};
use crate::{MaskRefusal, MaskStatus};

pub use refusal::{ControlError, SaveError};
pub use replayed::{CorrectionRequest, ListedCorrection, ReplayStatus, Replayed, ViewedFrame};

/// Number of events reported.
const EVENTS: usize = 8;
/// Largest volume that can be saved while it grows, bytes: it is in memory twice then.
const MOST_BYTES: u64 = 4 << 30;

/// Phase of the session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    /// The devices are being opened.
    #[default]
    Opening,
    /// Slices are being inserted.
    Running,
    /// The remaining slices are being inserted and written.
    Ending,
    /// No more input arrives.
    Over,
}

/// Outcome of an operation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Progress {
    /// Under way.
    Begun,
    /// Completed.
    Done,
    /// Failed.
    Failed,
}

/// An event, for users.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Event {
    /// Its number, from 1.
    pub number: u64,
    /// Its outcome.
    pub how: Progress,
    /// A sentence.
    #[serde(rename = "says")]
    pub text: String,
}

/// Status of the session controller.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct ControlStatus {
    /// Phase of the session.
    pub phase: Phase,
    /// Whether the session is recorded.
    pub records: bool,
    /// Whether the user has frozen the session.
    pub frozen: bool,
    /// Whether there is a folder to record and save in.
    pub keeps: bool,
    /// Fraction of a volume being saved that is read, 0 to 1.
    pub saving: Option<f64>,
    /// The last events, the oldest first.
    pub events: Vec<Event>,
    /// Status of a replayed session.
    pub replayed: Option<ReplayStatus>,
}

/// The session that follows an ended one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Next {
    /// Whether it is recorded.
    pub records: bool,
}

#[derive(Debug, Default)]
struct State {
    phase: Phase,
    records: bool,
    frozen: bool,
    /// Whether a viewer has ended the session.
    stopped: bool,
    /// The session requested to follow.
    next: Option<Next>,
    /// Commands that wait for the running session.
    waiting: Vec<Command>,
    saving: Option<f64>,
    /// The mask of slices, and whether they are inserted by the planar path.
    mask: Option<MaskStatus>,
    planar: bool,
    /// Source of the volume, and name of its coordinate system.
    input: String,
    world: String,
    events: VecDeque<Event>,
    events_reported: u64,
}

impl State {
    /// Begins another phase, without waiting commands.
    fn begin(&mut self, phase: Phase) {
        (self.phase, self.records, self.frozen) = (phase, false, false);
        (self.mask, self.planar) = (None, false);
        self.waiting.clear();
    }
}

/// Passes commands from viewers to the session.
#[derive(Debug, Default)]
pub struct SessionController {
    folder: Option<PathBuf>,
    /// The recording, unless the session is live.
    replayed: Option<Replayed>,
    /// Whether the present operation is to end.
    turn: AtomicBool,
    volume_requested: AtomicBool,
    state: Mutex<State>,
}

impl SessionController {
    /// Controls a session that saves in this folder, if any.
    pub fn new(folder: Option<PathBuf>) -> Self {
        Self { folder, ..Self::default() }
    }

    /// Controls a recorded session.
    pub fn of_recording(folder: Option<PathBuf>, replayed: Replayed) -> Self {
        Self { folder, replayed: Some(replayed), ..Self::default() }
    }

    /// Returns the recorded session, if it is one.
    pub fn replayed(&self) -> Option<&Replayed> {
        self.replayed.as_ref()
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the folder to record and save in.
    ///
    /// # Errors
    /// [`ControlError::NoFolder`] if there is none.
    pub fn folder(&self) -> Result<&Path, ControlError> {
        self.folder.as_deref().ok_or(ControlError::NoFolder)
    }

    /// Executes a command, or begins to; returns a sentence about it.
    ///
    /// # Errors
    /// [`ControlError`]; nothing has changed.
    pub fn execute(&self, command: Command) -> Result<String, ControlError> {
        let mut state = self.state();
        let (phase, records) = (state.phase, state.records);
        if self.replayed.is_some()
            && matches!(
                command,
                Command::Record
                    | Command::Scan
                    | Command::Freeze(_)
                    | Command::Clear
                    | Command::Mask(_)
                    | Command::Mark(_)
                    | Command::Set(_)
            )
        {
            return Err(ControlError::Recorded);
        }
        match (command, phase) {
            (
                Command::Record
                | Command::Scan
                | Command::Stop
                | Command::Freeze(_)
                | Command::Clear
                | Command::Mask(_)
                | Command::Mark(_)
                | Command::Set(_),
                Phase::Opening | Phase::Ending,
            ) => Err(ControlError::Busy),
            (Command::Record, Phase::Running) if records => Err(ControlError::AlreadyRecording),
            (Command::Scan, Phase::Running) => Err(ControlError::AlreadyRunning),
            (Command::Record | Command::Scan, Phase::Running | Phase::Over) => {
                let records = command == Command::Record;
                if records {
                    self.folder()?;
                }
                (state.next, state.stopped) = (Some(Next { records }), true);
                self.turn.store(true, Ordering::Relaxed);
                Ok(if records { "a new volume begins, with a recording" } else { "a new volume begins" }.into())
            }
            (
                Command::Stop
                | Command::Freeze(_)
                | Command::Clear
                | Command::Mask(_)
                | Command::Mark(_)
                | Command::Set(_),
                Phase::Over,
            ) => Err(ControlError::Over),
            (Command::Stop, Phase::Running) => {
                (state.next, state.stopped) = (None, true);
                self.turn.store(true, Ordering::Relaxed);
                Ok("the session ends".into())
            }
            (Command::Freeze(on), Phase::Running) => {
                if state.frozen != on {
                    state.frozen = on;
                    state.waiting.push(command);
                }
                Ok(if on {
                    "frozen: no slices are inserted into the volume"
                } else {
                    "slices are inserted into the \
                    volume again"
                }
                .into())
            }
            (Command::Clear, Phase::Running) => {
                state.waiting.push(command);
                Ok("the volume was cleared and begins again".into())
            }
            (Command::Mask(change), Phase::Running) => {
                let present = state.mask.as_ref().ok_or(MaskRefusal::Undecided)?;
                present.check(&change)?;
                let changes = change.shape().is_some_and(|shape| shape != present.found.shape);
                if state.planar && changes {
                    return Err(MaskRefusal::Planar.into());
                }
                state.waiting.push(command);
                Ok(match change {
                    MaskChange::Keep => "the mask is confirmed".into(),
                    _ => format!("slices have another mask from now on: {change}"),
                })
            }
            (Command::Mark(_), Phase::Running) if !records => Err(ControlError::NotRecorded),
            (Command::Mark(_), Phase::Running) => {
                state.waiting.push(command);
                Ok("the moment is marked".into())
            }
            (Command::Set(_), Phase::Running) => {
                state.waiting.push(command);
                Ok("the setting holds from now on".into())
            }
            (Command::Save, _) => {
                self.folder()?;
                if state.saving.is_some() {
                    return Err(ControlError::Saving);
                }
                if matches!(phase, Phase::Opening | Phase::Ending) {
                    return Err(ControlError::Busy);
                }
                state.saving = Some(0.0);
                self.volume_requested.store(true, Ordering::Relaxed);
                Ok("the volume is being saved".into())
            }
        }
    }

    /// Begins to replay a recorded session, with its recorded settings except for those in
    /// `trial`. Returns a sentence.
    ///
    /// # Errors
    /// [`ControlError`]; nothing has changed.
    pub fn again(&self, trial: SettingsOverride) -> Result<String, ControlError> {
        let Some(replayed) = &self.replayed else { return Err(ControlError::Live) };
        let mut state = self.state();
        if matches!(state.phase, Phase::Opening | Phase::Ending) {
            return Err(ControlError::ReplayBusy);
        }
        let text = if trial.is_empty() {
            "the replay begins with the recorded settings"
        } else {
            "the replay begins with \
                these settings"
        };
        replayed.prepare(trial)?;
        (state.next, state.stopped) = (Some(Next { records: false }), true);
        self.turn.store(true, Ordering::Relaxed);
        Ok(text.into())
    }

    /// Changes the corrections of a recorded session; the replay then begins again with them.
    /// Returns a sentence.
    ///
    /// # Errors
    /// [`ControlError`]; nothing has changed.
    pub fn correct(&self, request: CorrectionRequest) -> Result<String, ControlError> {
        self.over()?.request_correction(request);
        Ok("the correction is being computed".into())
    }

    /// Shows a frame of a recorded session, by its position among all, from 1.
    ///
    /// # Errors
    /// [`ControlError`]; nothing has changed.
    pub fn show_frame(&self, number: u64) -> Result<(), ControlError> {
        self.over()?.request(number)
    }

    /// Returns the recorded session, if its replay has ended.
    fn over(&self) -> Result<&Replayed, ControlError> {
        let Some(replayed) = &self.replayed else { return Err(ControlError::Live) };
        if self.state().phase != Phase::Over {
            return Err(ControlError::ReplayRunning);
        }
        Ok(replayed)
    }

    /// Returns the controller's status.
    pub fn status(&self) -> ControlStatus {
        let state = self.state();
        ControlStatus {
            phase: state.phase,
            records: state.records,
            frozen: state.frozen,
            keeps: self.folder.is_some(),
            saving: state.saving,
            events: state.events.iter().cloned().collect(),
            replayed: self.replayed.as_ref().map(Replayed::status),
        }
    }

    /// Reports an event to viewers.
    pub fn report(&self, how: Progress, text: impl Into<String>) {
        let mut state = self.state();
        state.events_reported += 1;
        let event = Event { number: state.events_reported, how, text: text.into() };
        state.events.push_back(event);
        if state.events.len() > EVENTS {
            state.events.pop_front();
        }
    }

    /// Whether the present operation is to end.
    pub fn turns(&self) -> &AtomicBool {
        &self.turn
    }

    /// Records that a session runs from now on. `input` describes the source of its volume.
    pub fn runs(&self, records: bool, input: String) {
        let mut state = self.state();
        state.begin(Phase::Running);
        (state.records, state.input, state.next, state.stopped) = (records, input, None, false);
        self.turn.store(false, Ordering::Relaxed);
    }

    /// Whether a command ended the session, so that another may follow.
    pub fn stopped(&self) -> bool {
        self.state().stopped
    }

    /// Records that the session is ending.
    fn ends(&self) {
        self.state().phase = Phase::Ending;
    }

    /// Records that the session is over; it stays visible.
    pub fn is_over(&self) {
        self.state().begin(Phase::Over);
        self.turn.store(false, Ordering::Relaxed);
    }

    /// Records that devices are being opened for the next session, if one was requested.
    /// Returns it.
    pub fn opens(&self) -> Option<Next> {
        let mut state = self.state();
        let next = state.next.take();
        if next.is_some() {
            state.phase = Phase::Opening;
        }
        next
    }

    /// Called regularly with the running session's status.
    pub fn update(&self, status: &SessionStatus) {
        if self.turn.load(Ordering::Relaxed) {
            self.ends();
        }
        let mut state = self.state();
        if state.world != status.world {
            state.world.clone_from(&status.world);
        }
        if state.phase == Phase::Running && state.mask != status.mask {
            state.mask.clone_from(&status.mask);
        }
        state.planar = status.path == Some(InsertionPath::Planar.name());
    }

    /// Takes the commands that wait for the running session.
    pub fn commands(&self) -> Vec<Command> {
        std::mem::take(&mut self.state().waiting)
    }
}

impl Reader for SessionController {
    fn request(&self) -> VolumeRequest {
        if self.volume_requested.swap(false, Ordering::Relaxed) { VolumeRequest::Now } else { VolumeRequest::None }
    }

    fn with_weights(&self) -> bool {
        true
    }

    fn progress(&self, share: f64) {
        self.state().saving = Some(share);
    }

    fn volume(&self, volume: Result<Snapshot, NoVolume>) {
        let (input, world) = {
            let state = self.state();
            (state.input.clone(), state.world.clone())
        };
        let save = || -> Result<PathBuf, SaveError> { keep::volume(self.folder()?, &input, &world, &volume?) };
        let kept = save();
        self.state().saving = None;
        match kept {
            Ok(path) => self.report(Progress::Done, format!("the volume is saved: {}", path.display())),
            Err(why) => self.report(Progress::Failed, format!("the volume is not saved: {why}")),
        }
    }

    fn max_bytes(&self) -> u64 {
        MOST_BYTES
    }
}
