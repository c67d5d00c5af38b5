//! The commands to a session. The page, HTTP, OpenIGTLink, signals and the command line all
//! send them, and the running session receives the same ones.

use serde::{Deserialize, Serialize};
use serde_json::Value;

pub use mask::MaskChange;

/// A command to a session.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// Begins a new volume, and records all of its input.
    Record,
    /// Begins a new volume without recording.
    Scan,
    /// Ends the session; the result stays visible.
    Stop,
    /// Ignores frames from now on, or uses them again.
    Freeze(bool),
    /// Discards the volume.
    Clear,
    /// Changes the mask of later slices, or confirms the present one.
    Mask(MaskChange),
    /// Marks a moment in the recording.
    Mark(Marker),
    /// Writes the present volume.
    Save,
    /// Changes a setting of the running session.
    Set(Setting),
}

/// A marked moment: a phase of breathing or of the heart, by which frames may be gated later.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Marker {
    /// Host time, ns.
    pub at_ns: i64,
    /// Its source.
    pub by: MarkerSource,
}

/// Source of a marker.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MarkerSource {
    /// A key or a request.
    Operator,
    /// An edge on a serial line's input.
    Line,
}

/// A setting that may change while a session runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Setting {
    /// Latency of a device.
    Latency {
        /// The device, by its index among the session's.
        device: usize,
        /// Latency beyond what its driver knows, ns.
        ns: i64,
    },
    /// Time of equal frames at changing poses after which the scanner counts as stuck, ns.
    StuckAfter(i64),
    /// The view settings, which the view client holds: the next picture uses its present ones.
    View,
    /// Space to be left free on the disk, bytes.
    KeepFree(u64),
}

/// An instruction of the watcher to the session that it watches.
#[derive(Debug, Clone, PartialEq)]
pub enum Instruction {
    /// Execute this command.
    Command(Command),
    /// Record a note of this kind.
    Note(&'static str, Value),
    /// Report this sentence to the user.
    Report(String),
}

impl From<Command> for Instruction {
    fn from(command: Command) -> Self {
        Self::Command(command)
    }
}

impl From<Setting> for Instruction {
    fn from(setting: Setting) -> Self {
        Self::Command(Command::Set(setting))
    }
}
