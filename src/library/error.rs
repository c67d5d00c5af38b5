//! Reasons for failures, by kind.

use std::error::Error;
use std::io;
use std::path::{Path, PathBuf};

use pipeline::PipelineError;
use reconstruct::SettingsError;
use sync::NoPath;

use crate::failure::{Failure, FailureKind, Reason};

/// Reason why something failed; each text is a sentence with the remedy.
#[derive(Debug, thiserror::Error)]
pub enum LibraryError {
    /// An argument, a setting or the content of a file does not fit.
    #[error("{0}")]
    Input(String),
    /// There is no route from the image to the world.
    #[error("{sentence}")]
    Calibration {
        /// The sentence.
        sentence: String,
        /// Names of the frames of reference between which no transforms lead: from, to.
        missing: [String; 2],
    },
    /// The memory limit is reached, or the system has no memory.
    #[error("{0}")]
    Memory(String),
    /// A file cannot be read or written.
    #[error("{sentence}")]
    File {
        /// The sentence.
        sentence: String,
        /// Number of the system's error.
        code: i32,
        /// The file.
        path: PathBuf,
    },
}

impl LibraryError {
    /// Converts an error that concerns a file.
    pub(super) fn at(path: &Path, error: impl Error + 'static) -> Self {
        let code = causes(&error).find_map(|cause| cause.downcast_ref::<io::Error>()?.raw_os_error());
        let Failure(Reason { sentence, .. }) = error.into();
        match code {
            Some(code) => Self::File { sentence, code, path: path.to_owned() },
            None => Self::Input(sentence),
        }
    }

    /// Converts the failure of a command about a file.
    pub(super) fn of_failure(path: &Path, Failure(Reason { sentence, kind }): Failure) -> Self {
        if kind == FailureKind::Memory {
            return Self::Memory(sentence);
        }
        // The system's errors end so in all sentences.
        let code = sentence.split("(os error ").nth(1).and_then(|rest| rest.split(')').next()?.parse().ok());
        match code {
            Some(code) => Self::File { sentence, code, path: path.to_owned() },
            None => Self::Input(sentence),
        }
    }

    /// Converts the error of a run on a recording of that name.
    pub(super) fn of_run(path: &Path, error: PipelineError) -> Self {
        if let PipelineError::NoPath(NoPath { image, world, .. }) = &error {
            return Self::Calibration { sentence: error.to_string(), missing: [image.clone(), world.clone()] };
        }
        match error {
            PipelineError::Memory { .. } | PipelineError::Settings(SettingsError::Memory(_)) => {
                Self::Memory(error.to_string())
            }
            PipelineError::NothingUsed(_) => Self::Input(error.to_string()),
            error => Self::at(path, error),
        }
    }
}

/// Returns an error and its causes.
fn causes<'a>(error: &'a (dyn Error + 'static)) -> impl Iterator<Item = &'a (dyn Error + 'static)> {
    std::iter::successors(Some(error), |error: &&(dyn Error + 'static)| (*error).source())
}

impl From<Failure> for LibraryError {
    fn from(failure: Failure) -> Self {
        Self::of_failure(Path::new(""), failure)
    }
}
