//! Reconstructs one recording.

use std::path::Path;

use statistics::Statistics;

use super::beside::Beside;
use super::flags::Flags;
use super::outputs::Request;
use crate::cli::Failure;

/// Reconstructs a recorded sweep into a volume and its other outputs. Returns the statistics.
pub(super) fn reconstruct(
    sequence: &Path,
    output: &Path,
    flags: &Flags,
    beside: Beside,
) -> Result<Statistics, Failure> {
    let (request, sweep) = Request::new(sequence, Some(output), flags, beside)?;
    request.finish(sweep.reconstruct("reconstructing")?, None::<&()>)
}
