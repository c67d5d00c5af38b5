//! The socket: a few connections at a time, none of which is waited for, on one thread that no stage knows of.

use std::io;
use std::net::{SocketAddr, TcpListener};
use std::pin::pin;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::sync::{Semaphore, watch};

use super::{PAGES, Served, Shown, routes};

/// Connections at a time; more wait in the kernel.
const CONNECTIONS: usize = 16;
/// For how long a client may take to ask.
const ASKING: Duration = Duration::from_secs(5);
/// For how long a connection may last, whatever its client does with it: then it is another's turn.
const LASTING: Duration = Duration::from_secs(60);
/// Bytes of a request's head.
const HEAD: usize = 16 << 10;
/// For how long the answers that are under way are waited for at the end.
const LEAVING: Duration = Duration::from_secs(1);
/// After a connection that could not be taken, as when no file may be opened any more.
const PAUSE: Duration = Duration::from_millis(200);

/// Why nothing is told.
#[derive(Debug, thiserror::Error)]
pub enum ConsoleError {
    /// The address.
    #[error("status.listen: {address} cannot be listened at: {source}; {}", advice(source))]
    Taken {
        /// As configured.
        address: SocketAddr,
        /// Why.
        source: io::Error,
    },
    /// The thread, or what it waits by.
    #[error("status.listen: no thread for it: {0}")]
    Thread(io::Error),
}

fn advice(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::AddrInUse => "another session, or another program, has this port: end it, or give another port",
        io::ErrorKind::PermissionDenied => "ports below 1024 are the administrator's: give a higher one",
        _ => "give 127.0.0.1 with a port that is free",
    }
}

/// The status, where it is to be had. It ends when this is dropped.
#[derive(Debug)]
pub struct Console {
    address: SocketAddr,
    /// Dropped, it ends the thread.
    stop: Option<watch::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Console {
    /// Listens, and answers from now on.
    ///
    /// # Errors
    /// [`ConsoleError`] when the address is taken, or there is no thread to be had.
    pub fn new(address: SocketAddr, shown: Shown) -> Result<Self, ConsoleError> {
        let taken = |source| ConsoleError::Taken { address, source };
        let listener = TcpListener::bind(address).map_err(taken)?;
        listener.set_nonblocking(true).map_err(taken)?;
        let address = listener.local_addr().map_err(taken)?;
        let runtime =
            tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(ConsoleError::Thread)?;
        let (stop, stopped) = watch::channel(());
        let served = Served::new(shown, stopped.clone());
        let serve = move || {
            runtime.block_on(async {
                match tokio::net::TcpListener::from_std(listener) {
                    Ok(listener) => accept(&listener, served, stopped).await,
                    Err(error) => tracing::error!("{address}: the status cannot be asked for: {error}"),
                }
            });
        };
        let thread = std::thread::Builder::new().name("status".into()).spawn(serve).map_err(ConsoleError::Thread)?;
        Ok(Self { address, stop: Some(stop), thread: Some(thread) })
    }

    /// Where it is to be had: as configured, and for port 0 the port that was free.
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for Console {
    fn drop(&mut self) {
        drop(self.stop.take());
        if self.thread.take().is_some_and(|thread| thread.join().is_err()) {
            tracing::error!("the status' thread has panicked");
        }
    }
}

/// Takes connections until it is told to stop, or whoever would tell it is gone.
async fn accept(listener: &tokio::net::TcpListener, served: Served, mut stopped: watch::Receiver<()>) {
    let pages = Arc::clone(&served.places);
    let routes = routes(served);
    let places = Arc::new(Semaphore::new(CONNECTIONS));
    loop {
        let taken = async {
            let place = Arc::clone(&places).acquire_owned().await;
            (place, listener.accept().await)
        };
        let (place, stream) = tokio::select! {
            _ = stopped.changed() => break,
            (place, accepted) = taken => match accepted {
                Ok((stream, _)) => (place, stream),
                Err(error) => {
                    tracing::warn!("the status was asked for, and could not answer: {error}");
                    tokio::time::sleep(PAUSE).await;
                    continue;
                }
            },
        };
        let (service, mut stopped) = (TowerToHyperService::new(routes.clone()), stopped.clone());
        tokio::spawn(async move {
            let mut builder = http1::Builder::new();
            builder.timer(TokioTimer::new()).header_read_timeout(ASKING).max_buf_size(HEAD);
            let mut connection = pin!(builder.serve_connection(TokioIo::new(stream), service).with_upgrades());
            let connection = async {
                tokio::select! {
                    result = connection.as_mut() => return result,
                    _ = stopped.changed() => connection.as_mut().graceful_shutdown(),
                }
                connection.await
            };
            // A client that goes away, asks for nonsense or takes its time is no matter of the session's.
            match tokio::time::timeout(LASTING, connection).await {
                Ok(Ok(())) => {}
                Ok(Err(error)) => tracing::debug!("a request for the status: {error}"),
                Err(_) => tracing::debug!("a request for the status took too long"),
            }
            drop(place);
        });
    }
    // Whoever has asked already gets the answer, and whoever only holds a connection open is cut off.
    let [all, looking] = [CONNECTIONS, PAGES].map(|count| u32::try_from(count).unwrap_or(u32::MAX));
    let gone = async { tokio::join!(places.acquire_many(all), pages.acquire_many(looking)) };
    let _ = tokio::time::timeout(LEAVING, gone).await;
}
