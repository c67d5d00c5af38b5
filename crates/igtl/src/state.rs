//! State of the server's thread: the session's hub, the clients, and the messages published last.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use ipnet::IpNet;
use tokio::sync::watch;
use tokio::time::Instant;

use pipeline::session::Snapshot;
use sync::history::PoseSample;

use super::client::Client;
use super::commands::Commands;
use super::counts::Counts;
use super::encode::Both;
use super::hub::Hub;

/// State shared by the thread's tasks.
pub(super) struct ServerState {
    pub(super) hub: Arc<Hub>,
    pub(super) commands: Arc<Commands>,
    pub(super) counts: Arc<Counts>,
    /// Networks whose clients are admitted.
    pub(super) allowed: watch::Receiver<Vec<IpNet>>,
    pub(super) clients: RefCell<Vec<Rc<Client>>>,
    pub(super) published: RefCell<LastPublished>,
}

impl ServerState {
    /// Counts the clients that want volumes, since only they cause volumes to be made.
    pub(super) fn count_watchers(&self) {
        let watchers = self.clients.borrow().iter().filter(|client| client.subscriptions.get().images).count();
        self.hub.watchers.store(watchers, Ordering::Relaxed);
    }
}

/// The messages published last, for requests.
#[derive(Default)]
pub(super) struct LastPublished {
    pub(super) world: String,
    pub(super) slice: Option<Both>,
    pub(super) volume: Option<Both>,
    pub(super) snapshot: Option<Result<Snapshot, String>>,
    pub(super) transforms: BTreeMap<String, Both>,
    pub(super) poses: BTreeMap<String, PoseSample>,
    pub(super) status: Option<(u16, String)>,
    /// Time at which a transform of a name may be sent again.
    pub(super) due: BTreeMap<String, Instant>,
}
