//! A recorded session that is looked at: which of its frames is to be seen, and by which settings it is to be run again.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use serde::Serialize;

use crate::config::bedside::{Bedside, Setting, Trial};

/// A recorded session.
#[derive(Debug)]
pub struct Replayed {
    /// By what it was recorded, or what was given instead.
    bedside: Bedside,
    /// The folder that it lies in.
    folder: PathBuf,
    frames: u64,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    /// What the run that is looked at was tried by,
    tried: Trial,
    /// and the next one, with the bedside that comes of it.
    next: Option<(Trial, Bedside)>,
    wanted: Option<u64>,
    seen: Option<Seen>,
}

/// A frame that is looked at.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Seen {
    /// Its place among all, from 1.
    pub number: u64,
    /// The number that its device gave it.
    pub frame: u64,
    /// When it was captured, s after the first one.
    pub time_s: f64,
    /// Whether it was posed, so that it is in the volume unless nothing of it is data.
    pub posed: bool,
}

/// What there is to tell.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Told {
    /// Frames in the recording.
    pub frames: u64,
    /// The one that is looked at.
    pub seen: Option<Seen>,
    /// What is tried instead of what it was recorded by.
    pub tried: Trial,
}

impl Replayed {
    /// So many frames, which lie in a folder and were recorded by these settings.
    pub fn new(bedside: Bedside, folder: PathBuf, frames: u64) -> Self {
        Self { bedside, folder, frames, state: Mutex::default() }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What can be tried, with what it was recorded by.
    pub fn settings(&self) -> Vec<Setting> {
        self.bedside.settings(&self.folder)
    }

    /// What there is to tell.
    pub fn told(&self) -> Told {
        let state = self.state();
        Told { frames: self.frames, seen: state.seen, tried: state.tried.clone() }
    }

    /// Makes ready to be run by other settings; by those that it was recorded by where nothing is tried.
    ///
    /// # Errors
    /// A sentence, as of [`Bedside::tried`]; nothing has changed.
    pub(super) fn prepare(&self, trial: Trial) -> Result<(), String> {
        let bedside = if trial.is_empty() { self.bedside.clone() } else { self.bedside.tried(&trial, &self.folder)? };
        self.state().next = Some((trial, bedside));
        Ok(())
    }

    /// By what it is run next, and whether that is tried.
    pub fn begins(&self) -> (Bedside, bool) {
        let mut state = self.state();
        let (trial, bedside) = state.next.take().unwrap_or_else(|| (Trial::new(), self.bedside.clone()));
        let is_tried = !trial.is_empty();
        (state.tried, state.seen, state.wanted) = (trial, None, None);
        (bedside, is_tried)
    }

    /// Wants to see a frame.
    ///
    /// # Errors
    /// A sentence for one that there is not.
    pub(super) fn want(&self, number: u64) -> Result<(), String> {
        if !(1..=self.frames).contains(&number) {
            return Err(format!("there is no frame {number}; the recording has 1 to {}", self.frames));
        }
        self.state().wanted = Some(number);
        Ok(())
    }

    /// The frame that is to be seen, its place from 0, if another one is.
    pub fn wanted(&self) -> Option<usize> {
        self.state().wanted.take().and_then(|number| usize::try_from(number - 1).ok())
    }

    /// It is seen.
    pub fn sees(&self, seen: Seen) {
        self.state().seen = Some(seen);
    }
}
