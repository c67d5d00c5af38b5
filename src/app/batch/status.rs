//! The state of a batch, by the accounts in its folder.

use std::fmt::Write as _;

use serde::Serialize;

use super::attempt::{self, Attempt};
use super::done;
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
    /// Time of the tries that made those that are done, s.
    pub(crate) done_s: f64,
    /// Time of all tries of those that have failed, s.
    pub(crate) failed_s: f64,
    /// Time of all tries of those that run, s.
    pub(crate) running_s: f64,
    /// Sweeps that are not done and have been tried.
    pub(crate) unfinished: Vec<Unfinished>,
}

/// Returns the state of a batch's selected sweeps.
///
/// # Errors
/// [`Failure`] when its folder cannot be read.
pub(crate) fn status(folder: &RunFolder, selection: &Selection) -> Result<Status, Failure> {
    status_of(folder, &plan::read(folder, selection)?)
}

/// Returns the state of these sweeps.
///
/// # Errors
/// [`Failure`] when the batch's folder cannot be read.
pub(super) fn status_of(folder: &RunFolder, sweeps: &[Planned]) -> Result<Status, Failure> {
    let mut status = Status { sweeps: sweeps.len(), ..Status::default() };
    for sweep in sweeps {
        if let Some(seconds) = done::time_s(folder, sweep) {
            status.done += 1;
            status.done_s += seconds;
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
        let seconds: f64 = attempts.iter().map(Attempt::time_s).sum();
        match state {
            SweepState::Running => {
                (status.running, status.running_s) = (status.running + 1, status.running_s + seconds)
            }
            SweepState::Failed => (status.failed, status.failed_s) = (status.failed + 1, status.failed_s + seconds),
            SweepState::Waiting => status.waiting += 1,
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

/// Returns the state as metrics, for the text file collector of Prometheus's node exporter. `batch`
/// is a label that distinguishes them from those of other batches.
pub(crate) fn metrics(status: &Status, batch: &str) -> String {
    let Status { done, failed, running, waiting, done_s, failed_s, running_s, .. } = *status;
    let mut text = String::new();
    let mut family = |name: &str, help: &str, label: &str, samples: &mut dyn Iterator<Item = (&str, f64)>| {
        // Writing to a string does not fail.
        let _ = writeln!(text, "# HELP {name} {help}\n# TYPE {name} gauge");
        for (value, number) in samples {
            let _ = writeln!(text, "{name}{{batch=\"{batch}\",{label}=\"{value}\"}} {number}");
        }
    };
    let counts = [("done", done), ("failed", failed), ("running", running), ("waiting", waiting)];
    let mut counts = counts.into_iter().map(|(state, count)| (state, count as f64));
    family("sonoweave_batch_sweeps", "Sweeps of a batch, by their state.", "state", &mut counts);
    let is_failed = |sweep: &&Unfinished| sweep.state == SweepState::Failed;
    let of = |kind| status.unfinished.iter().filter(is_failed).filter(|sweep| sweep.kind == kind).count() as f64;
    // An exit code of no kind is that of a signal.
    let kinds = FailureKind::ALL.into_iter().map(|kind| (kind.name(), of(Some(kind))));
    let mut reasons = kinds.chain([("signal", of(None))]);
    family("sonoweave_batch_failed_sweeps", "Sweeps that have failed, by the last reason.", "reason", &mut reasons);
    let mut seconds = [("done", done_s), ("failed", failed_s), ("running", running_s)].into_iter();
    family("sonoweave_batch_tries_seconds", "Time that tries took, by the state of the sweep.", "state", &mut seconds);
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metrics_count_failures_by_reason_and_running_ones_not() {
        let sweep = |state, kind| Unfinished {
            id: "doe-jane".into(),
            state,
            attempts: 1,
            exit: Some(1),
            kind,
            peak_bytes: None,
            sentence: Some("/data/doe-jane is damaged".into()),
        };
        let unfinished = vec![
            sweep(SweepState::Failed, Some(FailureKind::Memory)),
            sweep(SweepState::Failed, Some(FailureKind::Memory)),
            sweep(SweepState::Failed, None),
            sweep(SweepState::Running, Some(FailureKind::Memory)),
        ];
        let status = Status { done: 7, failed: 3, running: 1, running_s: 2.5, unfinished, ..Status::default() };
        let text = metrics(&status, "night");
        for line in [
            "sonoweave_batch_sweeps{batch=\"night\",state=\"done\"} 7\n",
            "sonoweave_batch_failed_sweeps{batch=\"night\",reason=\"memory\"} 2\n",
            "sonoweave_batch_failed_sweeps{batch=\"night\",reason=\"signal\"} 1\n",
            "sonoweave_batch_failed_sweeps{batch=\"night\",reason=\"input\"} 0\n",
            "sonoweave_batch_tries_seconds{batch=\"night\",state=\"running\"} 2.5\n",
        ] {
            assert!(text.contains(line), "{line} in\n{text}");
        }
        assert!(!text.contains("doe"), "no id and no folder:\n{text}");
    }
}
