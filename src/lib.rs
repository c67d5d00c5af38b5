//! The `sonoweave` program: the command line, and the application below it. The stages themselves
//! are crates of their own, see `ARCHITECTURE.md`.
//!
//! - [`cli`]: the commands: flags, help, and everything printed.
//! - [`app`]: the work of the commands: sessions, replays, calibrations, reconstruction, rendering.
//! - [`Failure`]: the failure of a command, with its sentence and its kind.

#[macro_use]
mod failure;

pub mod app;
pub mod cli;

pub use failure::{Failure, FailureKind, Reason};
