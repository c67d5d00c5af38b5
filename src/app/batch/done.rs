//! `done.json`: the account of a finished sweep, which is written last and makes it done.

use std::fs;
use std::path::{Component, Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::folder::RunFolder;
use super::key::Input;
use super::plan::Planned;
use crate::app::json::document;
use crate::app::{input, sha256};
use crate::failure::Failure;

/// Name of the account.
const NAME: &str = "done.json";

/// A file of a sweep's results.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Output {
    /// Path below the sweep's folder: KEY12/NAME.
    pub(crate) path: String,
    pub(crate) bytes: u64,
    pub(crate) sha256: String,
}

/// Account of a finished sweep.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Done {
    pub(crate) id: String,
    pub(crate) key: String,
    pub(crate) outputs: Vec<Output>,
    /// Parts of the key.
    pub(crate) inputs: Vec<Input>,
    pub(crate) settings: Vec<String>,
    pub(crate) program: String,
    /// Arguments of the program.
    pub(crate) command: Vec<String>,
    pub(crate) host: String,
    /// Number of the try.
    pub(crate) attempt: u32,
    pub(crate) wall_s: f64,
    pub(crate) peak_bytes: Option<u64>,
    /// Instruction set, frame ledger, counters of the work and the lattice, from the report.
    pub(crate) report: Value,
}

/// The parts of an account that say whether a sweep is done, and its time.
#[derive(Deserialize)]
struct Brief {
    key: String,
    outputs: Vec<Output>,
    wall_s: f64,
}

impl Done {
    /// Writes the account, which makes the sweep done.
    ///
    /// # Errors
    /// [`Failure`] of the file system.
    pub(crate) fn write(&self, folder: &RunFolder) -> Result<(), Failure> {
        folder.write(&folder.sweep(&self.id).join(NAME), document(self)?.as_bytes())
    }
}

/// Returns the account of a sweep; `None` if there is none with its key, or it cannot be read.
fn brief(folder: &RunFolder, sweep: &Planned) -> Option<Brief> {
    let text = fs::read(folder.sweep(&sweep.id).join(NAME)).ok()?;
    let brief: Brief = serde_json::from_slice(&text).ok()?;
    // A damaged account must not lead out of the folder.
    let is_inside = |output: &Output| Path::new(&output.path).components().all(|c| matches!(c, Component::Normal(_)));
    let has_files = !brief.outputs.is_empty() && brief.outputs.iter().all(is_inside);
    (brief.key == sweep.key && has_files).then_some(brief)
}

/// Returns the account of a sweep that is done; `None` for others.
pub(crate) fn read(folder: &RunFolder, sweep: &Planned) -> Option<Done> {
    if !is_done(folder, sweep) {
        return None;
    }
    serde_json::from_slice(&fs::read(folder.sweep(&sweep.id).join(NAME)).ok()?).ok()
}

/// Whether a sweep is done: its account has the key, and its files have their lengths.
pub(crate) fn is_done(folder: &RunFolder, sweep: &Planned) -> bool {
    time_s(folder, sweep).is_some()
}

/// Returns the time that a sweep took, s; `None` if it is not done.
pub(super) fn time_s(folder: &RunFolder, sweep: &Planned) -> Option<f64> {
    let place = folder.sweep(&sweep.id);
    let has_length =
        |output: &Output| place.join(&output.path).metadata().is_ok_and(|there| there.len() == output.bytes);
    brief(folder, sweep).filter(|brief| brief.outputs.iter().all(has_length)).map(|brief| brief.wall_s)
}

/// Compares a sweep's files with the hashes of its account; returns the problem of the first that
/// differs. `Ok(None)` if the sweep has no account.
///
/// # Errors
/// A sentence on the damage.
pub(crate) fn verify(folder: &RunFolder, sweep: &Planned) -> Result<Option<usize>, String> {
    let place = folder.sweep(&sweep.id);
    let Some(Brief { outputs, .. }) = brief(folder, sweep) else {
        let account = place.join(NAME);
        let is_other = fs::read(&account).is_ok_and(|text| serde_json::from_slice::<Brief>(&text).is_ok());
        return match account.exists() && !is_other {
            true => Err(format!("{}: cannot be read", account.display())),
            false => Ok(None),
        };
    };
    for output in &outputs {
        let path = place.join(&output.path);
        match path.metadata().map(|there| there.len()) {
            Err(e) => return Err(format!("{}: {e}", path.display())),
            Ok(bytes) if bytes != output.bytes => {
                return Err(format!("{}: has {bytes} bytes instead of {}", path.display(), output.bytes));
            }
            Ok(_) if input::hash(&path).map_err(|failure| failure.0.sentence)? != output.sha256 => {
                return Err(format!("{}: has another content than was written", path.display()));
            }
            Ok(_) => {}
        }
    }
    Ok(Some(outputs.len()))
}

/// Removes the account of a sweep and the files that it names, so that a run makes them again.
///
/// # Errors
/// [`Failure`] of the file system.
pub(crate) fn forget(folder: &RunFolder, sweep: &Planned) -> Result<(), Failure> {
    let place = folder.sweep(&sweep.id);
    // The account first: without it, the files count for nothing.
    for path in [place.join(NAME), place.join(sha256::short(&sweep.key))] {
        super::owner::remove(&path).map_err(|e| Failure::io(&path, "removing", &e))?;
    }
    Ok(())
}

/// Returns the files in a folder with their hashes, sorted by name; `below` begins their paths.
///
/// # Errors
/// [`Failure`] when they cannot be read.
pub(crate) fn files(folder: &Path, below: &str) -> Result<Vec<Output>, Failure> {
    let failed = |path: &Path, e: std::io::Error| Failure::io(path, "reading", &e);
    let mut found = Vec::new();
    let mut folders: Vec<(PathBuf, String)> = vec![(folder.to_owned(), below.to_owned())];
    while let Some((inner, name)) = folders.pop() {
        for entry in fs::read_dir(&inner).map_err(|e| failed(&inner, e))? {
            let entry = entry.map_err(|e| failed(&inner, e))?;
            let (path, name) = (entry.path(), format!("{name}/{}", entry.file_name().to_string_lossy()));
            let about = entry.metadata().map_err(|e| failed(&path, e))?;
            if about.is_dir() {
                folders.push((path, name));
            } else {
                found.push(Output { bytes: about.len(), sha256: input::hash(&path)?, path: name });
            }
        }
    }
    found.sort_by(|one, other| one.path.cmp(&other.path));
    Ok(found)
}
