//! The corrections of a session that stand: which are applied, and which are stale.

use std::path::Path;

use serde_json::Value;

use config::bedside::SettingsOverride;
use pipeline::session::{CorrectedFrames, RecordedDecisions};

use super::file::CorrectionFile;
use super::gating::left_out;
use super::note::{Correction, CorrectionResult, ERROR_RMS_MM, Kind};
use super::options::Settings;
use super::poses::{self, Poses, hash, transform};
use crate::app::provenance::program;
use crate::failure::Failure;

/// The corrections of a session that stand, in the order in which they are applied.
#[derive(Debug)]
pub(crate) struct Standing {
    /// Each correction, the program that computed it, and whether it is applied: it is not stale.
    all: Vec<(Correction, String, bool)>,
    /// The recorded poses.
    recorded: Poses,
}

impl Standing {
    /// Reads the corrections of a session.
    ///
    /// # Errors
    /// [`Failure`] when their file cannot be read.
    pub(crate) fn of(session: &Path, decisions: &RecordedDecisions) -> Result<Self, Failure> {
        let file = CorrectionFile::of(session)?;
        let stand = file.all().filter(|(_, _, stands)| *stands);
        let mut all: Vec<_> = stands_in_order(stand);
        let recorded = decisions.placed_poses();
        let mut inputs = hash(&recorded);
        for (correction, _, is_applied) in &mut all {
            *is_applied = correction.inputs == inputs;
            if *is_applied && let Some(poses) = poses_of(correction) {
                inputs = hash(&poses);
            }
        }
        Ok(Self { all, recorded })
    }

    /// Returns whether there are none.
    pub(crate) fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// Returns the corrections, and whether each is applied.
    pub(crate) fn each(&self) -> impl Iterator<Item = (&Correction, bool)> + Clone {
        self.all.iter().map(|(correction, _, is_applied)| (correction, *is_applied))
    }

    fn applied(&self) -> impl Iterator<Item = &Correction> + Clone {
        self.each().filter(|(_, is_applied)| *is_applied).map(|(correction, _)| correction)
    }

    /// Returns a sentence for each stale correction.
    pub(crate) fn stale(&self) -> impl Iterator<Item = String> {
        self.each().filter(|(_, is_applied)| !is_applied).map(|(Correction { id, kind, .. }, _)| {
            format!(
                "correction {id} ({kind}) is stale and not applied: it was computed from other poses than those before \
                 it now; compute it again: sonoweave correct undo SESSION {id}, then sonoweave correct {kind} SESSION"
            )
        })
    }

    /// Returns the settings and the poses that a correction of this kind begins with: those of the
    /// applied corrections before it.
    pub(super) fn before(&self, kind: Kind) -> (SettingsOverride, Poses) {
        let earlier = self.applied().filter(|found| found.kind < kind);
        let poses = earlier.clone().filter_map(poses_of).last().unwrap_or_else(|| self.recorded.clone());
        (earlier.flat_map(|found| found.settings.clone()).collect(), poses)
    }

    /// Returns the applied corrections as changes of the frames; `None` without any.
    ///
    /// # Errors
    /// [`Failure`] for a pose that is no transform.
    pub(crate) fn frames(&self) -> Result<Option<CorrectedFrames>, Failure> {
        if self.applied().next().is_none() {
            return Ok(None);
        }
        let words: Vec<String> = self.applied().map(|found| format!("{} {}", found.id, found.kind)).collect();
        let mut frames = CorrectedFrames { words: words.join(", "), ..CorrectedFrames::default() };
        for Correction { result, evidence, .. } in self.applied() {
            let error = evidence.get(ERROR_RMS_MM).and_then(Value::as_f64);
            frames.pose_error_mm = error.or(frames.pose_error_mm);
            match result {
                CorrectionResult::Poses(poses) => {
                    let pose = |(frame, rows): &(u64, [f64; 12])| Ok((*frame, transform(*frame, rows)?));
                    frames.poses = Some(poses.iter().map(pose).collect::<Result<_, Failure>>()?);
                }
                CorrectionResult::LeftOut(left_out) => frames.left_out.extend(left_out),
            }
        }
        Ok(Some(frames))
    }

    /// Computes the applied corrections of other programs again. Returns a sentence for each whose
    /// result this program would compute otherwise. The stored result is the one that is applied.
    ///
    /// # Errors
    /// [`Failure`] when the session cannot be read.
    pub(crate) fn differences(&self, session: &Path) -> Result<Vec<String>, Failure> {
        let own = program();
        let mut found = Vec::new();
        for (correction, by, _) in self.all.iter().filter(|(_, by, is_applied)| *is_applied && *by != own) {
            let Correction { id, kind, settings, result, .. } = correction;
            if let CorrectionResult::LeftOut(stored) = result {
                let now = left_out(session, &Settings::of(settings)?, &self.before(*kind).1)?;
                if now.0 != *stored {
                    found.push(format!(
                        "correction {id} ({kind}) is applied as stored, by version {by}: it leaves {} frames out, and \
                         this version would leave {} out. Undo it and compute it again to use that",
                        stored.len(),
                        now.0.len()
                    ));
                }
                continue;
            }
            let Some(stored) = poses_of(correction) else { continue };
            let (mut all, _) = self.before(*kind);
            all.extend(settings.clone());
            let now = poses::poses(session, &all)?;
            if hash(&now.poses) != hash(&stored) {
                let moved = now.moved(&stored)?;
                let most = moved.get("moved_most_mm").and_then(Value::as_f64).unwrap_or(f64::NAN);
                found.push(format!(
                    "correction {id} ({kind}) is applied as stored, by version {by}; this version would place the \
                     images up to {most:.3} mm elsewhere. Undo it and compute it again to use that"
                ));
            }
        }
        Ok(found)
    }
}

/// Returns copies of corrections in the order in which they are applied; none yet is.
fn stands_in_order<'a>(
    corrections: impl Iterator<Item = (&'a Correction, &'a str, bool)>,
) -> Vec<(Correction, String, bool)> {
    let mut all: Vec<_> = corrections.map(|(correction, by, _)| (correction.clone(), by.to_owned(), false)).collect();
    all.sort_by_key(|(correction, ..)| (correction.kind, correction.id));
    all
}

/// Returns the poses of a correction, if it changes them.
fn poses_of(correction: &Correction) -> Option<Poses> {
    match &correction.result {
        CorrectionResult::Poses(poses) => Some(poses.iter().copied().collect()),
        CorrectionResult::LeftOut(_) => None,
    }
}
