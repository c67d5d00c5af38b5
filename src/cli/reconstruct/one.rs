//! Reconstructs one recording.

use std::path::Path;

use statistics::Statistics;

use super::beside::Beside;
use super::flags::Flags;
use super::outputs::Request;
use crate::cli::{Failure, input};

/// Reconstructs a recorded sweep into a volume and its other outputs. Returns the statistics.
pub(super) fn weave(sequence: &Path, output: &Path, flags: &Flags, beside: Beside) -> Result<Statistics, Failure> {
    let (request, job) = Request::new(sequence, Some(output), flags, beside)?;
    let bar = input::progress("weaving", 1);
    let result = pipeline::reconstruct(job, &(), |p| {
        bar.set_length(p.total);
        bar.set_position(p.done);
    });
    bar.finish_and_clear();
    request.finish(result?, None::<&()>)
}
