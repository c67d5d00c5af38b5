//! The `sonoweave` program: the command line, and the parts of it that open devices and convert
//! files. The stages themselves are crates of their own, see `ARCHITECTURE.md`.
//!
//! - [`cli`]: the commands.
//! - [`devices`]: a session's devices, opened; virtual devices for those that are not there.
//! - [`convert`]: recordings and volumes from one file to another.
//! - [`service`]: a session's notifications to systemd.

pub mod cli;
pub mod convert;
pub mod devices;
pub mod service;
