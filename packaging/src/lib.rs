//! The licences of the crates that are linked into the program, for a package.
//!
//! The file is not committed, so it cannot be out of date: `scripts/deb.sh` runs the binary of this
//! crate for every package.

pub mod notices;
