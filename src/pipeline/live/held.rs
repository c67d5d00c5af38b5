//! A session that is over, while its volume is still looked at: nothing comes in and nothing is woven, but pictures are drawn and readers read.

use std::sync::atomic::{AtomicBool, Ordering};

use drivers::clock::Monotonic;

use super::board::Account;
use super::fabric::Shared;
use super::picture::{self, Drawn, Wall};
use super::priority::{Role, Standing};
use super::recorder::Recording;
use super::seal::Seal;
use super::session::{Finished, Order, Session};
use super::{TURN, reader, sections, spawn};

/// What a session has come to.
pub struct Held<'a> {
    pub(super) session: &'a Session,
    pub(super) fabric: Shared,
    pub(super) wall: Option<Wall>,
    pub(super) drawn: Option<Drawn>,
    pub(super) account: Account,
    pub(super) recording: Option<Recording>,
    pub(super) seal: Option<Seal>,
}

impl Held<'_> {
    /// What there is to say of it.
    pub fn account(&self) -> &Account {
        &self.account
    }

    /// Whether there is a volume to be looked at.
    pub fn is_woven(&self) -> bool {
        self.fabric.lock().news.slices() > 0
    }

    /// Where it was recorded, if it was.
    pub fn recording(&self) -> Option<&Recording> {
        self.recording.as_ref()
    }

    /// Shows the volume until it is told to end. `watch` is called now and then; of its orders only how the volume is looked at can still be followed.
    pub fn linger(&self, ends: &AtomicBool, mut watch: impl FnMut(&Account) -> Vec<Order>) {
        let (shared, clock) = (&self.fabric, &Monotonic);
        shared.goes_on();
        std::thread::scope(|scope| {
            let standing = Standing::default();
            if let Some(wall) = &self.wall {
                spawn(scope, "picture", (&standing, Role::Usual), move || {
                    if let Err(error) = picture::run(shared, wall, false, clock, |_| {}) {
                        tracing::warn!("no picture of the volume: {error}");
                    }
                });
            }
            if let Some(cutter) = &self.session.cutter {
                spawn(scope, "sections", (&standing, Role::Usual), move || sections::run(shared, &**cutter));
            }
            for reader in &self.session.readers {
                spawn(scope, "reader", (&standing, Role::Usual), move || reader::run(shared, &**reader));
            }
            while !ends.load(Ordering::Relaxed) {
                std::thread::sleep(TURN);
                for order in watch(&self.account) {
                    if let (Order::Looks(looks), Some(wall)) = (order, &self.wall) {
                        wall.hang(&looks);
                    }
                }
            }
            shared.is_over();
        });
    }

    /// What it leaves.
    pub fn finish(self) -> Finished {
        let Self { session, fabric, drawn, account, recording, seal, .. } = self;
        session.finish(fabric.into_inner().loom, drawn, account, recording, seal)
    }
}
