//! Commands of clients to a session: start, stop, save the volume, freeze, unfreeze, clear, mark.
//!
//! `start` ([`Command::Scan`]) begins a session that waits for it (`--igtl-wait`); its settings
//! say whether it is recorded. `stop` ends it, so that it writes its results. `save` writes the
//! present volume into the configured folder, under a generated name: clients cannot name
//! files. Only commands from this machine are accepted.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use pipeline::command::{Command, Marker, MarkerSource};
use pipeline::control::{SessionController, keep};
use pipeline::session::Snapshot;
use sonoweave_core::clock::{Clock as _, Monotonic};

use super::error::IgtlError;

/// The commands that clients can send, by their names, beside [`MARK`].
const NAMES: [(&str, Command); 6] = [
    ("start", Command::Scan),
    ("stop", Command::Stop),
    ("save", Command::Save),
    ("freeze", Command::Freeze(true)),
    ("unfreeze", Command::Freeze(false)),
    ("clear", Command::Clear),
];

/// Name of the command that marks the moment of its arrival.
const MARK: &str = "mark";

/// Returns the command with this name, in any case.
pub(super) fn named(name: &str) -> Option<Command> {
    if name.trim().eq_ignore_ascii_case(MARK) {
        return Some(Command::Mark(Marker { at_ns: Monotonic.now_ns(), by: MarkerSource::Operator }));
    }
    let mut known = NAMES.into_iter();
    known.find_map(|(known, command)| name.trim().eq_ignore_ascii_case(known).then_some(command))
}

/// Returns the command of a PLUS text: `<Command Name="start" />`.
pub(super) fn of_xml(text: &str) -> Option<Command> {
    let parsed = roxmltree::Document::parse(text.trim_end_matches('\0')).ok()?;
    let root = parsed.root_element();
    named(root.attribute("Name")?).filter(|_| root.has_tag_name("Command"))
}

/// The state that commands act upon.
#[derive(Debug)]
pub struct Commands {
    ends: Arc<AtomicBool>,
    started: AtomicBool,
    folder: Option<PathBuf>,
    /// The controller of a live session.
    controller: OnceLock<Arc<SessionController>>,
}

impl Commands {
    /// Controls a session that ends by the flag `ends` and saves volumes in `folder`, if any.
    /// `waits`: the session begins only with the start command.
    pub fn new(ends: Arc<AtomicBool>, folder: Option<PathBuf>, waits: bool) -> Self {
        Self { ends, started: AtomicBool::new(!waits), folder, controller: OnceLock::new() }
    }

    /// Passes the other commands to the controller of a live session.
    pub fn control(&self, controller: Arc<SessionController>) {
        // The first controller stays.
        let _ = self.controller.set(controller);
    }

    /// Whether the session may begin.
    pub fn may_start(&self) -> bool {
        self.started.load(Ordering::Relaxed)
    }

    /// Begins the session.
    ///
    /// # Errors
    /// [`IgtlError::Running`] if it runs already.
    pub(super) fn start(&self) -> Result<String, IgtlError> {
        match self.started.swap(true, Ordering::Relaxed) {
            false => Ok("the session begins".into()),
            true => Err(IgtlError::Running),
        }
    }

    /// Ends the session.
    pub(super) fn stop(&self) -> String {
        self.ends.store(true, Ordering::Relaxed);
        "the session ends".into()
    }

    /// Passes a command to the session.
    ///
    /// # Errors
    /// [`IgtlError::NotLive`] in a replay, [`IgtlError::Refused`] if the session cannot follow now.
    pub(super) fn execute(&self, command: Command) -> Result<String, IgtlError> {
        let controller = self.controller.get().ok_or(IgtlError::NotLive)?;
        controller.execute(command).map_err(|why| IgtlError::Refused(why.to_string()))
    }

    /// Returns the folder that volumes are saved in.
    ///
    /// # Errors
    /// [`IgtlError::NoFolder`] if there is none.
    pub(super) fn folder(&self) -> Result<&Path, IgtlError> {
        self.folder.as_deref().ok_or(IgtlError::NoFolder)
    }

    /// Writes a volume into the folder, under a free name; existing files are kept.
    ///
    /// # Errors
    /// [`IgtlError`]; no file is left then.
    pub(super) fn write(&self, world: &str, snapshot: &Snapshot) -> Result<PathBuf, IgtlError> {
        keep::volume(self.folder()?, "devices", world, snapshot).map_err(|error| IgtlError::Volume(error.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_parse_from_names_and_plus_xml() {
        assert_eq!(named(" Stop "), Some(Command::Stop));
        assert_eq!(named("unfreeze"), Some(Command::Freeze(false)));
        assert_eq!(named("reboot"), None);
        let before = Monotonic.now_ns();
        let Some(Command::Mark(Marker { at_ns, by: MarkerSource::Operator })) = named("MARK") else {
            panic!("no mark")
        };
        assert!(before <= at_ns && at_ns <= Monotonic.now_ns());
        assert_eq!(of_xml("<Command Name=\"save\" Id=\"7\" />\0"), Some(Command::Save));
        assert_eq!(of_xml("<Order Name=\"save\"/>"), None);
        assert_eq!(of_xml("<Command Name=\"save\""), None);
        // Documents with entities, which could expand, are not read at all.
        assert_eq!(of_xml("<!DOCTYPE a [<!ENTITY b \"save\">]><Command Name=\"&b;\"/>"), None);
    }

    #[test]
    fn session_starts_once_and_stops_by_flag() {
        let ends = Arc::new(AtomicBool::new(false));
        let commands = Commands::new(Arc::clone(&ends), None, true);
        assert!(!commands.may_start());
        assert!(commands.start().is_ok() && commands.may_start());
        assert!(matches!(commands.start(), Err(IgtlError::Running)));
        commands.stop();
        assert!(ends.load(Ordering::Relaxed));
        assert!(matches!(commands.folder(), Err(IgtlError::NoFolder)));
    }

    #[test]
    fn freeze_and_clear_pass_to_a_live_session() {
        let commands = Commands::new(Arc::default(), None, false);
        assert!(matches!(commands.execute(Command::Clear), Err(IgtlError::NotLive)));
        let controller = Arc::new(SessionController::new(None));
        commands.control(Arc::clone(&controller));
        assert!(matches!(commands.execute(Command::Clear), Err(IgtlError::Refused(_))), "it has not begun");
        controller.runs(false, "devices".into());
        for command in [Command::Freeze(true), Command::Clear, Command::Freeze(false)] {
            assert!(commands.execute(command).is_ok());
        }
        assert_eq!(controller.commands(), [Command::Freeze(true), Command::Clear, Command::Freeze(false)]);
    }
}
