//! The origin of a reconstruction's frames, for checks and provenance.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use pipeline::Outcome;

use crate::app::input;
use crate::failure::Failure;

/// The origin of a reconstruction's frames.
#[derive(Debug, Clone)]
pub(crate) enum Origin {
    /// A recorded sequence.
    File(PathBuf),
    /// A recorded session, whose configuration has the calibration.
    Session(PathBuf),
    /// Frames of several recordings or of a program's memory, with a name for them.
    Frames(PathBuf),
}

impl Origin {
    /// Checks that an output is not the recording.
    ///
    /// # Errors
    /// [`Failure`] when it is.
    pub(super) fn check_is_not(&self, output: &Path) -> Result<(), Failure> {
        match self {
            Self::File(path) | Self::Session(path) => input::check_is_not(output, path),
            Self::Frames(_) => Ok(()),
        }
    }

    /// Returns the SHA-256 of the recording, or over number, time and pose of each slice.
    ///
    /// # Errors
    /// [`Failure`] when the recording cannot be read.
    pub(super) fn hash(&self, outcome: &Outcome) -> Result<String, Failure> {
        match self {
            Self::File(path) | Self::Session(path) => input::hash(path),
            Self::Frames(_) => {
                let mut text = String::with_capacity(64);
                for byte in outcome.slices_sha256 {
                    // Writing to a string does not fail.
                    let _ = write!(text, "{byte:02x}");
                }
                Ok(text)
            }
        }
    }

    /// Returns the SHA-256 of a recording's pixels, if they are in another file than its header.
    ///
    /// # Errors
    /// [`Failure`] when that file cannot be read.
    pub(super) fn data_hash(&self) -> Result<Option<String>, Failure> {
        match self {
            Self::File(path) => input::recording(path).0.get(1).map(|data| input::hash(data)).transpose(),
            Self::Session(_) | Self::Frames(_) => Ok(None),
        }
    }

    /// Returns the recording, or the name of the frames.
    pub(crate) fn path(&self) -> &Path {
        let (Self::File(path) | Self::Session(path) | Self::Frames(path)) = self;
        path
    }

    /// Returns its name without its folder.
    pub(super) fn name(&self) -> String {
        input::name_of(self.path())
    }
}
