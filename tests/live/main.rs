//! Live sessions with disturbances: each continues, and its ledger is exact.
//!
//! Devices are scripted if counts are to be exact (`script`); otherwise they are simulated
//! devices that are unplugged, delayed and disturbed. No assertion depends on times that a slow
//! machine could miss.

#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "figures for who asks with --nocapture; a test that cannot be set up has failed"
)]

mod arm;
mod bricks;
mod commands;
mod disk;
mod order;
mod picture;
mod plugs;
mod process;
mod record_only;
mod replay;
mod scanner;
mod script;
mod sections;
mod set;
mod smoothing;
mod tracker;
mod zones;
