//! `--igtl`: serves a session to other programs over OpenIGTLink.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use ipnet::IpNet;

use igtl::{ClientNumbers, Commands, Hub, IgtlError, Server};
use pipeline::Observer;
use pipeline::control::SessionController;
use pipeline::session::{Reader, Session};
use statistics::IgtlNumbers;

use super::live::outputs::say;
use super::{Failure, values};

/// Polling interval for the start of a session.
const POLL: Duration = Duration::from_millis(20);
/// Time between two status sentences.
const STATUS_EVERY: Duration = Duration::from_millis(500);

/// Flags of the OpenIGTLink server.
#[derive(Debug, Clone, Default, Args)]
pub(in crate::cli) struct Sharing {
    /// Serve slices, sensors and the volume over OpenIGTLink (3D Slicer, PLUS) at this address.
    /// Other machines need an allowed network. Without an address: on this machine only
    #[arg(long, value_name = "ADDR:PORT", num_args = 0..=1, require_equals = true, default_missing_value = "127.0.0.1:18944")]
    igtl: Option<SocketAddr>,
    /// Networks of other machines that may connect and see the data, such as 192.168.0.0/24,
    /// besides those that the configuration of live lists [default: none]
    #[arg(long, value_name = "NETWORK", requires = "igtl", value_delimiter = ',', value_parser = values::network)]
    igtl_allow: Vec<IpNet>,
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
    /// Networks of the flag.
    of_flag: Vec<IpNet>,
    /// Time of the last status sentence.
    sent: Option<Instant>,
}

impl Sharing {
    /// Whether the server is requested.
    pub(in crate::cli) fn is_requested(&self) -> bool {
        self.igtl.is_some()
    }

    /// Starts the server, if requested, for this machine, the `configured` networks and those of
    /// the flag. The session ends by the flag `ends`.
    ///
    /// # Errors
    /// [`Failure`] when the address is taken, or reachable without an allowed network.
    pub(in crate::cli) fn begin(
        &self,
        configured: &[IpNet],
        ends: &Arc<AtomicBool>,
        quiet: bool,
    ) -> Result<Option<IgtlServer>, Failure> {
        let Some(address) = self.igtl else { return Ok(None) };
        let hub = Arc::new(Hub::new());
        let commands = Arc::new(Commands::new(Arc::clone(ends), self.igtl_save.clone(), self.igtl_wait));
        hub.set_status(false, if self.igtl_wait { "waits for the command start" } else { "the session has not begun" });
        let allowed = [configured, &self.igtl_allow].concat();
        let server = Server::new(address, allowed.clone(), Arc::clone(&hub), Arc::clone(&commands)).map_err(refused)?;
        if !quiet {
            say(&format!("OpenIGTLink at {}", server.address()));
            if !allowed.is_empty() {
                let networks: Vec<String> = allowed.iter().map(IpNet::to_string).collect();
                say(&format!(
                    "clients in {} see slices and volume; only clients on this machine can send commands",
                    networks.join(", ")
                ));
            }
        }
        let shared = IgtlServer { hub, commands, server, of_flag: self.igtl_allow.clone(), sent: None };
        while !shared.commands.may_start() && !ends.load(Ordering::Relaxed) {
            std::thread::sleep(POLL);
        }
        Ok(Some(shared))
    }
}

/// Adds the flag that allows networks.
fn refused(error: IgtlError) -> Failure {
    let flag = if matches!(error, IgtlError::NoNetwork { .. }) { "; --igtl-allow lists them, too" } else { "" };
    Failure(format!("--igtl: {error}{flag}"))
}

impl IgtlServer {
    /// Allows the configured networks, besides those of the flag, from now on.
    pub(in crate::cli) fn allow(&self, configured: &[IpNet]) {
        self.server.allow(&[configured, &self.of_flag].concat());
    }

    /// Returns the numbers of clients.
    pub(in crate::cli) fn numbers(&self) -> IgtlNumbers {
        let ClientNumbers { served, not_allowed, turned_away, cut_off, too_many, nonsense, replaced } =
            self.server.counts().numbers();
        IgtlNumbers { served, not_allowed, turned_away, cut_off, too_many, nonsense, replaced }
    }

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
        if let (Some(sentence), false) = (self.server.counts().numbers().sentence(), quiet) {
            say(&sentence);
        }
    }
}
