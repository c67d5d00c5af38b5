//! A session: the bedside's devices through the pipeline, and what is left of it.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use clap::Args;

use super::home::Home;
use super::outputs::{Outputs, say};
use super::reload::Reload;
use super::sitting::Sitting;
use super::telling::{Telling, standing};
use super::terminal::Terminal;
use super::viewers::Viewers;
use crate::cli::igtl::Sharing;
use crate::cli::{Failure, values};
use crate::config::bedside::Bedside;
use crate::console::Listen;
use crate::desk::Desk;

/// How a session goes.
#[derive(Debug, Clone, Default, Args)]
pub(in crate::cli) struct Conduct {
    /// A folder to record the session in; it is made if it is not there [default: the configuration's, or nowhere]
    #[arg(long, value_name = "DIR")]
    pub(in crate::cli) record: Option<PathBuf>,
    /// Ends the session after so many seconds [default: when it is told to end, by Ctrl-C or SIGTERM]
    #[arg(long, value_name = "S")]
    pub(in crate::cli) duration: Option<f64>,
    /// Goes on with a recorded session, as after a crash: its slices are in the volume first. The configuration must be the one that it was recorded by
    #[arg(long, value_name = "SESSION")]
    pub(in crate::cli) resume: Option<PathBuf>,
    /// Shows the session to browsers: the page with its picture and its volume, and the status; beyond this machine only with certificate, key and token_file under status [default: the configuration's status.listen, or nowhere]
    #[arg(long, value_name = "ADDR:PORT", value_parser = values::address)]
    pub(in crate::cli) console: Option<SocketAddr>,
    /// A folder for what pages record, save and keep; it is made if it is not there [default: where the session is recorded, or nowhere]
    #[arg(long, value_name = "DIR")]
    pub(in crate::cli) keep: Option<PathBuf>,
    /// Says nothing on the way
    #[arg(long)]
    pub(in crate::cli) quiet: bool,
    /// Does not show the volume in the terminal, but says how it goes
    #[arg(long)]
    pub(in crate::cli) headless: bool,
    /// Of the virtual bedside that comes with the program
    #[arg(skip)]
    pub(in crate::cli) demo: bool,
    #[command(flatten)]
    pub(in crate::cli) sharing: Sharing,
}

impl Conduct {
    fn kind(&self) -> &'static str {
        if self.demo { "demo" } else { "live" }
    }

    fn check(&self) -> Result<(), Failure> {
        check_duration(self.duration)
    }
}

/// A time that a session may last.
///
/// # Errors
/// [`Failure`] for one that it may not.
pub(in crate::cli) fn check_duration(duration: Option<f64>) -> Result<(), Failure> {
    match duration.filter(|seconds| !(0.1..=1e6).contains(seconds)) {
        Some(seconds) => Err(Failure(format!("--duration {seconds}: must be 0.1 to 1000000 seconds"))),
        None => Ok(()),
    }
}

/// Told to end by Ctrl-C or SIGTERM. Told again, the process ends at once: a disk that no longer answers, or who looks and does not, can hold up the end of a session for good.
///
/// # Errors
/// [`Failure`] when the system takes no handler.
pub(in crate::cli) fn until_told() -> Result<Arc<AtomicBool>, Failure> {
    let ends = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        // Before the other, which is the one that says that it was told once.
        signal_hook::flag::register_conditional_shutdown(signal, 1, Arc::clone(&ends))?;
        signal_hook::flag::register(signal, Arc::clone(&ends))?;
    }
    Ok(ends)
}

/// Runs a session, and those that pages begin after it; where the last one was recorded, if it was.
///
/// # Errors
/// [`Failure`] when it cannot begin, or what it leaves cannot be written.
pub(in crate::cli) fn session(
    bedside: &Bedside,
    conduct: &Conduct,
    outputs: &Outputs,
) -> Result<Option<PathBuf>, Failure> {
    conduct.check()?;
    outputs.check(bedside)?;
    bedside.calibrated()?;
    let quit = until_told()?;
    let reload = Reload::new(bedside)?;
    let standing = standing(bedside)?;
    let listen = conduct.console.or(bedside.status.listen);
    let listen = listen.map(|address| Listen { address, access: bedside.status.access.clone() });
    let folder = conduct.record.as_ref().or(bedside.record.folder.as_ref());
    let desk = Arc::new(Desk::new(conduct.keep.as_ref().or(folder).cloned()));
    let telling = Telling::begin(bedside, listen, conduct.kind(), &desk)?;
    if !conduct.quiet {
        standing.granted().why.iter().for_each(|why| say(why));
        telling.address().iter().for_each(|address| say(&format!("console: {address}")));
    }
    let shared = conduct.sharing.begin(&quit, conduct.quiet)?;
    let terminal = if conduct.quiet || conduct.headless { None } else { Terminal::of(&bedside.picture) };
    let screen = telling.screen();
    let viewers = Viewers::of(&bedside.picture, terminal.as_ref(), outputs.picture.is_some(), screen.as_ref());
    let sitting = Sitting {
        conduct,
        quit,
        desk,
        standing,
        reload,
        telling,
        shared,
        terminal,
        viewers,
        home: Home::default(),
        began: Instant::now(),
        said: Instant::now(),
    };
    sitting.run(outputs)
}
