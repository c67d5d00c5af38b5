//! `--igtl`: serves a session to other programs over OpenIGTLink.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;

use igtl::{Commands, Hub, Server};
use pipeline::Observer;
use pipeline::control::SessionController;
use pipeline::session::{Reader, Session};

use super::Failure;
use super::live::outputs::say;

/// Polling interval for the start of a session.
const POLL: Duration = Duration::from_millis(20);
/// Time between two status sentences.
const STATUS_EVERY: Duration = Duration::from_millis(500);

/// Flags of the OpenIGTLink server.
#[derive(Debug, Clone, Default, Args)]
pub(in crate::cli) struct Sharing {
    /// Serve slices, sensors and the volume over OpenIGTLink (3D Slicer, PLUS) at this address;
    /// everybody who reaches it sees them. Without an address: on this machine only
    #[arg(long, value_name = "ADDR:PORT", num_args = 0..=1, require_equals = true, default_missing_value = "127.0.0.1:18944")]
    igtl: Option<SocketAddr>,
    /// Folder for the volumes that clients on this machine save with the command save; it is
    /// created if missing [default: saving is disabled]
    #[arg(long, value_name = "DIR", requires = "igtl")]
    igtl_save: Option<PathBuf>,
    /// Begin only when a client on this machine sends the command start
    #[arg(long, requires = "igtl")]
    igtl_wait: bool,
}

/// A session's server.
pub(in crate::cli) struct IgtlServer {
    hub: Arc<Hub>,
    commands: Arc<Commands>,
    server: Server,
    /// Time of the last status sentence.
    sent: Option<Instant>,
}

impl Sharing {
    /// Whether the server is requested.
    pub(in crate::cli) fn is_requested(&self) -> bool {
        self.igtl.is_some()
    }

    /// Starts the server, if requested. The session ends by the flag `ends`.
    ///
    /// # Errors
    /// [`Failure`] when the address is taken.
    pub(in crate::cli) fn begin(&self, ends: &Arc<AtomicBool>, quiet: bool) -> Result<Option<IgtlServer>, Failure> {
        let Some(address) = self.igtl else { return Ok(None) };
        let hub = Arc::new(Hub::new());
        let commands = Arc::new(Commands::new(Arc::clone(ends), self.igtl_save.clone(), self.igtl_wait));
        hub.set_status(false, if self.igtl_wait { "waits for the command start" } else { "the session has not begun" });
        let server = Server::new(address, Arc::clone(&hub), Arc::clone(&commands))
            .map_err(|error| Failure(format!("--igtl: {error}")))?;
        if !quiet {
            say(&format!("OpenIGTLink at {}", server.address()));
            if !address.ip().is_loopback() {
                say(
                    "all clients of this address see slices and volume; only clients on this machine can send commands",
                );
            }
        }
        let shared = IgtlServer { hub, commands, server, sent: None };
        while !shared.commands.may_start() && !ends.load(Ordering::Relaxed) {
            std::thread::sleep(POLL);
        }
        Ok(Some(shared))
    }
}

impl IgtlServer {
    /// Registers as an observer of the session and as a reader of its volume.
    pub(in crate::cli) fn observe(&self, session: &mut Session) {
        session.observers.push(Arc::clone(&self.hub) as Arc<dyn Observer>);
        session.readers.push(Arc::clone(&self.hub) as Arc<dyn Reader>);
    }

    /// Lets clients freeze and clear a live session.
    pub(in crate::cli) fn control(&self, controller: &Arc<SessionController>) {
        self.commands.control(Arc::clone(controller));
    }

    /// Sends the session's status to clients.
    pub(in crate::cli) fn send_status(&mut self, sentence: impl FnOnce() -> String) {
        if self.sent.is_none_or(|sent| sent.elapsed() >= STATUS_EVERY) {
            self.sent = Some(Instant::now());
            self.hub.set_status(true, &sentence());
        }
    }

    /// Reports the clients' connection counts at the end, if there were any.
    pub(in crate::cli) fn leave(self, quiet: bool) {
        if let (Some(sentence), false) = (self.server.counts().sentence(), quiet) {
            say(&sentence);
        }
    }
}
