//! Output of the commands to stdout.

use crate::failure::Reason;
use std::fmt::Arguments;
use std::io::{ErrorKind, Write as _};
use std::sync::atomic::{AtomicBool, Ordering};

use super::Failure;

/// Whether text is left out, because stdout gets a JSON document instead.
static LEFT_OUT: AtomicBool = AtomicBool::new(false);

/// Leaves out all text from now on: `--json` puts one document in its place.
pub(in crate::cli) fn leave_out() {
    LEFT_OUT.store(true, Ordering::Relaxed);
}

/// Prints to stdout. A closed pipe (`| head`) is no error.
pub(in crate::cli) fn print(text: &str) -> Result<(), Failure> {
    if LEFT_OUT.load(Ordering::Relaxed) {
        return Ok(());
    }
    match std::io::stdout().write_all(text.as_bytes()) {
        Err(e) if e.kind() == ErrorKind::BrokenPipe => Ok(()),
        Err(e) => Err(Failure::stdout(&e)),
        Ok(()) => Ok(()),
    }
}

/// Prints a line to stdout, with the arguments of `println!`. A closed pipe is no error.
macro_rules! print_line {
    ($($text:tt)*) => { $crate::cli::print::line(format_args!($($text)*)) };
}

/// Implements `print_line!`.
pub(in crate::cli) fn line(text: Arguments<'_>) {
    if let Err(Failure(Reason { sentence: why, .. })) = print(&format!("{text}\n")) {
        tracing::error!("{why}");
    }
}
