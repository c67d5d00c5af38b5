//! The failure of a command, as a sentence for the user.

use config::Unfit;

/// Reason why a command failed: a sentence for stderr, exit code 1.
#[derive(Debug)]
pub struct Failure(pub String);

impl<E: std::error::Error> From<E> for Failure {
    fn from(error: E) -> Self {
        Self(error.to_string())
    }
}

impl Failure {
    /// Converts a problem of settings whose flags have the settings' names.
    pub(super) fn flag(Unfit { setting, problem }: Unfit) -> Self {
        match setting {
            "" => Self(problem),
            _ => Self(format!("--{}: {problem}", setting.replace(", ", ", --").replace('_', "-"))),
        }
    }
}
