//! Compares the results of a batch with the hashes of their accounts.

use rayon::prelude::*;
use serde::Serialize;

use super::done::{forget, verify as verify_sweep};
use super::folder::RunFolder;
use super::plan;
use super::select::Selection;
use crate::failure::Failure;

/// A damaged sweep.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct DamagedSweep {
    pub(crate) id: String,
    /// The first file that differs, and how.
    pub(crate) problem: String,
}

/// Result of the comparison.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub(crate) struct Verified {
    pub(crate) sweeps: usize,
    /// Sweeps whose files all have their hashes.
    pub(crate) whole: usize,
    pub(crate) files: usize,
    /// Sweeps that are not done.
    pub(crate) unfinished: usize,
    pub(crate) damaged: Vec<DamagedSweep>,
}

/// Compares the results of the selected sweeps.
///
/// # Errors
/// [`Failure`] when the plan cannot be read.
pub(crate) fn verify(folder: &RunFolder, selection: &Selection) -> Result<Verified, Failure> {
    let selected = plan::read(folder, selection)?;
    let results: Vec<_> = selected.par_iter().map(|sweep| verify_sweep(folder, sweep)).collect();
    let mut verified = Verified { sweeps: selected.len(), ..Verified::default() };
    for (sweep, result) in selected.iter().zip(results) {
        match result {
            Ok(Some(files)) => {
                verified.whole += 1;
                verified.files += files;
            }
            Ok(None) => verified.unfinished += 1,
            Err(problem) => verified.damaged.push(DamagedSweep { id: sweep.id.clone(), problem }),
        }
    }
    Ok(verified)
}

/// Removes damaged results, so that a run makes them again.
///
/// # Errors
/// [`Failure`] of the file system.
pub(crate) fn remove_damaged(folder: &RunFolder, verified: &Verified) -> Result<(), Failure> {
    if verified.damaged.is_empty() {
        return Ok(());
    }
    let only = verified.damaged.iter().map(|damaged| damaged.id.clone()).collect();
    let damaged = plan::read(folder, &Selection { only, part: None })?;
    // The results of another version stay: this program would not make the same ones.
    plan::check_program(folder, &damaged)?;
    damaged.iter().try_for_each(|sweep| forget(folder, sweep))
}
