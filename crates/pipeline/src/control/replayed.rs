//! A recorded session being viewed: the frame to show, and the settings of its next replay.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use serde::Serialize;

use config::bedside::{Bedside, Setting, SettingsOverride};

use super::refusal::ControlError;

/// A recorded session.
#[derive(Debug)]
pub struct Replayed {
    /// The recorded configuration, or the one given instead.
    bedside: Bedside,
    /// The recording's folder.
    folder: PathBuf,
    frames: u64,
    state: Mutex<State>,
}

/// A requested change of a recording's corrections.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CorrectionRequest {
    /// Smooth the poses.
    Smoothing,
    /// Correct calibration and latency by crossing sweeps.
    Calibration,
    /// Correct slow drift by crossing sweeps.
    Drift,
    /// Correct frames within their planes by their neighbours' images.
    Jitter,
    /// Undo the compression of tissue.
    Pressure {
        /// Number of the sweep with light contact, from 1.
        light: usize,
    },
    /// Leave frames out by breathing.
    Gate,
    /// Undo the correction of this number.
    Undo(u64),
}

/// A correction that stands.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ListedCorrection {
    /// Its number.
    pub id: u64,
    /// Its kind, such as `smoothing`.
    pub kind: &'static str,
    /// Whether it was computed from other poses than those before it now, and is not applied.
    pub is_stale: bool,
    /// The numbers by which it was judged, in words.
    pub words: String,
}

#[derive(Debug, Default)]
struct State {
    /// Settings override of the run being viewed.
    settings: SettingsOverride,
    /// The next settings override, and the resulting configuration.
    next: Option<(SettingsOverride, Bedside)>,
    requested: Option<u64>,
    corrections: Vec<ListedCorrection>,
    correction: Option<CorrectionRequest>,
    seen: Option<ViewedFrame>,
}

/// A frame being viewed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ViewedFrame {
    /// Its position among all, from 1.
    pub number: u64,
    /// The number that its device gave it.
    pub frame: u64,
    /// Its capture time, s after the first frame.
    pub time_s: f64,
    /// Whether it has a pose. If so, it is in the volume, unless it contains no data.
    pub posed: bool,
}

/// Status of a recorded session.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct ReplayStatus {
    /// Frames in the recording.
    pub frames: u64,
    /// The frame being viewed.
    pub seen: Option<ViewedFrame>,
    /// Settings that override the recorded ones.
    #[serde(rename = "tried")]
    pub settings: SettingsOverride,
    /// Corrections that stand.
    pub corrections: Vec<ListedCorrection>,
}

impl Replayed {
    /// Describes a recording: its configuration, its folder, and its number of frames.
    pub fn new(bedside: Bedside, folder: PathBuf, frames: u64) -> Self {
        Self { bedside, folder, frames, state: Mutex::default() }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the settings that can be overridden, with their recorded values.
    pub fn settings(&self) -> Vec<Setting> {
        self.bedside.settings(&self.folder)
    }

    /// Returns the status.
    pub fn status(&self) -> ReplayStatus {
        let state = self.state();
        let (settings, corrections) = (state.settings.clone(), state.corrections.clone());
        ReplayStatus { frames: self.frames, seen: state.seen, settings, corrections }
    }

    /// Prepares a replay with other settings; an empty `trial` means the recorded ones.
    ///
    /// # Errors
    /// That of [`Bedside::tried`]; nothing has changed.
    pub(super) fn prepare(&self, trial: SettingsOverride) -> Result<(), ControlError> {
        let bedside = match trial.is_empty() {
            true => self.bedside.clone(),
            false => self.bedside.tried(&trial, &self.folder)?,
        };
        self.state().next = Some((trial, bedside));
        Ok(())
    }

    /// Returns the configuration of the next run, and whether it overrides recorded settings.
    pub fn begins(&self) -> (Bedside, bool) {
        let mut state = self.state();
        let (trial, bedside) = state.next.take().unwrap_or_else(|| (SettingsOverride::new(), self.bedside.clone()));
        let is_tried = !trial.is_empty();
        (state.settings, state.seen, state.requested) = (trial, None, None);
        (bedside, is_tried)
    }

    /// Requests a frame.
    ///
    /// # Errors
    /// [`ControlError::NoFrame`] if there is no such frame.
    pub(super) fn request(&self, number: u64) -> Result<(), ControlError> {
        if !(1..=self.frames).contains(&number) {
            return Err(ControlError::NoFrame { number, frames: self.frames });
        }
        self.state().requested = Some(number);
        Ok(())
    }

    /// Requests a change of the corrections.
    pub(super) fn request_correction(&self, request: CorrectionRequest) {
        self.state().correction = Some(request);
    }

    /// Returns the requested change of the corrections, once per request.
    pub fn correction_requested(&self) -> Option<CorrectionRequest> {
        self.state().correction.take()
    }

    /// Records the corrections that stand.
    pub fn set_corrections(&self, corrections: Vec<ListedCorrection>) {
        self.state().corrections = corrections;
    }

    /// Returns the requested frame, its position from 0, once per request.
    pub fn requested(&self) -> Option<usize> {
        self.state().requested.take().and_then(|number| usize::try_from(number - 1).ok())
    }

    /// Records that a frame is shown.
    pub fn set_viewed(&self, seen: ViewedFrame) {
        self.state().seen = Some(seen);
    }
}
