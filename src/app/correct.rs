//! Corrections of recorded sessions: decisions beside the readings, which never change them.
//!
//! A correction replaces the poses of a session's frames, or leaves frames out. It is computed
//! once, by a method with settings, and its result is stored: a replay applies that, and an
//! improved method changes no earlier session. Corrections stand in a fixed order: smoothing,
//! calibration, drift, jitter, pressure, gate. Each names the poses that it was computed from by
//! their hash. If one before it is added or undone, these are others: the correction is stale, and
//! is not applied.

mod applied;
pub(crate) mod calibration;
mod differences;
pub(crate) mod drift;
mod file;
pub(crate) mod gate;
mod gating;
pub(crate) mod jitter;
mod listed;
mod note;
mod options;
mod poses;
pub(crate) mod pressure;
mod slices;
pub(crate) mod smoothing;
mod standing;

pub(crate) use applied::apply;
pub(crate) use file::CorrectionFile;
pub(crate) use listed::{Listed, State, change, list, standing};
pub(crate) use note::{Correction, Kind};
pub(crate) use options::{GateSignal, Settings};
pub(crate) use standing::Standing;
