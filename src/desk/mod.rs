//! What whoever looks at a session may tell it to do, and how far it is.
//!
//! ```text
//!            ┌──────────── record, scan ───────────┐
//!            ▼                                     │
//! opening ─▶ running ── stop ─▶ ending ─▶ over ────┘
//!            │   ▲
//!            └───┘ freeze, clear, save
//! ```
//!
//! A session that is recorded has all of its volume in its recording, so that it can be run again: so recording begins a new volume, and ends with the session. What is over is
//! looked at until the next begins. To freeze and to clear are words that go the way of all readings ([`crate::pipeline::live`]) and are in the recording, too.
//!
//! A recorded session ([`Replayed`]) runs and is over in the same way; nothing is recorded or left out of it, but it is run again by other settings, and its frames are looked at
//! one by one when it is over.
//!
//! Who wishes is answered at once, and waited for by nobody; what takes longer is told by [`Told::events`].

pub mod keep;
mod replayed;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use serde::Serialize;

use crate::config::bedside::Trial;
use crate::pipeline::live::{Order, Reader, Snapshot, Wants};

pub use replayed::{Replayed, Seen, Told as ReplayedTold};

/// Where it is of no use to ask for a recording's.
const NO_RECORDING: &str =
    "this session is live; only a recorded one is run again or looked at frame by frame (sonoweave replay)";
/// Events that are told.
const EVENTS: usize = 8;
/// The most bytes of a volume that is saved while it grows: it is in memory twice then.
const MOST_BYTES: u64 = 4 << 30;

/// Something to be done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Deed {
    /// Begins a new volume, and records all that it is made of.
    Record,
    /// Begins a new volume, and records nothing.
    Scan,
    /// Ends the session; what there is of it is looked at.
    Stop,
    /// Pictures are not used from now on, or are again.
    Freeze(bool),
    /// Throws the volume away.
    Clear,
    /// Writes the volume as it is.
    Save,
}

/// How far the session is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    /// Devices are opened.
    #[default]
    Opening,
    /// Slices are woven.
    Running,
    /// What is on its way is still woven and written.
    Ending,
    /// Nothing comes in any more.
    Over,
}

/// How something went.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum How {
    /// It goes on.
    Begun,
    /// It is done.
    Done,
    /// It is not.
    Failed,
}

/// Something that happened, for people.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Event {
    /// Its number, from 1.
    pub number: u64,
    /// How it went.
    pub how: How,
    /// A sentence.
    pub says: String,
}

/// What there is to tell.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Told {
    /// How far it is.
    pub phase: Phase,
    /// Whether it is recorded.
    pub records: bool,
    /// Whether it is frozen by a wish.
    pub frozen: bool,
    /// Whether there is a folder to record and save in.
    pub keeps: bool,
    /// How much of a volume that is being saved is read, 0 to 1.
    pub saving: Option<f64>,
    /// What happened last, the oldest first.
    pub events: Vec<Event>,
    /// Of a recorded session.
    pub replayed: Option<ReplayedTold>,
}

/// What follows when a session is over.
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
    /// Whoever looks on has ended the session,
    stopped: bool,
    /// and wants this to follow.
    next: Option<Next>,
    orders: Vec<Deed>,
    saving: Option<f64>,
    /// Of what the volume is, and where it lies.
    input: String,
    world: String,
    events: VecDeque<Event>,
    happened: u64,
}

impl State {
    /// Another phase, of which nothing was wished yet.
    fn begin(&mut self, phase: Phase) {
        (self.phase, self.records, self.frozen) = (phase, false, false);
        self.orders.clear();
    }
}

/// Between those who wish and the session.
#[derive(Debug, Default)]
pub struct Desk {
    folder: Option<PathBuf>,
    /// The recording, where it is no live session.
    replayed: Option<Replayed>,
    /// What goes on at present is to end.
    turn: AtomicBool,
    wants_volume: AtomicBool,
    state: Mutex<State>,
}

impl Desk {
    /// Of a session that keeps things in this folder, if anywhere.
    pub fn new(folder: Option<PathBuf>) -> Self {
        Self { folder, ..Self::default() }
    }

    /// Of a recorded session.
    pub fn of_recording(folder: Option<PathBuf>, replayed: Replayed) -> Self {
        Self { folder, replayed: Some(replayed), ..Self::default() }
    }

    /// The recorded session that it is of, if it is of one.
    pub fn replayed(&self) -> Option<&Replayed> {
        self.replayed.as_ref()
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The folder to record and save in.
    ///
    /// # Errors
    /// A sentence where there is none.
    pub fn folder(&self) -> Result<&Path, String> {
        let none = || "no folder was named to keep anything in; start sonoweave with --keep DIR".to_owned();
        self.folder.as_deref().ok_or_else(none)
    }

    /// Does it, or begins to; what is done, in a sentence.
    ///
    /// # Errors
    /// A sentence, and nothing has changed.
    pub fn wish(&self, deed: Deed) -> Result<String, String> {
        let mut state = self.state();
        let busy = || Err("the session is just beginning or ending; wait a moment".to_owned());
        let over = || Err("the session is over; record or scan to begin a new one".to_owned());
        let (phase, records) = (state.phase, state.records);
        if self.replayed.is_some() && matches!(deed, Deed::Record | Deed::Scan | Deed::Freeze(_) | Deed::Clear) {
            return Err("this session is a recording, in which nothing is left out or added; run it again by other settings instead".into());
        }
        match (deed, phase) {
            (
                Deed::Record | Deed::Scan | Deed::Stop | Deed::Freeze(_) | Deed::Clear,
                Phase::Opening | Phase::Ending,
            ) => busy(),
            (Deed::Record, Phase::Running) if records => {
                Err("the session is being recorded already; stop it first to begin another".into())
            }
            (Deed::Scan, Phase::Running) => Err("the session runs already; clear it to begin a new volume".into()),
            (Deed::Record | Deed::Scan, Phase::Running | Phase::Over) => {
                let records = deed == Deed::Record;
                if records {
                    self.folder()?;
                }
                (state.next, state.stopped) = (Some(Next { records }), true);
                self.turn.store(true, Ordering::Relaxed);
                Ok(if records { "a new volume begins, and is recorded" } else { "a new volume begins" }.into())
            }
            (Deed::Stop | Deed::Freeze(_) | Deed::Clear, Phase::Over) => over(),
            (Deed::Stop, Phase::Running) => {
                (state.next, state.stopped) = (None, true);
                self.turn.store(true, Ordering::Relaxed);
                Ok("the session ends".into())
            }
            (Deed::Freeze(on), Phase::Running) => {
                if state.frozen != on {
                    state.frozen = on;
                    state.orders.push(deed);
                }
                Ok(if on { "frozen: no slice goes into the volume" } else { "slices go into the volume again" }.into())
            }
            (Deed::Clear, Phase::Running) => {
                state.orders.push(deed);
                Ok("the volume is empty, and begins anew".into())
            }
            (Deed::Save, _) => {
                self.folder()?;
                if state.saving.is_some() {
                    return Err("a volume is just being saved; wait for it".into());
                }
                if matches!(phase, Phase::Opening | Phase::Ending) {
                    return busy();
                }
                state.saving = Some(0.0);
                self.wants_volume.store(true, Ordering::Relaxed);
                Ok("the volume is being saved".into())
            }
        }
    }

    /// Begins to run a recorded session again, by what it was recorded by but for what is tried; what is done, in a sentence.
    ///
    /// # Errors
    /// A sentence, and nothing has changed.
    pub fn again(&self, trial: Trial) -> Result<String, String> {
        let Some(replayed) = &self.replayed else { return Err(NO_RECORDING.into()) };
        let mut state = self.state();
        if matches!(state.phase, Phase::Opening | Phase::Ending) {
            return Err("the recording is just being opened, or its run is ending; wait a moment".into());
        }
        let says =
            if trial.is_empty() { "it is run again as it was recorded" } else { "it is run again by these settings" };
        replayed.prepare(trial)?;
        (state.next, state.stopped) = (Some(Next { records: false }), true);
        self.turn.store(true, Ordering::Relaxed);
        Ok(says.into())
    }

    /// Looks at a frame of a recorded session, by its place among all, from 1.
    ///
    /// # Errors
    /// A sentence, and nothing has changed.
    pub fn look(&self, number: u64) -> Result<(), String> {
        let Some(replayed) = &self.replayed else { return Err(NO_RECORDING.into()) };
        if self.state().phase != Phase::Over {
            return Err(
                "the recording is run; its frames are looked at one by one when it is over, or was stopped".into()
            );
        }
        replayed.want(number)
    }

    /// What there is to tell.
    pub fn told(&self) -> Told {
        let state = self.state();
        Told {
            phase: state.phase,
            records: state.records,
            frozen: state.frozen,
            keeps: self.folder.is_some(),
            saving: state.saving,
            events: state.events.iter().cloned().collect(),
            replayed: self.replayed.as_ref().map(Replayed::told),
        }
    }

    /// Something happened that those who look on should know.
    pub fn happened(&self, how: How, says: impl Into<String>) {
        let mut state = self.state();
        state.happened += 1;
        let event = Event { number: state.happened, how, says: says.into() };
        state.events.push_back(event);
        if state.events.len() > EVENTS {
            state.events.pop_front();
        }
    }

    /// What goes on at present is to end.
    pub fn turns(&self) -> &AtomicBool {
        &self.turn
    }

    /// A session runs from now on; of what its volume is made, in words.
    pub fn runs(&self, records: bool, input: String) {
        let mut state = self.state();
        state.begin(Phase::Running);
        (state.records, state.input, state.next, state.stopped) = (records, input, None, false);
        self.turn.store(false, Ordering::Relaxed);
    }

    /// Whether the session was ended by a wish, so that another may follow.
    pub fn stopped(&self) -> bool {
        self.state().stopped
    }

    /// What runs comes to its end.
    fn ends(&self) {
        self.state().phase = Phase::Ending;
    }

    /// It is looked at from now on.
    pub fn is_over(&self) {
        self.state().begin(Phase::Over);
        self.turn.store(false, Ordering::Relaxed);
    }

    /// Devices are opened for what follows, if anything does.
    pub fn opens(&self) -> Option<Next> {
        let mut state = self.state();
        let next = state.next.take();
        if next.is_some() {
            state.phase = Phase::Opening;
        }
        next
    }

    /// Now and then while something goes on, whose volume lies in the world of this name: once the program `quits`, it is to end.
    pub fn goes_on(&self, world: &str, quits: bool) {
        if quits {
            self.turn.store(true, Ordering::Relaxed);
        }
        if self.turn.load(Ordering::Relaxed) {
            self.ends();
        }
        let mut state = self.state();
        if state.world != world {
            world.clone_into(&mut state.world);
        }
    }

    /// What the session is told to do.
    pub fn orders(&self) -> Vec<Order> {
        let deeds = std::mem::take(&mut self.state().orders);
        let order = |deed| match deed {
            Deed::Freeze(on) => Some(Order::Pause(on)),
            Deed::Clear => Some(Order::Clear),
            Deed::Record | Deed::Scan | Deed::Stop | Deed::Save => None,
        };
        deeds.into_iter().filter_map(order).collect()
    }
}

impl Reader for Desk {
    fn wants(&self) -> Wants {
        if self.wants_volume.swap(false, Ordering::Relaxed) { Wants::Any } else { Wants::Nothing }
    }

    fn weighs(&self) -> bool {
        true
    }

    fn taking(&self, share: f64) {
        self.state().saving = Some(share);
    }

    fn volume(&self, volume: Result<Snapshot, String>) {
        let (input, world) = {
            let state = self.state();
            (state.input.clone(), state.world.clone())
        };
        let kept = self.folder().and_then(|folder| keep::volume(folder, &input, &world, &volume?));
        self.state().saving = None;
        match kept {
            Ok(path) => self.happened(How::Done, format!("the volume is saved: {}", path.display())),
            Err(why) => self.happened(How::Failed, format!("the volume is not saved: {why}")),
        }
    }

    fn most_bytes(&self) -> u64 {
        MOST_BYTES
    }
}
