//! What clients may tell a session to do: begin, end, and save the volume.
//!
//! `start` begins a session that waits for it (`--igtl-wait`); `stop` ends it, so that it leaves what it was to leave; `save` writes the volume as it is into the folder that
//! was named for it, by a name of our own: a client names no files. Only clients of this machine are heard.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::desk::keep;
use crate::pipeline::live::Snapshot;

/// Something to be done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Deed {
    /// Begin.
    Start,
    /// End.
    Stop,
    /// Write the volume.
    Save,
}

impl Deed {
    /// By its name, in any case.
    pub fn named(name: &str) -> Option<Self> {
        [("start", Self::Start), ("stop", Self::Stop), ("save", Self::Save)]
            .into_iter()
            .find_map(|(known, deed)| name.trim().eq_ignore_ascii_case(known).then_some(deed))
    }

    /// That of a PLUS command's text: `<Command Name="start" />`.
    pub(super) fn of_xml(text: &str) -> Option<Self> {
        let parsed = roxmltree::Document::parse(text.trim_end_matches('\0')).ok()?;
        let root = parsed.root_element();
        Self::named(root.attribute("Name")?).filter(|_| root.has_tag_name("Command"))
    }
}

/// What commands act upon.
#[derive(Debug)]
pub struct Commands {
    ends: Arc<AtomicBool>,
    started: AtomicBool,
    folder: Option<PathBuf>,
}

impl Commands {
    /// Of a session that ends by that flag, and whose volumes are saved in that folder, if anywhere. `waits` for the command to start.
    pub fn new(ends: Arc<AtomicBool>, folder: Option<PathBuf>, waits: bool) -> Self {
        Self { ends, started: AtomicBool::new(!waits), folder }
    }

    /// Whether it may begin.
    pub fn may_start(&self) -> bool {
        self.started.load(Ordering::Relaxed)
    }

    /// Begins, or says why not.
    ///
    /// # Errors
    /// A sentence.
    pub(super) fn start(&self) -> Result<String, String> {
        match self.started.swap(true, Ordering::Relaxed) {
            false => Ok("the session begins".into()),
            true => Err("the session runs already; there is nothing to start".into()),
        }
    }

    /// Ends.
    pub(super) fn stop(&self) -> String {
        self.ends.store(true, Ordering::Relaxed);
        "the session ends".into()
    }

    /// The folder that volumes are saved in.
    ///
    /// # Errors
    /// A sentence where there is none.
    pub(super) fn folder(&self) -> Result<&Path, String> {
        self.folder
            .as_deref()
            .ok_or_else(|| "no folder was named to save in; start sonoweave with --igtl-save DIR".into())
    }

    /// Writes a volume into the folder; a file that is there already is left, and another name taken.
    ///
    /// # Errors
    /// A sentence: there is no file then.
    pub(super) fn write(&self, world: &str, snapshot: &Snapshot) -> Result<PathBuf, String> {
        let folder = self.folder()?;
        keep::volume(folder, "devices", world, snapshot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_known_by_name_and_as_plus_writes_them() {
        assert_eq!(Deed::named(" Stop "), Some(Deed::Stop));
        assert_eq!(Deed::named("reboot"), None);
        assert_eq!(Deed::of_xml("<Command Name=\"save\" Id=\"7\" />\0"), Some(Deed::Save));
        assert_eq!(Deed::of_xml("<Order Name=\"save\"/>"), None);
        assert_eq!(Deed::of_xml("<Command Name=\"save\""), None);
        // Entities that grow are not read at all.
        assert_eq!(Deed::of_xml("<!DOCTYPE a [<!ENTITY b \"save\">]><Command Name=\"&b;\"/>"), None);
    }

    #[test]
    fn a_session_is_started_once_and_stopped_by_its_flag() {
        let ends = Arc::new(AtomicBool::new(false));
        let commands = Commands::new(Arc::clone(&ends), None, true);
        assert!(!commands.may_start());
        assert!(commands.start().is_ok() && commands.may_start());
        assert!(commands.start().unwrap_err().contains("runs already"));
        commands.stop();
        assert!(ends.load(Ordering::Relaxed));
        assert!(commands.folder().unwrap_err().contains("--igtl-save"));
    }
}
