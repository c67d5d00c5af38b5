//! The state of a batch, by the accounts in its folder.

use std::fmt::Write as _;

use serde::Serialize;

use super::attempt::{self, Attempt};
use super::done::is_done;
use super::folder::RunFolder;
use super::plan::{self, Planned};
use super::select::Selection;
use crate::failure::{Failure, FailureKind};

/// State of a sweep that is not done.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum SweepState {
    Failed,
    Running,
    Waiting,
}

/// A sweep that is not done.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Unfinished {
    pub(crate) id: String,
    pub(crate) state: SweepState,
    /// Tries that have ended.
    pub(crate) attempts: u32,
    /// Exit code of the last one.
    pub(crate) exit: Option<i32>,
    pub(crate) kind: Option<FailureKind>,
    pub(crate) peak_bytes: Option<u64>,
    pub(crate) sentence: Option<String>,
}

/// State of a batch.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub(crate) struct Status {
    pub(crate) sweeps: usize,
    pub(crate) done: usize,
    pub(crate) failed: usize,
    pub(crate) running: usize,
    pub(crate) waiting: usize,
    /// Sweeps that are not done and have been tried.
    pub(crate) unfinished: Vec<Unfinished>,
}

/// Returns the state of a batch's selected sweeps.
///
/// # Errors
/// [`Failure`] when its folder cannot be read.
pub(crate) fn status(folder: &RunFolder, selection: &Selection) -> Result<Status, Failure> {
    status_of(folder, &selection.of(&plan::read(folder)?)?)
}

/// Returns the state of these sweeps.
///
/// # Errors
/// [`Failure`] when the batch's folder cannot be read.
pub(super) fn status_of(folder: &RunFolder, sweeps: &[&Planned]) -> Result<Status, Failure> {
    let mut status = Status { sweeps: sweeps.len(), ..Status::default() };
    for sweep in sweeps {
        if is_done(folder, sweep) {
            status.done += 1;
            continue;
        }
        let attempts = attempt::of(folder, &sweep.id, &sweep.key)?;
        let failed: Vec<&Attempt> = attempts.iter().filter(|attempt| attempt.has_failed()).collect();
        let last = failed.last();
        let state = match (attempts.iter().any(Attempt::is_running), last) {
            (true, _) => SweepState::Running,
            (false, Some(_)) => SweepState::Failed,
            (false, None) => SweepState::Waiting,
        };
        match state {
            SweepState::Running => status.running += 1,
            SweepState::Failed => status.failed += 1,
            _ => status.waiting += 1,
        }
        if state != SweepState::Waiting {
            let exit = last.and_then(|attempt| attempt.exit);
            status.unfinished.push(Unfinished {
                id: sweep.id.clone(),
                state,
                attempts: failed.len() as u32,
                exit,
                kind: exit.and_then(FailureKind::of_code),
                peak_bytes: last.and_then(|attempt| attempt.peak_bytes),
                sentence: last.and_then(|attempt| attempt.sentence.clone()),
            });
        }
    }
    Ok(status)
}

/// Returns the state as metrics, for the text file collector of Prometheus's node exporter.
pub(crate) fn metrics(status: &Status) -> String {
    let mut text = String::from(
        "# HELP sonoweave_batch_sweeps Sweeps of a batch, by their state.\n# TYPE sonoweave_batch_sweeps gauge\n",
    );
    let states =
        [("done", status.done), ("failed", status.failed), ("running", status.running), ("waiting", status.waiting)];
    for (state, count) in states {
        // Writing to a string does not fail.
        let _ = writeln!(text, "sonoweave_batch_sweeps{{state=\"{state}\"}} {count}");
    }
    text
}
