//! The socket: a bounded number of connections on one thread. No stage waits for this thread,
//! and it has a lower priority than all of them.

use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::{Service as _, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use rustix::process::setpriority_process;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio_rustls::TlsAcceptor;

use listener::{Bound, Connections, ServerThread};

use super::connection_info::ConnectionInfo;
use super::connection_limiter::{ConnectionLimiter, ConnectionSlot};
use super::counts::Counts;
use super::error::ConsoleError;
use super::listen::{Door, Listen};
use super::routes::routes;
use super::served::{ConsoleSession, Served};
use super::viewer_slots;

/// Time limit for a request, and before it for the TLS handshake.
const ASKING: Duration = Duration::from_secs(5);
/// Longest duration of a connection, whatever the client does; it then makes room for another.
const LASTING: Duration = Duration::from_secs(60);
/// Largest request head, bytes.
const HEAD: usize = 16 << 10;
/// Time for which answers under way are awaited at the end.
const LEAVING: Duration = Duration::from_secs(1);
/// Nice value of the thread. Under full load, capture, pairing and insertion get three times as
/// much processor time as this thread, and rendering a third as much.
const NICE: i32 = 5;

/// A listening console. Dropping it stops it.
#[derive(Debug)]
pub struct Console {
    thread: ServerThread,
    url: String,
    counts: Arc<Counts>,
}

impl Console {
    /// Listens at an address of this machine, and answers requests from now on.
    ///
    /// # Errors
    /// [`ConsoleError`], as for [`Self::open`].
    pub fn new(address: SocketAddr, session: ConsoleSession) -> Result<Self, ConsoleError> {
        Self::open(&address.into(), session)
    }

    /// Listens, and answers admitted requests from now on.
    ///
    /// # Errors
    /// [`ConsoleError`] if other machines could reach the console without TLS and token, a file
    /// of [`Listen`] is unusable, the address is taken, or no thread can be started.
    pub fn open(listen: &Listen, session: ConsoleSession) -> Result<Self, ConsoleError> {
        Self::serve(listen, session, viewer_slots::PATIENCE)
    }

    /// Like [`Self::open`]; pages inactive for longer than `patience` can be replaced.
    pub(super) fn serve(listen: &Listen, session: ConsoleSession, patience: Duration) -> Result<Self, ConsoleError> {
        let door = listen.door()?;
        let bound =
            Bound::new(listen.address).map_err(|source| ConsoleError::Taken { address: listen.address, source })?;
        let address = bound.address();
        let gate = door.gate(address.port());
        let (url, counts) = (url(address, &door), Arc::clone(&gate.counts));
        let serve = bound.start("status", move |runtime, connections| {
            if let Err(error) = setpriority_process(None, NICE) {
                tracing::warn!("the console's thread keeps its normal priority: {error}");
            }
            let served = Served::new(session, connections.stopped()).patient_for(patience).behind(gate);
            runtime.block_on(accept(connections, door, served));
        });
        Ok(Self { thread: serve.map_err(ConsoleError::Thread)?, url, counts })
    }

    /// Returns the address: as configured, with the free port chosen for port 0.
    pub fn address(&self) -> SocketAddr {
        self.thread.address()
    }

    /// Returns the address as a URL.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// Returns the counters of connections and pages.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }
}

/// Returns the URL for a browser. If the server listens at all addresses, it contains a name of
/// this machine, if there is one.
fn url(address: SocketAddr, door: &Door) -> String {
    let scheme = if door.tls.is_some() { "https" } else { "http" };
    match door.name().filter(|_| address.ip().is_unspecified()) {
        Some(name) => format!("{scheme}://{name}:{}/", address.port()),
        None => format!("{scheme}://{address}/"),
    }
}

/// Accepts connections until the server ends.
async fn accept(mut connections: Connections, door: Door, served: Served) {
    let (pages, counts) = (Arc::clone(&served.viewer_slots), Arc::clone(&served.gate.counts));
    let service = TowerToHyperService::new(routes(served));
    let limiter = Arc::new(ConnectionLimiter::default());
    let mut serving = JoinSet::new();
    let mut stopped = connections.stopped();
    while let Some((stream, peer)) = connections.next(&mut serving).await {
        let (slot, has_evicted) = tokio::select! {
            _ = stopped.changed() => break,
            entered = limiter.enter() => entered,
        };
        Counts::add(&counts.connections);
        if has_evicted {
            Counts::add(&counts.evictions);
        }
        let Ok(local) = stream.local_addr() else { continue };
        let line = ConnectionInfo { local, peer, secured: door.tls.is_some() };
        let (tls, service, counts, stopped) =
            (door.tls.clone(), service.clone(), Arc::clone(&counts), connections.stopped());
        serving.spawn(async move {
            tokio::select! {
                () = serve(stream, tls, service, line, &slot, &counts, stopped) => {}
                () = slot.evicted() => tracing::debug!("the idle connection of {peer} was closed"),
            }
        });
    }
    // Requests already received are answered; idle connections are closed.
    let gone = async { tokio::join!(async { while serving.join_next().await.is_some() {} }, pages.left()) };
    let _ = tokio::time::timeout(LEAVING, gone).await;
}

/// Serves a connection to its end.
async fn serve(
    stream: TcpStream,
    tls: Option<TlsAcceptor>,
    service: TowerToHyperService<Router>,
    line: ConnectionInfo,
    slot: &ConnectionSlot,
    counts: &Counts,
    stopped: watch::Receiver<()>,
) {
    let Some(tls) = tls else { return talk(stream, service, line, slot, stopped).await };
    match tokio::time::timeout(ASKING, tls.accept(stream)).await {
        Ok(Ok(stream)) => talk(stream, service, line, slot, stopped).await,
        Ok(Err(error)) => {
            Counts::add(&counts.no_tls);
            tracing::debug!("the TLS connection of {} failed: {error}", line.peer);
        }
        Err(_) => {
            Counts::add(&counts.no_tls);
            tracing::debug!("the TLS connection of {} took too long", line.peer);
        }
    }
}

/// Handles the requests of a connection.
async fn talk(
    stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static,
    service: TowerToHyperService<Router>,
    line: ConnectionInfo,
    slot: &ConnectionSlot,
    mut stopped: watch::Receiver<()>,
) {
    let service = service_fn(|mut request: axum::http::Request<Incoming>| {
        slot.is_answered(true);
        request.extensions_mut().insert(line);
        let answer = service.call(request);
        async move {
            let answer = answer.await;
            slot.is_answered(false);
            answer
        }
    });
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
    // Clients that disconnect, send nonsense or are slow do not concern the session.
    match tokio::time::timeout(LASTING, connection).await {
        Ok(Ok(())) => {}
        Ok(Err(error)) => tracing::debug!("a request for the status failed: {error}"),
        Err(_) => tracing::debug!("a request for the status took too long"),
    }
}
