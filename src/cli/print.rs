//! Output of the commands to stdout.

use std::fmt::Arguments;
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

/// Prints a line to stdout, with the arguments of `println!`. A closed pipe is no error.
macro_rules! print_line {
    ($($text:tt)*) => { $crate::cli::print::line(format_args!($($text)*)) };
}

/// Implements `print_line!`.
pub(in crate::cli) fn line(text: Arguments<'_>) {
    match writeln!(std::io::stdout(), "{text}") {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => tracing::error!("writing to stdout failed: {error}"),
        _ => {}
    }
}
