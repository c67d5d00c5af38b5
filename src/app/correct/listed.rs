//! The corrections of a session as a list, and their changes on request of a page.

use std::path::Path;

use serde::Serialize;

use pipeline::control::{CorrectionRequest, ListedCorrection};
use pipeline::session::RecordedDecisions;

use super::file::CorrectionFile;
use super::note::{Correction, Kind};
use super::options::Settings;
use super::standing::Standing;
use super::{calibration, drift, gate, jitter, pressure, smoothing};
use crate::failure::Failure;

/// Time before and after a frame over which a page's smoothing averages, ms.
const HALF_WIDTH_MS: f64 = 300.0;
/// Share of the frames that a page's gate uses.
const SHARE: f64 = 0.35;

/// A correction in a list.
pub(crate) struct Listed {
    pub(crate) correction: Correction,
    /// Program that computed it.
    pub(crate) program: String,
    pub(crate) state: State,
}

/// A correction in a replay.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum State {
    Applied,
    Stale,
    Undone,
}

impl State {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Applied => "applied",
            Self::Stale => "stale",
            Self::Undone => "undone",
        }
    }
}

/// Lists all corrections of a session, by their numbers.
///
/// # Errors
/// [`Failure`] when the session or its corrections cannot be read.
pub(crate) fn list(session: &Path) -> Result<Vec<Listed>, Failure> {
    let standing = Standing::of(session, &RecordedDecisions::read(session)?)?;
    let state = |id: u64| match standing.each().find(|(correction, _)| correction.id == id) {
        Some((_, true)) => State::Applied,
        Some((_, false)) => State::Stale,
        None => State::Undone,
    };
    let file = CorrectionFile::of(session)?;
    let listed = |(correction, program, _): (&Correction, &str, bool)| {
        let state = state(correction.id);
        Listed { correction: correction.clone(), program: program.to_owned(), state }
    };
    Ok(file.all().map(listed).collect())
}

/// Lists the corrections that stand, for a page.
///
/// # Errors
/// As of [`list`].
pub(crate) fn standing(session: &Path) -> Result<Vec<ListedCorrection>, Failure> {
    let standing = list(session)?.into_iter().filter(|listed| listed.state != State::Undone);
    let listed = |Listed { correction, state, .. }: Listed| ListedCorrection {
        id: correction.id,
        kind: correction.kind.name(),
        is_stale: state == State::Stale,
        words: correction.words(),
    };
    Ok(standing.map(listed).collect())
}

/// Changes the corrections of a session, by the usual settings. Returns a sentence.
///
/// # Errors
/// [`Failure`] when the session does not determine the correction; nothing is stored then.
pub(crate) fn change(session: &Path, request: CorrectionRequest) -> Result<String, Failure> {
    let mut file = CorrectionFile::of(session)?;
    let (kind, compute): (Kind, Box<dyn Fn() -> Result<Correction, Failure>>) = match request {
        CorrectionRequest::Smoothing => (Kind::Smoothing, Box::new(|| smoothing::compute(session, HALF_WIDTH_MS))),
        CorrectionRequest::Calibration => (Kind::Calibration, Box::new(|| calibration::compute(session))),
        CorrectionRequest::Drift => (Kind::Drift, Box::new(|| drift::compute(session))),
        CorrectionRequest::Jitter => (Kind::Jitter, Box::new(|| jitter::compute(session))),
        CorrectionRequest::Pressure { light } => (Kind::Pressure, Box::new(move || pressure::compute(session, light))),
        CorrectionRequest::Gate => {
            let settings = Settings { share: SHARE, signal: None, phase: 0.0 };
            (Kind::Gate, Box::new(move || gate::compute(session, &settings)))
        }
        CorrectionRequest::Undo(id) => {
            file.undo(id)?;
            return Ok(format!("correction {id} is undone"));
        }
    };
    file.check(kind)?;
    let correction = compute()?;
    let words = correction.words();
    let id = file.accept(correction)?;
    Ok(format!("correction {id} ({kind}) is stored: {words}"))
}
