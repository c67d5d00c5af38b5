//! Correction by a gate: the frames at which breathing displaces the body are left out.

use std::path::Path;

use pipeline::session::RecordedDecisions;

use super::gating::left_out;
use super::note::{Correction, CorrectionResult, Kind};
use super::options::{Settings, Stored as _};
use super::standing::Standing;
use crate::failure::Failure;

/// Computes the correction.
///
/// # Errors
/// [`Failure`] when the session cannot be read, the body does not breathe regularly, or the gate
/// would leave holes.
pub(crate) fn compute(session: &Path, settings: &Settings) -> Result<Correction, Failure> {
    let decisions = RecordedDecisions::read(session)?;
    let (_, poses) = Standing::of(session, &decisions)?.before(Kind::Gate);
    let (left_out, evidence) = left_out(session, settings, &poses)?;
    Ok(Correction::new(Kind::Gate, &poses, settings.stored()?, evidence, CorrectionResult::LeftOut(left_out)))
}
