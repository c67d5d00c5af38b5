//! The socket, and the thread that serves all clients.

use std::cell::RefCell;
use std::net::SocketAddr;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

use ipnet::IpNet;
use tokio::sync::watch;
use tokio::task::LocalSet;
use tokio::time::Instant;

use listener::{Bound, Connections, ServerThread};

use super::admission::{Refusals, admits, has_room};
use super::client::Client;
use super::commands::Commands;
use super::counts::Counts;
use super::error::IgtlError;
use super::hub::Hub;
use super::state::ServerState;
use super::{connection, publish};

/// Time for which the last messages are awaited at the end.
const LEAVING: Duration = Duration::from_millis(500);
/// Time for which a running save is awaited at the end.
const SAVING: Duration = Duration::from_secs(10);

/// A listening server. Dropping it stops it.
#[derive(Debug)]
pub struct Server {
    thread: ServerThread,
    counts: Arc<Counts>,
    allowed: watch::Sender<Vec<IpNet>>,
}

impl Server {
    /// Listens, and serves this machine and the allowed networks from now on.
    ///
    /// # Errors
    /// [`IgtlError`] if other machines reach the address and no network is allowed, if the address
    /// is taken, or if no thread can be started.
    pub fn new(
        address: SocketAddr,
        allowed: Vec<IpNet>,
        hub: Arc<Hub>,
        commands: Arc<Commands>,
    ) -> Result<Self, IgtlError> {
        if allowed.is_empty() && !address.ip().to_canonical().is_loopback() {
            return Err(IgtlError::NoNetwork { address });
        }
        let bound = Bound::new(address).map_err(|source| IgtlError::Taken { address, source })?;
        let counts = Arc::new(Counts::default());
        let counted = Arc::clone(&counts);
        let (allowed, allowing) = watch::channel(allowed);
        let serve = bound.start("igtl", move |runtime, connections| {
            let (clients, published) = (RefCell::default(), RefCell::default());
            let state = Rc::new(ServerState { hub, commands, counts: counted, allowed: allowing, clients, published });
            LocalSet::new().block_on(&runtime, accept(connections, state));
            runtime.shutdown_timeout(SAVING);
        });
        Ok(Self { thread: serve.map_err(IgtlError::Thread)?, counts, allowed })
    }

    /// Replaces the allowed networks. Clients that are no longer in one are disconnected.
    pub fn allow(&self, networks: &[IpNet]) {
        self.allowed.send_if_modified(|allowed| {
            let is_new = allowed != networks;
            networks.clone_into(allowed);
            is_new
        });
    }

    /// Returns the address: as requested, with the free port chosen for port 0.
    pub fn address(&self) -> SocketAddr {
        self.thread.address()
    }

    /// Returns the counters.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }
}

/// Accepts clients until the server ends.
async fn accept(mut connections: Connections, state: Rc<ServerState>) {
    let publishing = tokio::task::spawn_local(publish::run(Rc::clone(&state)));
    let mut serving = tokio::task::JoinSet::new();
    let mut refusals = Refusals::default();
    while let Some((stream, peer)) = connections.next(&mut serving).await {
        let address = peer.ip().to_canonical();
        if !admits(&state.allowed.borrow(), address) {
            Counts::add(&state.counts.not_allowed);
            if let Some(count) = refusals.add(Instant::now()) {
                tracing::warn!(
                    "{count} OpenIGTLink connections were closed, the last one of {address}: no allowed network holds \
                    it; add one under allow in [igtl]"
                );
            }
            continue;
        }
        if !has_room(state.clients.borrow().iter().map(|client| client.address), address) {
            Counts::add(&state.counts.turned_away);
            continue;
        }
        Counts::add(&state.counts.served);
        let client = Rc::new(Client::new(address));
        state.join(&client);
        let (state, stopped) = (Rc::clone(&state), connections.stopped());
        serving.spawn_local(async move {
            connection::serve(&state, &client, stream, stopped).await;
            state.leave(&client);
        });
    }
    publishing.abort();
    let _ = tokio::time::timeout(LEAVING, async { while serving.join_next().await.is_some() {} }).await;
}

impl ServerState {
    fn join(&self, client: &Rc<Client>) {
        self.clients.borrow_mut().push(Rc::clone(client));
        self.count_watchers();
        self.welcome(client);
    }

    fn leave(&self, client: &Rc<Client>) {
        self.clients.borrow_mut().retain(|other| !Rc::ptr_eq(other, client));
        self.count_watchers();
    }
}
