//! The socket: a bounded number of connections at a time, none of which is waited for, on one thread that no stage knows of and that gives way to all of them.

use std::io;
use std::net::{SocketAddr, TcpListener};
use std::pin::pin;
use std::sync::Arc;
use std::thread::JoinHandle;
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

use super::counts::Counts;
use super::crowd::{Crowd, Place};
use super::listen::{AccessError, Door, Listen};
use super::{Served, Shown, places, routes};

/// For how long a client may take to ask, and before that to agree on how it is kept secret.
const ASKING: Duration = Duration::from_secs(5);
/// For how long a connection may last, whatever its client does with it: then it is another's turn.
const LASTING: Duration = Duration::from_secs(60);
/// Bytes of a request's head.
const HEAD: usize = 16 << 10;
/// For how long the answers that are under way are waited for at the end.
const LEAVING: Duration = Duration::from_secs(1);
/// After a connection that could not be taken, as when no file may be opened any more.
const PAUSE: Duration = Duration::from_millis(200);
/// How nice the thread is: where everybody wants the processor, capture, pairing and weaving get three times as much of it as whoever asks, and drawing a third as much.
const NICE: i32 = 5;

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
    /// Who may ask.
    #[error(transparent)]
    Access(#[from] AccessError),
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

/// By which line a request came.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    /// This machine's end.
    pub(super) local: SocketAddr,
    /// The other's.
    pub(super) peer: SocketAddr,
    /// Whether what is said is kept from others by TLS.
    pub(super) secured: bool,
}

/// The status, where it is to be had. It ends when this is dropped.
#[derive(Debug)]
pub struct Console {
    address: SocketAddr,
    url: String,
    counts: Arc<Counts>,
    /// Dropped, it ends the thread.
    stop: Option<watch::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Console {
    /// Listens on this machine, and answers from now on.
    ///
    /// # Errors
    /// [`ConsoleError`], as for [`Self::open`].
    pub fn new(address: SocketAddr, shown: Shown) -> Result<Self, ConsoleError> {
        Self::open(&address.into(), shown)
    }

    /// Listens, and answers from now on those who may ask.
    ///
    /// # Errors
    /// [`ConsoleError`] when others could reach it who must not, when a file of [`Listen`] cannot be used, when the address is taken, or there is no thread to be had.
    pub fn open(listen: &Listen, shown: Shown) -> Result<Self, ConsoleError> {
        Self::serve(listen, shown, places::PATIENCE)
    }

    /// As [`Self::open`], where pages that rest for so long give way.
    pub(super) fn serve(listen: &Listen, shown: Shown, patience: Duration) -> Result<Self, ConsoleError> {
        let door = listen.door()?;
        let address = listen.address;
        let taken = |source| ConsoleError::Taken { address, source };
        let listener = TcpListener::bind(address).map_err(taken)?;
        listener.set_nonblocking(true).map_err(taken)?;
        let address = listener.local_addr().map_err(taken)?;
        let runtime =
            tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(ConsoleError::Thread)?;
        let (stop, stopped) = watch::channel(());
        let served = Served::new(shown, stopped.clone()).patient_for(patience).behind(door.gate(address.port()));
        let (url, counts) = (url(address, &door), Arc::clone(&served.gate.counts));
        let serve = move || {
            if let Err(error) = setpriority_process(None, NICE) {
                tracing::warn!("the console does not give way to the other threads: {error}");
            }
            runtime.block_on(async {
                match tokio::net::TcpListener::from_std(listener) {
                    Ok(listener) => accept(&listener, door, served, stopped).await,
                    Err(error) => tracing::error!("{address}: the status cannot be asked for: {error}"),
                }
            });
        };
        let thread = std::thread::Builder::new().name("status".into()).spawn(serve).map_err(ConsoleError::Thread)?;
        Ok(Self { address, url, counts, stop: Some(stop), thread: Some(thread) })
    }

    /// Where it is to be had: as configured, and for port 0 the port that was free.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The same as browsers have it.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// What became of those who asked.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }
}

/// What to type into a browser: where all of a machine's addresses are listened at, a name of it, if it has one.
fn url(address: SocketAddr, door: &Door) -> String {
    let scheme = if door.tls.is_some() { "https" } else { "http" };
    match door.name().filter(|_| address.ip().is_unspecified()) {
        Some(name) => format!("{scheme}://{name}:{}/", address.port()),
        None => format!("{scheme}://{address}/"),
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
async fn accept(listener: &tokio::net::TcpListener, door: Door, served: Served, mut stopped: watch::Receiver<()>) {
    let (pages, counts) = (Arc::clone(&served.places), Arc::clone(&served.gate.counts));
    let service = TowerToHyperService::new(routes(served));
    let crowd = Arc::new(Crowd::default());
    let mut serving = JoinSet::new();
    loop {
        let accepted = tokio::select! {
            _ = stopped.changed() => break,
            Some(_) = serving.join_next() => continue,
            accepted = listener.accept() => accepted,
        };
        let (stream, peer) = match accepted {
            Ok(accepted) => accepted,
            Err(error) => {
                tracing::warn!("the status was asked for, and could not answer: {error}");
                tokio::time::sleep(PAUSE).await;
                continue;
            }
        };
        let (place, gave_way) = tokio::select! {
            _ = stopped.changed() => break,
            entered = crowd.enter() => entered,
        };
        Counts::add(&counts.connections);
        if gave_way {
            Counts::add(&counts.gave_way);
        }
        let Ok(local) = stream.local_addr() else { continue };
        let line = Line { local, peer, secured: door.tls.is_some() };
        let (tls, service, counts, stopped) = (door.tls.clone(), service.clone(), Arc::clone(&counts), stopped.clone());
        serving.spawn(async move {
            tokio::select! {
                () = serve(stream, tls, service, line, &place, &counts, stopped) => {}
                () = place.sent_away() => tracing::debug!("{peer} gave way, as it asked for nothing"),
            }
        });
    }
    // Whoever has asked already gets the answer, and whoever only holds a connection open is cut off.
    let gone = async { tokio::join!(async { while serving.join_next().await.is_some() {} }, pages.left()) };
    let _ = tokio::time::timeout(LEAVING, gone).await;
}

/// A connection, to its end.
async fn serve(
    stream: TcpStream,
    tls: Option<TlsAcceptor>,
    service: TowerToHyperService<Router>,
    line: Line,
    place: &Place,
    counts: &Counts,
    stopped: watch::Receiver<()>,
) {
    let Some(tls) = tls else { return talk(stream, service, line, place, stopped).await };
    match tokio::time::timeout(ASKING, tls.accept(stream)).await {
        Ok(Ok(stream)) => talk(stream, service, line, place, stopped).await,
        Ok(Err(error)) => {
            Counts::add(&counts.no_tls);
            tracing::debug!("{} does not speak TLS: {error}", line.peer);
        }
        Err(_) => {
            Counts::add(&counts.no_tls);
            tracing::debug!("{} took too long to speak TLS", line.peer);
        }
    }
}

/// Requests and answers.
async fn talk(
    stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static,
    service: TowerToHyperService<Router>,
    line: Line,
    place: &Place,
    mut stopped: watch::Receiver<()>,
) {
    let service = service_fn(|mut request: axum::http::Request<Incoming>| {
        place.is_answered(true);
        request.extensions_mut().insert(line);
        let answer = service.call(request);
        async move {
            let answer = answer.await;
            place.is_answered(false);
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
    // A client that goes away, asks for nonsense or takes its time is no matter of the session's.
    match tokio::time::timeout(LASTING, connection).await {
        Ok(Ok(())) => {}
        Ok(Err(error)) => tracing::debug!("a request for the status: {error}"),
        Err(_) => tracing::debug!("a request for the status took too long"),
    }
}
