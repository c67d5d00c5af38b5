//! Runs a session: the configured devices through the pipeline, to its outputs.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use config::bedside::Bedside;
use console::Listen;
use pipeline::control::SessionController;

use super::app::LiveApp;
pub(in crate::cli) use super::arguments::SessionArguments;
use super::foreign::refuse_example;
use super::home::Home;
use super::outputs::{Outputs, say};
use super::reload::Reload;
use super::status_publisher::{StatusPublisher, policy};
use super::terminal::Terminal;
use super::viewers::Viewers;
use crate::cli::Failure;

impl SessionArguments {
    fn kind(&self) -> &'static str {
        if self.demo { "demo" } else { "live" }
    }

    fn check(&self) -> Result<(), Failure> {
        check_duration(self.duration)
    }
}

/// Checks the duration of a session.
///
/// # Errors
/// [`Failure`] for a duration out of range.
pub(in crate::cli) fn check_duration(duration: Option<f64>) -> Result<(), Failure> {
    match duration.filter(|seconds| !(0.1..=1e6).contains(seconds)) {
        Some(seconds) => Err(Failure(format!("--duration {seconds}: must be 0.1 to 1000000 seconds"))),
        None => Ok(()),
    }
}

/// Returns a flag that Ctrl-C or SIGTERM sets. A second signal ends the process at once: a disk
/// or a client that no longer responds can block the regular end.
///
/// # Errors
/// [`Failure`] when the system refuses the handlers.
pub(in crate::cli) fn quit_on_signal() -> Result<Arc<AtomicBool>, Failure> {
    let ends = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        // Registered before the handler that sets the flag, so that the first signal does not
        // end the process.
        signal_hook::flag::register_conditional_shutdown(signal, 1, Arc::clone(&ends))?;
        signal_hook::flag::register(signal, Arc::clone(&ends))?;
    }
    Ok(ends)
}

/// Runs a session, and those that pages begin after it. Returns the path of the last recording,
/// if any.
///
/// # Errors
/// [`Failure`] when it cannot begin, or its outputs cannot be written.
pub(in crate::cli) fn session(
    bedside: &Bedside,
    arguments: &SessionArguments,
    outputs: &Outputs,
) -> Result<Option<PathBuf>, Failure> {
    arguments.check()?;
    outputs.check(bedside)?;
    bedside.calibrated().map_err(Failure::configuration)?;
    refuse_example(bedside, arguments.accept_example)?;
    let quit = quit_on_signal()?;
    let reload = Reload::new(bedside)?;
    let policy = policy(bedside)?;
    let listen = arguments.console.or(bedside.status.listen);
    let listen = listen.map(|address| Listen { address, access: bedside.status.access.clone() });
    let folder = arguments.record.as_ref().or(bedside.record.folder.as_ref());
    let controller = Arc::new(SessionController::new(arguments.keep.as_ref().or(folder).cloned()));
    let publisher = StatusPublisher::begin(bedside, listen, arguments.kind(), &controller)?;
    if !arguments.quiet {
        policy.granted().why.iter().for_each(|why| say(why));
        publisher.address().iter().for_each(|address| say(&format!("console: {address}")));
    }
    let igtl = arguments.sharing.begin(&bedside.igtl.allow, &quit, arguments.quiet)?;
    igtl.iter().for_each(|igtl| igtl.control(&controller));
    let terminal = if arguments.quiet || arguments.headless { None } else { Terminal::of(&bedside.picture) };
    let broadcaster = publisher.broadcaster();
    let viewers = Viewers::of(&bedside.picture, terminal.as_ref(), outputs.picture.is_some(), broadcaster.as_ref());
    let app = LiveApp {
        arguments,
        quit,
        controller,
        policy,
        reload,
        publisher,
        igtl,
        terminal,
        viewers,
        home: Home::default(),
        began: Instant::now(),
        printed: Instant::now(),
    };
    app.run(outputs)
}
