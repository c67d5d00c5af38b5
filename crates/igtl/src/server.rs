//! The socket, and the thread that serves all clients.

use std::cell::RefCell;
use std::net::SocketAddr;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

use tokio::task::LocalSet;

use listener::{Bound, Connections, ServerThread};

use super::client::Client;
use super::commands::Commands;
use super::counts::Counts;
use super::error::IgtlError;
use super::hub::Hub;
use super::state::ServerState;
use super::{connection, publish};

/// Largest number of clients; further ones are refused at once.
const CLIENTS: usize = 32;
/// Time for which the last messages are awaited at the end.
const LEAVING: Duration = Duration::from_millis(500);
/// Time for which a running save is awaited at the end.
const SAVING: Duration = Duration::from_secs(10);

/// A listening server. Dropping it stops it.
#[derive(Debug)]
pub struct Server {
    thread: ServerThread,
    counts: Arc<Counts>,
}

impl Server {
    /// Listens, and serves from now on.
    ///
    /// # Errors
    /// [`IgtlError`] if the address is taken or no thread can be started.
    pub fn new(address: SocketAddr, hub: Arc<Hub>, commands: Arc<Commands>) -> Result<Self, IgtlError> {
        let bound = Bound::new(address).map_err(|source| IgtlError::Taken { address, source })?;
        let counts = Arc::new(Counts::default());
        let counted = Arc::clone(&counts);
        let serve = bound.start("igtl", move |runtime, connections| {
            let (clients, published) = (RefCell::default(), RefCell::default());
            let state = Rc::new(ServerState { hub, commands, counts: counted, clients, published });
            LocalSet::new().block_on(&runtime, accept(connections, state));
            runtime.shutdown_timeout(SAVING);
        });
        Ok(Self { thread: serve.map_err(IgtlError::Thread)?, counts })
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
    while let Some((stream, peer)) = connections.next(&mut serving).await {
        if state.clients.borrow().len() >= CLIENTS {
            Counts::add(&state.counts.turned_away);
            continue;
        }
        Counts::add(&state.counts.served);
        let client = Rc::new(Client::new(peer.ip().to_canonical().is_loopback()));
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
