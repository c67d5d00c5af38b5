//! Corrections of other programs, computed again.

use std::path::Path;

use serde_json::Value;

use pipeline::session::RecordedDecisions;

use super::gating::left_out;
use super::note::{Correction, CorrectionResult, Kind};
use super::options::{PressureSettings, Settings, Stored as _};
use super::poses::{self, hash};
use super::slices::Before;
use super::standing::Standing;
use super::{drift, jitter, pressure};
use crate::app::provenance::program;
use crate::failure::Failure;

impl Standing {
    /// Computes the applied corrections of other programs again. Returns a sentence for each whose
    /// result this program would compute otherwise. The stored result is the one that is applied.
    ///
    /// # Errors
    /// [`Failure`] when the session cannot be read.
    pub(crate) fn differences(&self, session: &Path) -> Result<Vec<String>, Failure> {
        let own = program();
        let others: Vec<_> = self.all.iter().filter(|(_, by, is_applied)| *is_applied && *by != own).collect();
        if others.is_empty() {
            return Ok(Vec::new());
        }
        let decisions = RecordedDecisions::read(session)?;
        let mut found = Vec::new();
        for (correction, by, _) in others {
            let Correction { id, kind, .. } = correction;
            let now = match self.difference(session, &decisions, correction) {
                Ok(None) => continue,
                Ok(Some(now)) => now,
                Err(Failure(why)) => format!("would not compute it: {}", why.sentence),
            };
            found.push(format!(
                "correction {id} ({kind}) is applied as stored, by version {by}; this version {now}. Undo it and \
                 compute it again to use that"
            ));
        }
        Ok(found)
    }

    /// Computes a correction again. Returns in words how the result differs from the stored one, if
    /// it does.
    fn difference(
        &self,
        session: &Path,
        decisions: &RecordedDecisions,
        correction: &Correction,
    ) -> Result<Option<String>, Failure> {
        let Correction { kind, settings, result, .. } = correction;
        let (mut all, poses) = self.before(*kind);
        let stored = match result {
            CorrectionResult::LeftOut(stored) => {
                let now = left_out(session, &Settings::of(settings)?, &poses)?.0;
                let text = || format!("would leave {} frames out, not {}", now.len(), stored.len());
                return Ok((now != *stored).then(text));
            }
            CorrectionResult::Compressions(stored) => {
                let before = Before::with(session, decisions, all, poses)?;
                let now = pressure::compressions(session, &before, PressureSettings::of(settings)?)?.0;
                let text = || format!("would stretch the images of {} frames otherwise", now.len());
                return Ok((now != *stored).then(text));
            }
            CorrectionResult::Poses(stored) => stored.iter().copied().collect(),
        };
        let now = match kind {
            Kind::Drift => drift::poses(session, &Before::with(session, decisions, all, poses)?)?.0,
            Kind::Jitter => jitter::poses(session, &Before::with(session, decisions, all, poses)?)?.0,
            Kind::Smoothing | Kind::Calibration | Kind::Pressure | Kind::Gate => {
                all.extend(settings.clone());
                poses::poses(session, &all)?
            }
        };
        if hash(&now.poses) == hash(&stored) {
            return Ok(None);
        }
        let most = now.moved(&stored)?.get("moved_most_mm").and_then(Value::as_f64).unwrap_or(f64::NAN);
        Ok(Some(format!("would place the images up to {most:.3} mm elsewhere")))
    }
}
