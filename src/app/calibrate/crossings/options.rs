//! Flags for the recording of a check, and for the calibration.

use std::path::{Path, PathBuf};

use clap::Args;

/// The recording, and the calibration to check.
#[derive(Debug, Args)]
pub(crate) struct Options {
    /// Video frames with the probe's poses: a tracked sequence
    #[arg(long, value_name = "SEQUENCE")]
    pub(super) sequence: Option<PathBuf>,
    /// Video frames and poses: a recorded session (.mcap)
    #[arg(long, value_name = "SESSION")]
    pub(super) session: Option<PathBuf>,
    /// Calibration to check: our TOML or a PLUS XML [default: the session's]
    #[arg(short, long, value_name = "FILE")]
    pub(super) config: Option<PathBuf>,
}

impl Options {
    /// Returns those for a session and its own calibration.
    pub(crate) fn of_session(session: &Path) -> Self {
        Self { sequence: None, session: Some(session.to_owned()), config: None }
    }
}
