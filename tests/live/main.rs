//! Live sessions in which something goes wrong: each goes on, and its account is right to the last count.
//!
//! Devices are scripted where counts are to be exact (`script`), else virtual twins that are unplugged, delayed and disturbed. Nothing is asserted of times that a slow machine
//! could miss.

#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "figures for who asks with --nocapture; a test that cannot be set up has failed"
)]

mod arm;
mod disk;
mod gather;
mod order;
mod picture;
mod plugs;
mod process;
mod replay;
mod scanner;
mod script;
mod sections;
mod set;
mod tracker;
mod wishes;
mod zones;
