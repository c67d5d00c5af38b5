//! Batches: many sweeps by a manifest, each reconstructed exactly once by a process of its own.
//!
//! A sweep's content key is a hash of everything that its files follow from. The sweep is done if
//! and only if its `done.json`, which is written last, has that key and its files are there. Runs
//! therefore need no locks: two at once do the same work twice, and write the same bytes.

pub(crate) mod attempt;
pub(crate) mod card;
pub(crate) mod child;
pub(crate) mod done;
pub(crate) mod folder;
pub(crate) mod key;
pub(crate) mod manifest;
pub(crate) mod once;
pub(crate) mod owner;
pub(crate) mod plan;
pub(crate) mod publish;
pub(crate) mod run;
pub(crate) mod select;
pub(crate) mod status;
pub(crate) mod sweep;
pub(crate) mod verify;
