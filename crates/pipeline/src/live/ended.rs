//! An ended session whose volume is still viewed: nothing is inserted, but pictures are rendered
//! and readers read.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use sonoweave_core::clock::Monotonic;

use crate::command::{Command, Instruction, Setting};

use super::digest::ResultDigest;
use super::picture::{self, Drawn, SharedViewClient};
use super::priority::{Role, SchedulingPolicy};
use super::recorded_decisions::RecordedDecisions;
use super::recorder::Recording;
use super::session::{Finished, Session};
use super::shared_volume::Shared;
use super::status::SessionStatus;
use super::threads::spawn;
use super::{plane_viewer, reader};
use crate::Outcome;

/// Interval at which the end is checked.
const TURN: Duration = Duration::from_millis(20);

/// The result of an ended session that can still be viewed.
pub struct EndedSession<'a> {
    pub(super) session: &'a Session,
    pub(super) volume: Shared,
    pub(super) view: Option<SharedViewClient>,
    pub(super) drawn: Option<Drawn>,
    pub(super) account: SessionStatus,
    pub(super) recording: Option<Recording>,
    pub(super) seal: Option<ResultDigest>,
    pub(super) decisions: Option<RecordedDecisions>,
}

impl EndedSession<'_> {
    /// Returns its final status.
    pub fn account(&self) -> &SessionStatus {
        &self.account
    }

    /// Returns whether there is a volume to view.
    pub fn is_woven(&self) -> bool {
        self.volume.lock().news.slices() > 0
    }

    /// Returns the recording, if the session was recorded.
    pub fn recording(&self) -> Option<&Recording> {
        self.recording.as_ref()
    }

    /// Shows the volume until `ends` is set. `watch` is called repeatedly; of the instructions
    /// that it returns, only changed view settings still have an effect.
    pub fn linger(&self, ends: &AtomicBool, mut watch: impl FnMut(&SessionStatus) -> Vec<Instruction>) {
        let (shared, clock) = (&self.volume, &Monotonic);
        shared.goes_on();
        std::thread::scope(|scope| {
            let policy = SchedulingPolicy::default();
            if let Some(view) = &self.view {
                spawn(scope, "picture", (&policy, Role::Usual), move || {
                    if let Err(error) = picture::run(shared, view, false, clock, |_| {}) {
                        tracing::warn!("no picture of the volume: {error}");
                    }
                });
            }
            if let Some(plane_viewer) = &self.session.plane_viewer {
                spawn(scope, "sections", (&policy, Role::Usual), move || plane_viewer::run(shared, &**plane_viewer));
            }
            for reader in &self.session.readers {
                spawn(scope, "reader", (&policy, Role::Usual), move || reader::run(shared, &**reader));
            }
            while !ends.load(Ordering::Relaxed) {
                std::thread::sleep(TURN);
                let instructions = watch(&self.account);
                if let Some(view) = &self.view
                    && instructions.contains(&Instruction::Command(Command::Set(Setting::View)))
                {
                    view.changed();
                }
            }
            shared.is_over();
        });
    }

    /// Returns the decisions that a replay was compared with.
    pub fn decisions(&self) -> Option<&RecordedDecisions> {
        self.decisions.as_ref()
    }

    /// Returns the session's results.
    pub fn finish(self) -> Finished {
        let Self { volume, drawn, mut account, recording, seal, decisions, .. } = self;
        account.stuck_s = None;
        let outcome = volume.into_inner().loom.finish().map(|cloth| Outcome {
            world: account.world.clone(),
            route: account.route.clone(),
            voxels_updated: cloth.weaver.work().voxels_updated,
            reconstructor: cloth.weaver,
            chosen: cloth.chosen,
            ledger: account.ledger.clone(),
            mask: cloth.mask,
            reached: None,
            slice_axes: cloth.slice_axes,
            insert_ms: Vec::new(),
            pixels: cloth.pixels,
            notes: account.notes.iter().cloned().chain(cloth.notes).collect(),
        });
        Finished { outcome, drawn, account, recording, seal, decisions }
    }
}
