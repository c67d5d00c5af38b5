//! `--igtl`: a session that other programs look at over OpenIGTLink.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;

use super::Failure;
use super::live::outputs::say;
use crate::igtl::{Commands, Hub, Server};
use crate::pipeline::live::{Reader, Session, Witness};

/// Between two looks at whether a session may begin.
const LOOK: Duration = Duration::from_millis(20);
/// Between two sentences of how it goes.
const TELL_EVERY: Duration = Duration::from_millis(500);

/// Flags of who looks on.
#[derive(Debug, Clone, Default, Args)]
pub(in crate::cli) struct Sharing {
    /// Shows slices, sensors and the volume over OpenIGTLink (3D Slicer, PLUS) at this address; whoever reaches it sees them. Without an address on this machine only
    #[arg(long, value_name = "ADDR:PORT", num_args = 0..=1, require_equals = true, default_missing_value = "127.0.0.1:18944")]
    igtl: Option<SocketAddr>,
    /// A folder for the volumes that clients of this machine save by the command save; it is made if it is not there [default: they may save none]
    #[arg(long, value_name = "DIR", requires = "igtl")]
    igtl_save: Option<PathBuf>,
    /// Begins only when a client of this machine sends the command start
    #[arg(long, requires = "igtl")]
    igtl_wait: bool,
}

/// A server of a session.
pub(in crate::cli) struct Shared {
    hub: Arc<Hub>,
    commands: Arc<Commands>,
    server: Server,
    told: Option<Instant>,
}

impl Sharing {
    /// Whether anything of it is asked for.
    pub(in crate::cli) fn is_wanted(&self) -> bool {
        self.igtl.is_some()
    }

    /// Serves from now on, where it is asked for, a session that ends by that flag.
    ///
    /// # Errors
    /// [`Failure`] when the address is taken.
    pub(in crate::cli) fn begin(&self, ends: &Arc<AtomicBool>, quiet: bool) -> Result<Option<Shared>, Failure> {
        let Some(address) = self.igtl else { return Ok(None) };
        let hub = Arc::new(Hub::new());
        let commands = Arc::new(Commands::new(Arc::clone(ends), self.igtl_save.clone(), self.igtl_wait));
        hub.tell(false, if self.igtl_wait { "waits for the command start" } else { "the session has not begun" });
        let server = Server::new(address, Arc::clone(&hub), Arc::clone(&commands))
            .map_err(|error| Failure(error.to_string()))?;
        if !quiet {
            say(&format!("OpenIGTLink at {}", server.address()));
            if !address.ip().is_loopback() {
                say("whoever reaches this address sees slices and volume; commands are taken from this machine only");
            }
        }
        let shared = Shared { hub, commands, server, told: None };
        while !shared.commands.may_start() && !ends.load(Ordering::Relaxed) {
            std::thread::sleep(LOOK);
        }
        Ok(Some(shared))
    }
}

impl Shared {
    /// Looks on at a session, and reads its volume.
    pub(in crate::cli) fn joins(&self, session: &mut Session) {
        session.witnesses.push(Arc::clone(&self.hub) as Arc<dyn Witness>);
        session.readers.push(Arc::clone(&self.hub) as Arc<dyn Reader>);
    }

    /// How it goes.
    pub(in crate::cli) fn tell(&mut self, sentence: impl FnOnce() -> String) {
        if self.told.is_none_or(|told| told.elapsed() >= TELL_EVERY) {
            self.told = Some(Instant::now());
            self.hub.tell(true, &sentence());
        }
    }

    /// What became of clients, where there were any.
    pub(in crate::cli) fn leave(self, quiet: bool) {
        if let (Some(sentence), false) = (self.server.counts().sentence(), quiet) {
            say(&sentence);
        }
    }
}
