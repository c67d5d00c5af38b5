//! Resumes a recorded session, for example after a crash, in the same volume.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use config::bedside::Bedside;
use drivers::replay::{Pace, SessionReplay, SessionSettings};
use pipeline::session::{Recorded, RecordedDecisions};

use super::stages::{Kept, roles};
use crate::failure::Failure;

/// Kind of the note that names the resumed session.
const RESUMES: &str = "resumes";
/// Largest number of sessions in a chain.
const MOST: usize = 64;

/// A session and the sessions that it resumes, the earliest first.
pub(crate) struct Chain(Vec<(PathBuf, RecordedDecisions)>);

impl Chain {
    /// Reads the recorded decisions of each session.
    ///
    /// # Errors
    /// [`Failure`] when one cannot be read, or has been moved.
    pub(crate) fn read(session: &Path) -> Result<Self, Failure> {
        let mut links = vec![(session.to_owned(), RecordedDecisions::read(session)?)];
        while let Some((path, decisions)) = links.first()
            && let Some(earlier) = earlier(decisions)
        {
            let beside = path.with_file_name(earlier.file_name().unwrap_or_default());
            let Some(found) = [&earlier, &beside].into_iter().find(|path| path.is_file()) else {
                fail!(
                    "{}: continues {}, which is missing; put that session into the same folder, because the volume \
                    needs its slices",
                    path.display(),
                    earlier.display()
                );
            };
            if links.len() >= MOST || links.iter().any(|(path, _)| path == found) {
                fail!("{}: its chain of sessions leads back to itself; give another session", session.display());
            }
            let link = (found.clone(), RecordedDecisions::read(found)?);
            links.insert(0, link);
        }
        Ok(Self(links))
    }

    /// Returns a session without those that it resumes.
    pub(crate) fn of(session: &Path, decisions: RecordedDecisions) -> Self {
        Self(vec![(session.to_owned(), decisions)])
    }

    /// Returns the sessions and their recorded decisions, the earliest first.
    pub(crate) fn links(&mut self) -> impl Iterator<Item = (&Path, &mut RecordedDecisions)> {
        self.0.iter_mut().map(|(path, decisions)| (&**path, decisions))
    }

    /// Returns the last session, and its recorded decisions.
    pub(crate) fn last(&mut self) -> (&Path, &mut RecordedDecisions) {
        let Some((path, decisions)) = self.0.last_mut() else { unreachable!("a chain has a session") };
        (path, decisions)
    }

    /// Prepares each session for a replay, with the devices of its own configuration or of
    /// another one.
    ///
    /// # Errors
    /// [`Failure`] when one cannot be read.
    pub(crate) fn recorded(self, other: Option<&Bedside>, pace: Pace) -> Result<Vec<Recorded>, Failure> {
        let last = self.0.len() - 1;
        let links = self.0.into_iter().enumerate().map(|(at, (path, decisions))| {
            let own = if other.is_some() { None } else { Some(Kept::at_first(&path, &decisions)?) };
            let Some(bedside) = other.or(own.as_ref()) else { unreachable!("one of them is there") };
            let pace = if at == last { pace } else { Pace::Unpaced };
            let replay = SessionReplay::open(&SessionSettings { pace, ..SessionSettings::new(path) })?;
            Ok(Recorded { replay, decisions, roles: roles(bedside)?.into() })
        });
        links.collect()
    }
}

/// Opens the sessions to resume. The configuration must reconstruct in the same way as theirs.
///
/// # Errors
/// [`Failure`] when one cannot be read, or was recorded with other settings.
pub(super) fn open(session: &Path, bedside: &Bedside) -> Result<Vec<Recorded>, Failure> {
    let mut chain = Chain::read(session)?;
    let (path, decisions) = chain.last();
    let changes = Kept::bedside(path, decisions)?.changes(bedside);
    let of_volume = |key: &str| ["volume.", "calibration.", "pairing."].iter().any(|section| key.starts_with(section));
    let changed = changes.next_session.iter().filter(|change| of_volume(&change.key));
    let changed: Vec<String> = changed.map(ToString::to_string).collect();
    if !changed.is_empty() {
        fail!(
            "--resume {}: was recorded with other settings ({}), which would misplace new slices; use the recorded \
            configuration, or begin a new session",
            session.display(),
            changed.join("; ")
        );
    }
    chain.recorded(None, Pace::Unpaced)
}

/// Returns the session that a session resumes.
fn earlier(decisions: &RecordedDecisions) -> Option<PathBuf> {
    let note: Value = serde_json::from_str(decisions.notes(RESUMES).first()?).ok()?;
    note.get("session")?.as_str().map(PathBuf::from)
}

/// Returns the note that names the resumed session.
///
/// # Errors
/// [`Failure`] when that session no longer exists.
pub(super) fn note(session: &Path) -> Result<(&'static str, Value), Failure> {
    Ok((RESUMES, json!({ "session": session.canonicalize()? })))
}
