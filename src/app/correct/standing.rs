//! The corrections of a session that stand: which are applied, and which are stale.

use std::path::Path;

use serde_json::Value;

use calibration::pressure::Compression;
use config::bedside::SettingsOverride;
use pipeline::session::{CorrectedFrames, RecordedDecisions};

use super::file::CorrectionFile;
use super::note::{Correction, CorrectionResult, ERROR_RMS_MM, Kind};
use super::poses::{Poses, hash, transform};
use crate::failure::Failure;

/// The corrections of a session that stand, in the order in which they are applied.
#[derive(Debug)]
pub(crate) struct Standing {
    /// Each correction, the program that computed it, and whether it is applied: it is not stale.
    pub(super) all: Vec<(Correction, String, bool)>,
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
                CorrectionResult::Compressions(compressions) => {
                    let compression = |(frame, knots): &(u64, Vec<[f64; 2]>)| {
                        let known = Compression::new(knots.clone());
                        Ok((*frame, known.map_err(|why| Failure::new(format!("frame {frame}: {why}")))?))
                    };
                    frames.compressions = compressions.iter().map(compression).collect::<Result<_, Failure>>()?;
                }
                CorrectionResult::LeftOut(left_out) => frames.left_out.extend(left_out),
            }
        }
        Ok(Some(frames))
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
        CorrectionResult::Compressions(_) | CorrectionResult::LeftOut(_) => None,
    }
}
