//! An ended session whose volume is still viewed: nothing is inserted, but pictures are rendered
//! and readers read.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use sonoweave_core::clock::Monotonic;

use crate::command::{Command, Instruction, Setting};

use super::digest::ResultDigest;
use super::priority::{Role, SchedulingPolicy};
use super::recorded_decisions::RecordedDecisions;
use super::recorder::Recording;
use super::render_thread::{self, Drawn, SharedViewClient};
use super::settings::{Finished, Session};
use super::shared_volume::Shared;
use super::spawn::{EndOnPanic, spawn};
use super::status::SessionStatus;
use super::{brick_viewer, plane_viewer, reader};
use crate::Outcome;

/// Interval at which the end is checked.
const TURN: Duration = Duration::from_millis(20);

/// The result of an ended session that can still be viewed.
pub struct EndedSession<'a> {
    pub(super) session: &'a Session,
    pub(super) volume: Shared,
    pub(super) view: Option<SharedViewClient>,
    pub(super) drawn: Option<Drawn>,
    pub(super) status: SessionStatus,
    pub(super) recording: Option<Recording>,
    pub(super) digest: Option<ResultDigest>,
    pub(super) decisions: Option<RecordedDecisions>,
    /// Insertion times of a sequence's slices, ms.
    pub(super) insert_ms: Vec<f64>,
}

impl EndedSession<'_> {
    /// Returns its final status.
    pub fn status(&self) -> &SessionStatus {
        &self.status
    }

    /// Returns whether there is a volume to view.
    pub fn has_volume(&self) -> bool {
        self.volume.lock().pending.slices() > 0
    }

    /// Returns the recording, if the session was recorded.
    pub fn recording(&self) -> Option<&Recording> {
        self.recording.as_ref()
    }

    /// Shows the volume until `ends` is set. `watch` is called repeatedly; of the instructions
    /// that it returns, only a stop and changed view settings still have an effect.
    pub fn serve(&self, ends: &AtomicBool, mut watch: impl FnMut(&SessionStatus) -> Vec<Instruction>) {
        let (shared, clock) = (&self.volume, &Monotonic);
        shared.resume();
        std::thread::scope(|scope| {
            let _end = EndOnPanic(|| shared.end());
            let policy = SchedulingPolicy::default();
            if let Some(view) = &self.view {
                spawn(scope, "picture", (&policy, Role::Usual), move || {
                    if let Err(error) = render_thread::run(shared, view, false, clock, |_| {}) {
                        tracing::warn!("no picture of the volume: {error}");
                    }
                });
            }
            if let Some(plane_viewer) = &self.session.plane_viewer {
                spawn(scope, "sections", (&policy, Role::Usual), move || {
                    plane_viewer::run(shared, &**plane_viewer, None)
                });
            }
            if let Some(brick_viewer) = &self.session.brick_viewer {
                spawn(scope, "bricks", (&policy, Role::Usual), move || brick_viewer::run(shared, &**brick_viewer));
            }
            for reader in &self.session.readers {
                spawn(scope, "reader", (&policy, Role::Usual), move || reader::run(shared, &**reader));
            }
            while !ends.load(Ordering::Relaxed) {
                std::thread::sleep(TURN);
                for instruction in watch(&self.status) {
                    match instruction {
                        Instruction::Command(Command::Stop) => ends.store(true, Ordering::Relaxed),
                        Instruction::Command(Command::Set(Setting::View)) => {
                            self.view.iter().for_each(SharedViewClient::changed);
                        }
                        _ => {}
                    }
                }
            }
            shared.end();
        });
    }

    /// Returns the decisions that a replay was compared with.
    pub fn decisions(&self) -> Option<&RecordedDecisions> {
        self.decisions.as_ref()
    }

    /// Returns the session's results.
    pub fn finish(self) -> Finished {
        let Self { volume, drawn, mut status, recording, digest, decisions, insert_ms, .. } = self;
        status.stuck_s = None;
        let corrections = decisions.as_ref().and_then(RecordedDecisions::corrections);
        let corrected_mm = corrections.and_then(|corrections| corrections.pose_error_mm);
        let outcome = volume.into_inner().inserter.finish().map(|finished| Outcome {
            world: status.world.clone(),
            route: status.route.clone(),
            smoothing: status.smoothing.clone(),
            corrections: corrections.map(|corrections| corrections.words.clone()),
            pose_error_mm: corrected_mm.or(status.pose_error_mm()),
            voxels_updated: finished.reconstructor.work().voxels_updated,
            reconstructor: finished.reconstructor,
            chosen: finished.chosen,
            ledger: status.ledger.clone(),
            mask: finished.mask,
            reached: finished.reached,
            slice_axes: finished.slice_axes,
            slices_sha256: finished.slices_sha256,
            insert_ms,
            pixels: finished.pixels,
            notes: status.notes.iter().cloned().chain(finished.notes).collect(),
        });
        Finished { outcome, drawn, status, recording, digest, decisions }
    }
}
