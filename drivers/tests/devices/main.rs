//! Drivers on their virtual twins: on a line within the process, with a clock that waiting
//! advances, and on pseudo-terminals.

#![allow(clippy::unwrap_used, reason = "tests fail so")]

mod bench;
mod ea1;
mod fastrak;
mod isotrak;
mod joints;
mod liberty;
mod microscribe;
mod openigtlink;
mod qsb;
mod sessions;
mod stuck;
mod viper;
