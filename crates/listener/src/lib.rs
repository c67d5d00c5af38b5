//! A TCP server on a thread of its own: it accepts connections until it is dropped.
//!
//! The console and the OpenIGTLink server differ in what they do with a connection. Binding, the
//! thread, accepting and the end are the same, and are here; so are limits of clients.

mod limits;

use std::io;
use std::net::{SocketAddr, TcpListener};
use std::thread::JoinHandle;
use std::time::Duration;

use tokio::net::TcpStream;
use tokio::runtime::{Builder, Runtime};
use tokio::sync::watch;
use tokio::task::JoinSet;

pub use limits::{MOST_MESSAGES, MessageRate, counted_address};

/// Pause after an accept error, for example when no more files may be opened.
const PAUSE: Duration = Duration::from_millis(200);

/// A bound address whose connections are not accepted yet.
#[derive(Debug)]
pub struct Bound {
    socket: TcpListener,
    address: SocketAddr,
}

impl Bound {
    /// Binds an address; port 0 takes any free port.
    ///
    /// # Errors
    /// The system's, if the address is taken or not this machine's.
    pub fn new(address: SocketAddr) -> io::Result<Self> {
        let socket = TcpListener::bind(address)?;
        socket.set_nonblocking(true)?;
        let address = socket.local_addr()?;
        Ok(Self { socket, address })
    }

    /// Returns the address, with the port that was chosen for port 0.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Runs `serve` on a thread of this name. It must return once [`Connections`] has ended.
    ///
    /// # Errors
    /// The system's, if no thread or event loop can be created.
    pub fn start(
        self,
        name: &'static str,
        serve: impl FnOnce(Runtime, Connections) + Send + 'static,
    ) -> io::Result<ServerThread> {
        let Self { socket, address } = self;
        let runtime = Builder::new_current_thread().enable_all().build()?;
        let socket = {
            let _context = runtime.enter();
            tokio::net::TcpListener::from_std(socket)?
        };
        let (stop, stopped) = watch::channel(());
        let connections = Connections { socket, address, stopped };
        let thread = std::thread::Builder::new().name(name.into()).spawn(move || serve(runtime, connections))?;
        Ok(ServerThread { name, address, stop: Some(stop), thread: Some(thread) })
    }
}

/// A running server. Dropping it ends its thread.
#[derive(Debug)]
pub struct ServerThread {
    name: &'static str,
    address: SocketAddr,
    /// Dropping it ends the thread.
    stop: Option<watch::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl ServerThread {
    /// Returns the address, with the port that was chosen for port 0.
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for ServerThread {
    fn drop(&mut self) {
        drop(self.stop.take());
        if self.thread.take().is_some_and(|thread| thread.join().is_err()) {
            tracing::error!("the thread {} of the server at {} has panicked", self.name, self.address);
        }
    }
}

/// The connections of a server.
#[derive(Debug)]
pub struct Connections {
    socket: tokio::net::TcpListener,
    address: SocketAddr,
    stopped: watch::Receiver<()>,
}

impl Connections {
    /// Returns a channel whose sender is gone once the server ends.
    pub fn stopped(&self) -> watch::Receiver<()> {
        self.stopped.clone()
    }

    /// Waits for a connection, and returns it with its remote address; `None` once the server
    /// ends. Meanwhile removes finished tasks from `serving`.
    pub async fn next(&mut self, serving: &mut JoinSet<()>) -> Option<(TcpStream, SocketAddr)> {
        loop {
            let accepted = tokio::select! {
                _ = self.stopped.changed() => return None,
                Some(_) = serving.join_next() => continue,
                accepted = self.socket.accept() => accepted,
            };
            match accepted {
                Ok(accepted) => return Some(accepted),
                Err(error) => {
                    tracing::warn!("{}: a connection could not be accepted: {error}", self.address);
                    tokio::time::sleep(PAUSE).await;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;
    use std::net::Ipv4Addr;

    use super::*;

    fn bound() -> Bound {
        Bound::new((Ipv4Addr::LOCALHOST, 0).into()).unwrap()
    }

    #[test]
    fn connections_are_accepted_until_server_is_dropped() {
        let server = bound().start("test", |runtime, mut connections| {
            runtime.block_on(async {
                let mut serving = JoinSet::new();
                while let Some((stream, _)) = connections.next(&mut serving).await {
                    let mut stopped = connections.stopped();
                    serving.spawn(async move {
                        let _ = stopped.changed().await;
                        let _ = stream.try_write(b"end");
                    });
                }
                while serving.join_next().await.is_some() {}
            });
        });
        let server = server.unwrap();
        let address = server.address();
        let mut clients = [(); 2].map(|()| std::net::TcpStream::connect(address).unwrap());
        assert_eq!(Bound::new(address).unwrap_err().kind(), io::ErrorKind::AddrInUse);
        std::thread::sleep(Duration::from_millis(100));
        drop(server);
        for client in &mut clients {
            let mut text = String::new();
            client.read_to_string(&mut text).unwrap();
            assert_eq!(text, "end");
        }
        assert!(std::net::TcpStream::connect(address).is_err());
    }
}
