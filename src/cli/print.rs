//! Output of the commands to stdout.

use std::io::{ErrorKind, Write as _};

use super::Failure;

/// Prints to stdout. A closed pipe (`| head`) is no error.
pub(in crate::cli) fn print(text: &str) -> Result<(), Failure> {
    match std::io::stdout().write_all(text.as_bytes()) {
        Err(e) if e.kind() == ErrorKind::BrokenPipe => Ok(()),
        Err(e) => Err(Failure(format!("writing to stdout failed: {e}"))),
        Ok(()) => Ok(()),
    }
}
