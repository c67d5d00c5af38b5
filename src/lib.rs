//! The `sonoweave` program: the command line, and the application below it. The stages themselves
//! are crates of their own, see `ARCHITECTURE.md`.
//!
//! - [`cli`]: the commands: flags, help, and everything printed.
//! - [`app`]: the work of the commands: sessions, replays, calibrations, reconstruction, rendering.
//! - [`library`]: the work of the commands for programs that call it, such as the Python module.
//! - [`Failure`]: the failure of a command, with its sentence and its kind.

#[macro_use]
mod failure;

pub mod app;
pub mod cli;
pub mod library;

pub use failure::{Failure, FailureKind, Reason};
