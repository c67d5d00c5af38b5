//! The socket, and the thread that serves all clients.

use std::cell::RefCell;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use tokio::sync::watch;
use tokio::task::LocalSet;

use super::client::{self, Client};
use super::commands::Commands;
use super::hub::Hub;
use super::publish::{self, Shown};

/// Clients at a time; more are turned away at once.
const CLIENTS: usize = 32;
/// After a connection that could not be taken, as when no file may be opened any more.
const PAUSE: Duration = Duration::from_millis(200);
/// For how long the last messages are waited for at the end.
const LEAVING: Duration = Duration::from_millis(500);

/// Why there is no server.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The address.
    #[error(
        "--igtl {address}: cannot be listened at: {source}; give another port, or end the program that has this one"
    )]
    Taken {
        /// As asked for.
        address: SocketAddr,
        /// Why.
        source: io::Error,
    },
    /// The thread, or what it waits by.
    #[error("--igtl: no thread for it: {0}")]
    Thread(io::Error),
}

/// What became of clients.
#[derive(Debug, Default)]
pub struct Counts {
    /// Clients that were served.
    pub served: AtomicU64,
    /// Connections that found all places taken.
    pub turned_away: AtomicU64,
    /// Clients that were cut off as they took too little or too slowly.
    pub cut_off: AtomicU64,
    /// Clients that were cut off as what they sent was no OpenIGTLink.
    pub nonsense: AtomicU64,
    /// Messages that were not sent as newer ones took their places.
    pub replaced: AtomicU64,
}

impl Counts {
    pub(super) fn add(count: &AtomicU64) {
        count.fetch_add(1, Ordering::Relaxed);
    }

    /// In words, where there is anything to say.
    pub fn sentence(&self) -> Option<String> {
        let [served, away, cut, nonsense, replaced] =
            [&self.served, &self.turned_away, &self.cut_off, &self.nonsense, &self.replaced]
                .map(|count| count.load(Ordering::Relaxed));
        (served + away > 0).then(|| {
            format!(
                "OpenIGTLink: {served} clients, {away} turned away, {cut} cut off as too slow, {nonsense} as they sent something else; {replaced} messages were replaced by newer ones before they were sent"
            )
        })
    }
}

/// All that the thread's tasks share.
pub(super) struct House {
    pub(super) hub: Arc<Hub>,
    pub(super) commands: Arc<Commands>,
    pub(super) counts: Arc<Counts>,
    pub(super) clients: RefCell<Vec<Rc<Client>>>,
    pub(super) shown: RefCell<Shown>,
}

/// A server, where it is to be had. It ends when this is dropped.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    counts: Arc<Counts>,
    /// Dropped, it ends the thread.
    stop: Option<watch::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Listens, and serves from now on.
    ///
    /// # Errors
    /// [`ServerError`] when the address is taken, or there is no thread to be had.
    pub fn new(address: SocketAddr, hub: Arc<Hub>, commands: Arc<Commands>) -> Result<Self, ServerError> {
        let taken = |source| ServerError::Taken { address, source };
        let listener = TcpListener::bind(address).map_err(taken)?;
        listener.set_nonblocking(true).map_err(taken)?;
        let address = listener.local_addr().map_err(taken)?;
        let runtime =
            tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(ServerError::Thread)?;
        let (stop, stopped) = watch::channel(());
        let counts = Arc::new(Counts::default());
        let told = Arc::clone(&counts);
        let serve = move || {
            let house =
                Rc::new(House { hub, commands, counts: told, clients: RefCell::default(), shown: RefCell::default() });
            let tasks = LocalSet::new();
            tasks.block_on(&runtime, async move {
                match tokio::net::TcpListener::from_std(listener) {
                    Ok(listener) => accept(&listener, house, stopped).await,
                    Err(error) => tracing::error!("OpenIGTLink is not served: {error}"),
                }
            });
            // What is being saved is saved.
            runtime.shutdown_timeout(Duration::from_secs(10));
        };
        let thread = std::thread::Builder::new().name("igtl".into()).spawn(serve).map_err(ServerError::Thread)?;
        Ok(Self { address, counts, stop: Some(stop), thread: Some(thread) })
    }

    /// Where it is: as asked for, and for port 0 the port that was free.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// What became of clients.
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

/// Takes connections until it is told to stop, or whoever would tell it is gone.
async fn accept(listener: &tokio::net::TcpListener, house: Rc<House>, mut stopped: watch::Receiver<()>) {
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
                tracing::warn!("a client of OpenIGTLink could not be taken: {error}");
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
            client::serve(&house, &client, stream, stopped).await;
            house.leave(&client);
        });
    }
    publishing.abort();
    let _ = tokio::time::timeout(LEAVING, async { while serving.join_next().await.is_some() {} }).await;
}

impl House {
    fn join(&self, client: &Rc<Client>) {
        self.clients.borrow_mut().push(Rc::clone(client));
        self.count_watchers();
        self.welcome(client);
    }

    fn leave(&self, client: &Rc<Client>) {
        self.clients.borrow_mut().retain(|other| !Rc::ptr_eq(other, client));
        self.count_watchers();
    }

    /// Volumes are made for who wants them.
    pub(super) fn count_watchers(&self) {
        let watchers = self.clients.borrow().iter().filter(|client| client.wants.get().images).count();
        self.hub.watchers.store(watchers, Ordering::Relaxed);
    }
}
