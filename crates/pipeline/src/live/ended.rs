//! An ended session whose volume is still viewed: nothing is inserted, but pictures are rendered
//! and readers read.

use std::sync::atomic::{AtomicBool, Ordering};

use sonoweave_core::clock::Monotonic;

use crate::command::{Command, Instruction, Setting};

use super::digest::ResultDigest;
use super::picture::{self, Drawn, SharedViewClient};
use super::priority::{Role, SchedulingPolicy};
use super::recorder::Recording;
use super::session::{Finished, Session};
use super::shared_volume::Shared;
use super::status::SessionStatus;
use super::{TURN, plane_viewer, reader, spawn};

/// The result of an ended session that can still be viewed.
pub struct EndedSession<'a> {
    pub(super) session: &'a Session,
    pub(super) fabric: Shared,
    pub(super) wall: Option<SharedViewClient>,
    pub(super) drawn: Option<Drawn>,
    pub(super) account: SessionStatus,
    pub(super) recording: Option<Recording>,
    pub(super) seal: Option<ResultDigest>,
}

impl EndedSession<'_> {
    /// Returns its final status.
    pub fn account(&self) -> &SessionStatus {
        &self.account
    }

    /// Returns whether there is a volume to view.
    pub fn is_woven(&self) -> bool {
        self.fabric.lock().news.slices() > 0
    }

    /// Returns the recording, if the session was recorded.
    pub fn recording(&self) -> Option<&Recording> {
        self.recording.as_ref()
    }

    /// Shows the volume until `ends` is set. `watch` is called repeatedly; of the instructions
    /// that it returns, only changed view settings still have an effect.
    pub fn linger(&self, ends: &AtomicBool, mut watch: impl FnMut(&SessionStatus) -> Vec<Instruction>) {
        let (shared, clock) = (&self.fabric, &Monotonic);
        shared.goes_on();
        std::thread::scope(|scope| {
            let standing = SchedulingPolicy::default();
            if let Some(wall) = &self.wall {
                spawn(scope, "picture", (&standing, Role::Usual), move || {
                    if let Err(error) = picture::run(shared, wall, false, clock, |_| {}) {
                        tracing::warn!("no picture of the volume: {error}");
                    }
                });
            }
            if let Some(cutter) = &self.session.cutter {
                spawn(scope, "sections", (&standing, Role::Usual), move || plane_viewer::run(shared, &**cutter));
            }
            for reader in &self.session.readers {
                spawn(scope, "reader", (&standing, Role::Usual), move || reader::run(shared, &**reader));
            }
            while !ends.load(Ordering::Relaxed) {
                std::thread::sleep(TURN);
                let instructions = watch(&self.account);
                if let Some(wall) = &self.wall
                    && instructions.contains(&Instruction::Command(Command::Set(Setting::View)))
                {
                    wall.changed();
                }
            }
            shared.is_over();
        });
    }

    /// Returns the session's results.
    pub fn finish(self) -> Finished {
        let Self { session, fabric, drawn, account, recording, seal, .. } = self;
        session.finish(fabric.into_inner().loom, drawn, account, recording, seal)
    }
}
