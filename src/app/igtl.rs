//! `--igtl`: serves a session to other programs over OpenIGTLink.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use igtl::{Commands, Hub, IgtlError, Server};
use ipnet::IpNet;
use pipeline::Observer;
use pipeline::control::SessionController;
use pipeline::session::{Reader, Session};
use statistics::IgtlNumbers;

use super::reporter::Reporter;
use crate::failure::Failure;

/// Polling interval for the start of a session.
const POLL: Duration = Duration::from_millis(20);
/// Time between two status sentences.
const STATUS_EVERY: Duration = Duration::from_millis(500);

/// Settings of the OpenIGTLink server.
#[derive(Debug, Clone, Default)]
pub(crate) struct Sharing {
    /// Address of the server; `None` for no server.
    pub(crate) address: Option<SocketAddr>,
    /// Networks of other machines that may connect, besides the configured ones.
    pub(crate) allow: Vec<IpNet>,
    /// Folder for the volumes that clients save; saving is disabled without it.
    pub(crate) save: Option<PathBuf>,
    /// Whether the session begins only when a client sends the command start.
    pub(crate) waits: bool,
}

/// A session's server.
pub(crate) struct IgtlServer {
    hub: Arc<Hub>,
    commands: Arc<Commands>,
    server: Server,
    /// Networks of the settings.
    allow: Vec<IpNet>,
    /// Time of the last status sentence.
    sent: Option<Instant>,
}

impl Sharing {
    /// Starts the server, if requested, for this machine, the `configured` networks and those of
    /// the settings. The session ends by the flag `ends`.
    ///
    /// # Errors
    /// [`Failure`] when the address is taken, or reachable without an allowed network.
    pub(crate) fn begin(
        &self,
        configured: &[IpNet],
        ends: &Arc<AtomicBool>,
        reporter: &dyn Reporter,
        quiet: bool,
    ) -> Result<Option<IgtlServer>, Failure> {
        let Some(address) = self.address else { return Ok(None) };
        let hub = Arc::new(Hub::new());
        let commands = Arc::new(Commands::new(Arc::clone(ends), self.save.clone(), self.waits));
        hub.set_status(false, if self.waits { "waits for the command start" } else { "the session has not begun" });
        let allowed = [configured, &self.allow].concat();
        let server = Server::new(address, allowed.clone(), Arc::clone(&hub), Arc::clone(&commands)).map_err(refused)?;
        if !quiet {
            reporter.say(&format!("OpenIGTLink at {}", server.address()));
            if !allowed.is_empty() {
                let networks: Vec<String> = allowed.iter().map(IpNet::to_string).collect();
                reporter.say(&format!(
                    "clients in {} see slices and volume; only clients on this machine can send commands",
                    networks.join(", ")
                ));
            }
        }
        let shared = IgtlServer { hub, commands, server, allow: self.allow.clone(), sent: None };
        while !shared.commands.may_start() && !ends.load(Ordering::Relaxed) {
            std::thread::sleep(POLL);
        }
        Ok(Some(shared))
    }
}

/// Adds the flag that allows networks.
fn refused(error: IgtlError) -> Failure {
    let flag = if matches!(error, IgtlError::NoNetwork { .. }) { "; --igtl-allow lists them, too" } else { "" };
    Failure::new(format!("--igtl: {error}{flag}"))
}

impl IgtlServer {
    /// Allows the configured networks, besides those of the settings, from now on.
    pub(crate) fn allow(&self, configured: &[IpNet]) {
        self.server.allow(&[configured, &self.allow].concat());
    }

    /// Returns the numbers of clients.
    pub(crate) fn numbers(&self) -> IgtlNumbers {
        self.server.counts().numbers()
    }

    /// Registers as an observer of the session and as a reader of its volume.
    pub(crate) fn observe(&self, session: &mut Session) {
        session.observers.push(Arc::clone(&self.hub) as Arc<dyn Observer>);
        session.readers.push(Arc::clone(&self.hub) as Arc<dyn Reader>);
    }

    /// Lets clients freeze and clear a live session.
    pub(crate) fn control(&self, controller: &Arc<SessionController>) {
        self.commands.control(Arc::clone(controller));
    }

    /// Sends the session's status to clients.
    pub(crate) fn send_status(&mut self, sentence: impl FnOnce() -> String) {
        if self.sent.is_none_or(|sent| sent.elapsed() >= STATUS_EVERY) {
            self.sent = Some(Instant::now());
            self.hub.set_status(true, &sentence());
        }
    }

    /// Reports the clients' connection counts at the end, if there were any.
    pub(crate) fn leave(self, reporter: &dyn Reporter, quiet: bool) {
        if let (Some(sentence), false) = (self.server.counts().sentence(), quiet) {
            reporter.say(&sentence);
        }
    }
}
