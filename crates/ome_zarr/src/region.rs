//! Writes the shards of a region of a volume, beside the writers of other regions.

use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use formats::whole::sync_folder;

use crate::error::OmeZarrError;
use crate::folder;
use crate::log::{self, Content, Log, REGIONS};
use crate::meta::Meta;
use crate::metadata;
use crate::shards::{Prepared, ShardWriter};

/// File of the unfinished volume that is its users' own, and is deleted with the log.
pub(crate) const PLAN: &str = "plan.json";
/// Ending of the logs' names.
const END: &str = ".log";

/// Writes the shards of a region of a volume that [`OmeZarrWriter`](crate::OmeZarrWriter) has
/// begun, and will finish. Any number of processes may do so at once. If two write the same region,
/// their files have the same bytes.
pub struct RegionWriter {
    pub(crate) shards: ShardWriter,
}

impl RegionWriter {
    /// Joins the writers of an unfinished volume of this description.
    ///
    /// # Errors
    /// [`OmeZarrError`] when the volume was not begun, or by another description, when it is being
    /// finished, or a file cannot be read.
    pub fn join(path: &Path, meta: &Meta) -> Result<Self, OmeZarrError> {
        let prepared = Prepared::new(path, meta)?;
        let fingerprint = metadata::fingerprint(&metadata::files(meta));
        let not_begun = || OmeZarrError::NotBegun { path: prepared.part.clone() };
        if !prepared.part.join(log::NAME).is_file() {
            return Err(not_begun());
        }
        let mut log = Log::join(&prepared.part, &fingerprint)?.ok_or_else(not_begun)?;
        for (_, content) in logs(&prepared.part, &fingerprint)? {
            log.learn(content.shards);
        }
        log.keep_whole(&prepared.part);
        Ok(Self { shards: prepared.writer(log) })
    }

    /// Returns the writer of shards of level 0.
    pub fn shards(&self) -> &ShardWriter {
        &self.shards
    }

    /// Enters the shards that were written since the last call as those of a finished region, with
    /// a note of one line.
    ///
    /// # Errors
    /// [`OmeZarrError`] when the log cannot be written.
    pub fn finish(&mut self, name: &str, note: &str) -> Result<(), OmeZarrError> {
        let folder = self.shards.part.join(REGIONS);
        let text = self.shards.log().take_text(&note.replace('\n', " "));
        folder::write_file(&folder.join(format!("{name}{END}")), text.as_bytes())?;
        sync_folder(&folder).map_err(OmeZarrError::io(folder, "syncing"))
    }
}

/// Returns the path of the plan of an unfinished volume: a file of the program that divides the
/// volume into regions.
pub fn plan_path(path: &Path) -> PathBuf {
    let behind = if path.is_symlink() { fs::canonicalize(path).ok() } else { None };
    folder::unfinished(behind.as_deref().unwrap_or(path)).join(PLAN)
}

/// Enters the shards of all finished regions into the log of the whole.
pub(crate) fn enter_all(part: &Path, fingerprint: &str, log: &mut Log) -> Result<(), OmeZarrError> {
    logs(part, fingerprint)?.into_values().try_for_each(|content| log.enter_all(content.shards))
}

/// Returns the notes of finished regions, by name.
pub(crate) fn notes(part: &Path, fingerprint: &str) -> Result<BTreeMap<String, String>, OmeZarrError> {
    let logs = logs(part, fingerprint)?.into_iter();
    Ok(logs.filter_map(|(name, content)| Some((name, content.note?))).collect())
}

/// Reads the regions' logs of a description. One without a note is not whole.
fn logs(part: &Path, fingerprint: &str) -> Result<BTreeMap<String, Content>, OmeZarrError> {
    let folder = part.join(REGIONS);
    let entries = match fs::read_dir(&folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(BTreeMap::new()),
        entries => entries.map_err(OmeZarrError::io(&folder, "opening"))?,
    };
    let mut logs = BTreeMap::new();
    for entry in entries {
        let path = entry.map_err(OmeZarrError::io(&folder, "opening"))?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let Some(name) = name.strip_suffix(END) else { continue };
        let content = Content::of(&fs::read(&path).map_err(OmeZarrError::io(&path, "reading"))?);
        if content.fingerprint.as_deref() == Some(fingerprint) && content.note.is_some() {
            logs.insert(name.to_owned(), content);
        }
    }
    Ok(logs)
}
