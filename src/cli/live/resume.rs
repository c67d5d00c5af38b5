//! Going on with a session that was recorded: after a crash, into the same volume.

use std::path::{Path, PathBuf};

use drivers::recording::Pace;
use drivers::recording::session::{SessionReplay, SessionSettings};
use serde_json::{Value, json};

use super::stages::{Kept, instruments};
use crate::cli::Failure;
use crate::config::bedside::Bedside;
use crate::pipeline::live::{Precedent, Recorded};

/// The kind of note that names the session that was gone on with.
const RESUMES: &str = "resumes";
/// So many sessions in a row are gone on with, at most.
const MOST: usize = 64;

/// A session and those that it goes on with, the earliest first.
pub(in crate::cli) struct Chain(Vec<(PathBuf, Precedent)>);

impl Chain {
    /// Reads what was decided in each.
    ///
    /// # Errors
    /// [`Failure`] when one cannot be read, or is not where it was.
    pub(in crate::cli) fn read(session: &Path) -> Result<Self, Failure> {
        let mut links = vec![(session.to_owned(), Precedent::read(session)?)];
        while let Some((path, precedent)) = links.first()
            && let Some(earlier) = earlier(precedent)
        {
            let beside = path.with_file_name(earlier.file_name().unwrap_or_default());
            let Some(found) = [&earlier, &beside].into_iter().find(|path| path.is_file()) else {
                return Err(Failure(format!(
                    "{}: goes on with {}, which is neither there nor beside it; without it its volume lacks what was woven before",
                    path.display(),
                    earlier.display()
                )));
            };
            if links.len() >= MOST || links.iter().any(|(path, _)| path == found) {
                return Err(Failure(format!("{}: goes on with itself in the end", session.display())));
            }
            let link = (found.clone(), Precedent::read(found)?);
            links.insert(0, link);
        }
        Ok(Self(links))
    }

    /// The session itself, and what was decided in it.
    pub(in crate::cli) fn last(&mut self) -> (&Path, &mut Precedent) {
        let Some((path, precedent)) = self.0.last_mut() else { unreachable!("a chain has a session") };
        (path, precedent)
    }

    /// Each as it is to be run again, by the devices of its own configuration or of another one.
    ///
    /// # Errors
    /// [`Failure`] when one cannot be read.
    pub(in crate::cli) fn recorded(self, other: Option<&Bedside>, pace: Pace) -> Result<Vec<Recorded>, Failure> {
        let last = self.0.len() - 1;
        let links = self.0.into_iter().enumerate().map(|(at, (path, precedent))| {
            let own = if other.is_some() { None } else { Some(Kept::at_first(&path, &precedent)?) };
            let Some(bedside) = other.or(own.as_ref()) else { unreachable!("one of them is there") };
            let pace = if at == last { pace } else { Pace::Unpaced };
            let replay = SessionReplay::open(&SessionSettings { pace, ..SessionSettings::new(path) })?;
            Ok(Recorded { replay, precedent, instruments: instruments(bedside)?.into() })
        });
        links.collect()
    }
}

/// Sessions to go on with, by a configuration that must weave as theirs do.
///
/// # Errors
/// [`Failure`] when one cannot be read, or was recorded by other settings.
pub(super) fn open(session: &Path, bedside: &Bedside) -> Result<Vec<Recorded>, Failure> {
    let mut chain = Chain::read(session)?;
    let (path, precedent) = chain.last();
    let changes = Kept::bedside(path, precedent)?.changes(bedside);
    let of_volume = |key: &str| ["volume.", "calibration.", "pairing."].iter().any(|section| key.starts_with(section));
    let changed = changes.next_session.iter().filter(|change| of_volume(&change.key));
    let changed: Vec<String> = changed.map(ToString::to_string).collect();
    if !changed.is_empty() {
        return Err(Failure(format!(
            "--resume {}: was recorded by other settings ({}), so that new slices would lie elsewhere; use the configuration that it was recorded by, or begin anew",
            session.display(),
            changed.join("; ")
        )));
    }
    chain.recorded(None, Pace::Unpaced)
}

/// The session that a session goes on with.
fn earlier(precedent: &Precedent) -> Option<PathBuf> {
    let note: Value = serde_json::from_str(precedent.notes(RESUMES).first()?).ok()?;
    note.get("session")?.as_str().map(PathBuf::from)
}

/// What a session says of the one that it goes on with.
///
/// # Errors
/// [`Failure`] where that is not there any more.
pub(super) fn note(session: &Path) -> Result<(&'static str, Value), Failure> {
    Ok((RESUMES, json!({ "session": session.canonicalize()? })))
}
