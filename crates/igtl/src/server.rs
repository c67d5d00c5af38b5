//! The socket, and the thread that serves all clients.

use std::cell::RefCell;
use std::net::{SocketAddr, TcpListener};
use std::rc::Rc;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use tokio::sync::watch;
use tokio::task::LocalSet;

use super::client::Client;
use super::commands::Commands;
use super::counts::Counts;
use super::error::IgtlError;
use super::hub::Hub;
use super::state::ServerState;
use super::{connection, publish};

/// Largest number of clients; further ones are refused at once.
const CLIENTS: usize = 32;
/// Pause after an accept error, for example when no more files may be opened.
const PAUSE: Duration = Duration::from_millis(200);
/// Time for which the last messages are awaited at the end.
const LEAVING: Duration = Duration::from_millis(500);

/// A listening server. Dropping it stops it.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    counts: Arc<Counts>,
    /// Dropping it ends the thread.
    stop: Option<watch::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Listens, and serves from now on.
    ///
    /// # Errors
    /// [`IgtlError`] if the address is taken or no thread can be started.
    pub fn new(address: SocketAddr, hub: Arc<Hub>, commands: Arc<Commands>) -> Result<Self, IgtlError> {
        let taken = |source| IgtlError::Taken { address, source };
        let listener = TcpListener::bind(address).map_err(taken)?;
        listener.set_nonblocking(true).map_err(taken)?;
        let address = listener.local_addr().map_err(taken)?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(IgtlError::Thread)?;
        let (stop, stopped) = watch::channel(());
        let counts = Arc::new(Counts::default());
        let told = Arc::clone(&counts);
        let serve = move || {
            let house = Rc::new(ServerState {
                hub,
                commands,
                counts: told,
                clients: RefCell::default(),
                shown: RefCell::default(),
            });
            let tasks = LocalSet::new();
            tasks.block_on(&runtime, async move {
                match tokio::net::TcpListener::from_std(listener) {
                    Ok(listener) => accept(&listener, house, stopped).await,
                    Err(error) => tracing::error!("OpenIGTLink is not served: {error}"),
                }
            });
            // Lets a running save finish.
            runtime.shutdown_timeout(Duration::from_secs(10));
        };
        let thread = std::thread::Builder::new().name("igtl".into()).spawn(serve).map_err(IgtlError::Thread)?;
        Ok(Self { address, counts, stop: Some(stop), thread: Some(thread) })
    }

    /// Returns the address: as requested, with the free port chosen for port 0.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Returns the counters.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        drop(self.stop.take());
        if self.thread.take().is_some_and(|thread| thread.join().is_err()) {
            tracing::error!("the thread of OpenIGTLink has panicked");
        }
    }
}

/// Accepts connections until `stopped` changes or its sender is gone.
async fn accept(listener: &tokio::net::TcpListener, house: Rc<ServerState>, mut stopped: watch::Receiver<()>) {
    let publishing = tokio::task::spawn_local(publish::run(Rc::clone(&house)));
    let mut serving = tokio::task::JoinSet::new();
    loop {
        let accepted = tokio::select! {
            _ = stopped.changed() => break,
            Some(_) = serving.join_next() => continue,
            accepted = listener.accept() => accepted,
        };
        let (stream, peer) = match accepted {
            Ok(accepted) => accepted,
            Err(error) => {
                tracing::warn!("an OpenIGTLink client could not be accepted: {error}");
                tokio::time::sleep(PAUSE).await;
                continue;
            }
        };
        if house.clients.borrow().len() >= CLIENTS {
            Counts::add(&house.counts.turned_away);
            continue;
        }
        Counts::add(&house.counts.served);
        let client = Rc::new(Client::new(peer.ip().to_canonical().is_loopback()));
        house.join(&client);
        let (house, stopped) = (Rc::clone(&house), stopped.clone());
        serving.spawn_local(async move {
            connection::serve(&house, &client, stream, stopped).await;
            house.leave(&client);
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
