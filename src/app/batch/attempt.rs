//! Accounts of tries: a small file each, as appends of several hosts to one file would mix.

use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use super::folder::RunFolder;
use super::owner::{self, Owner};
use crate::app::json::document;
use crate::failure::{Failure, FailureKind};

/// State of a try.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum AttemptState {
    /// Began; nothing else is known if its run was killed.
    Started,
    /// Ended by itself or by a limit.
    Ended,
    /// Stopped together with its run.
    Interrupted,
}

/// Account of a try to reconstruct a sweep: `attempts/ID/N.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Attempt {
    pub(crate) id: String,
    /// Number of the try, from 1.
    pub(crate) number: u32,
    pub(crate) key: String,
    pub(crate) state: AttemptState,
    pub(crate) host: String,
    /// Process of the run, and the time of its start.
    pub(crate) process: u32,
    pub(crate) process_start: u64,
    /// Process of the reconstruction.
    pub(crate) child: Option<u32>,
    /// Begin, seconds since 1970.
    pub(crate) began_unix_s: f64,
    pub(crate) wall_s: f64,
    /// Exit code: that of a failure's kind, or 128 + the signal.
    pub(crate) exit: Option<i32>,
    pub(crate) signal: Option<i32>,
    pub(crate) peak_bytes: Option<u64>,
    /// The last sentence of the try.
    pub(crate) sentence: Option<String>,
}

impl Attempt {
    /// Whether the try ended with a failure.
    pub(crate) fn has_failed(&self) -> bool {
        self.state == AttemptState::Ended && self.exit != Some(0)
    }

    /// Whether another try with the same key may end differently.
    pub(crate) fn may_be_repeated(&self) -> bool {
        !matches!(
            self.exit.and_then(FailureKind::of_code),
            Some(FailureKind::Usage | FailureKind::Input | FailureKind::Configuration | FailureKind::NoFrame)
        )
    }

    /// Whether the try still runs; on another host, as far as its account says.
    pub(crate) fn is_running(&self) -> bool {
        let owner = Owner { host: self.host.clone(), process: self.process, start: self.process_start };
        self.state == AttemptState::Started && owner.is_alive().unwrap_or(true)
    }

    /// Returns the time that the try took, or has taken so far, s.
    pub(crate) fn time_s(&self) -> f64 {
        if self.is_running() { (now_unix_s() - self.began_unix_s).max(0.0) } else { self.wall_s }
    }

    /// Begins a try: its file has the next free number, whoever else begins one.
    ///
    /// # Errors
    /// [`Failure`] when the file cannot be written.
    pub(crate) fn begin(folder: &RunFolder, id: &str, key: &str) -> Result<Self, Failure> {
        let place = folder.attempts(id);
        let failed = |path: &Path, e: &io::Error| Failure::io(path, "writing", e);
        fs::create_dir_all(&place).map_err(|e| failed(&place, &e))?;
        let Owner { host, process, start } = Owner::this().clone();
        let mut attempt = Self {
            id: id.to_owned(),
            number: 1,
            key: key.to_owned(),
            state: AttemptState::Started,
            host,
            process,
            process_start: start,
            child: None,
            began_unix_s: now_unix_s(),
            wall_s: 0.0,
            exit: None,
            signal: None,
            peak_bytes: None,
            sentence: None,
        };
        loop {
            let path = attempt.path(folder);
            match File::options().write(true).create_new(true).open(&path) {
                Ok(mut file) => {
                    // A kill before the next line leaves an empty file: a try without result.
                    let written = file.write_all(document(&attempt)?.as_bytes());
                    return written.map(|()| attempt).map_err(|e| {
                        // A full disk; the first error counts.
                        let _ = fs::remove_file(&path);
                        failed(&path, &e)
                    });
                }
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => attempt.number += 1,
                Err(e) => return Err(failed(&path, &e)),
            }
        }
    }

    /// Writes the account.
    ///
    /// # Errors
    /// [`Failure`] when the file cannot be written.
    pub(crate) fn write(&self, folder: &RunFolder) -> Result<(), Failure> {
        let path = self.path(folder);
        owner::write(&path, document(self)?.as_bytes()).map_err(|e| Failure::io(&path, "writing", &e))
    }

    fn path(&self, folder: &RunFolder) -> PathBuf {
        folder.attempts(&self.id).join(format!("{}.json", self.number))
    }
}

/// Returns the present time, seconds since 1970.
fn now_unix_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}

/// Returns the tries of a sweep with a key, in order. Files that a kill has left incomplete are
/// left out.
///
/// # Errors
/// [`Failure`] when the folder cannot be read.
pub(crate) fn of(folder: &RunFolder, id: &str, key: &str) -> Result<Vec<Attempt>, Failure> {
    let place = folder.attempts(id);
    let entries = match fs::read_dir(&place) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(|e| Failure::io(&place, "reading", &e))?,
    };
    let paths =
        entries.flatten().map(|entry| entry.path()).filter(|path| path.extension().is_some_and(|e| e == "json"));
    let read = |path: PathBuf| serde_json::from_slice::<Attempt>(&fs::read(path).ok()?).ok();
    let mut attempts: Vec<Attempt> = paths.filter_map(read).filter(|attempt| attempt.key == key).collect();
    attempts.sort_by_key(|attempt| attempt.number);
    Ok(attempts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tries_are_numbered_and_read_by_their_key() {
        let place = tempfile::tempdir().unwrap();
        let folder = RunFolder::create(&place.path().join("run")).unwrap();
        assert!(of(&folder, "a", "k").unwrap().is_empty());
        let mut first = Attempt::begin(&folder, "a", "k").unwrap();
        let other = Attempt::begin(&folder, "a", "l").unwrap();
        assert_eq!((first.number, other.number), (1, 2));
        assert!(first.is_running() && !first.has_failed());
        (first.state, first.exit) = (AttemptState::Ended, Some(3));
        first.write(&folder).unwrap();
        fs::write(folder.attempts("a").join("3.json"), "").unwrap();
        let read = of(&folder, "a", "k").unwrap();
        assert_eq!(read, [first.clone()]);
        assert!(first.has_failed() && !first.may_be_repeated() && !first.is_running());
        let killed = Attempt { exit: Some(137), process_start: 1, state: AttemptState::Started, ..first };
        assert!(killed.may_be_repeated() && !killed.is_running());
        assert_eq!(Attempt::begin(&folder, "a", "k").unwrap().number, 4);
    }
}
