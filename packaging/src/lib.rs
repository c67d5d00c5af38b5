//! The licences of the crates that are linked into the program, and the list of all crates, for a
//! package.
//!
//! The files are not committed, so they cannot be out of date: `scripts/deb.sh` runs the binary of
//! this crate for every package.

pub mod notices;
pub mod sbom;
