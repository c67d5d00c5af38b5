//! Runs a session: the configured devices through the pipeline, to its outputs.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use config::bedside::Bedside;
use console::Listen;
use pipeline::control::SessionController;

use super::app::LiveApp;
use super::browser;
use super::ended::Leave;
use super::foreign::refuse_example;
use super::home::Home;
use super::markers::Markers;
use super::options::{Operator, SessionOptions};
use super::reload::Reload;
use super::status_publisher::{StatusPublisher, policy};
use super::viewers::Viewers;
use crate::failure::Failure;

/// Checks the duration of a session.
///
/// # Errors
/// [`Failure`] for a duration out of range.
pub(crate) fn check_duration(duration: Option<f64>) -> Result<(), Failure> {
    match duration.filter(|seconds| !(0.1..=1e6).contains(seconds)) {
        Some(seconds) => Err(Failure::new(format!("--duration {seconds}: must be 0.1 to 1000000 seconds"))),
        None => Ok(()),
    }
}

/// Returns a flag that Ctrl-C or SIGTERM sets. A second signal ends the process at once: a disk
/// or a client that no longer responds can block the regular end.
///
/// # Errors
/// [`Failure`] when the system refuses the handlers.
pub(crate) fn quit_on_signal() -> Result<Arc<AtomicBool>, Failure> {
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
pub(crate) fn session(
    bedside: &Bedside,
    options: &SessionOptions,
    operator: &Operator<'_>,
    leave: Leave<'_>,
) -> Result<Option<PathBuf>, Failure> {
    refuse_example(bedside, options.accept_example, operator.reporter)?;
    let quit = quit_on_signal()?;
    let reload = Reload::new(bedside)?;
    let policy = policy(bedside)?;
    let listen = options.console.or(bedside.status.listen);
    let listen = listen.map(|address| Listen { address, access: bedside.status.access.clone() });
    let folder = options.record.as_ref().or(bedside.record.folder.as_ref());
    let controller = Arc::new(SessionController::new(options.keep.as_ref().or(folder).cloned()));
    let publisher = StatusPublisher::begin(bedside, listen, options.kind, &controller)?;
    let Operator { reporter, display, keeps_picture } = operator;
    if !options.quiet {
        policy.granted().why.iter().for_each(|why| reporter.say(why));
        publisher.address().iter().for_each(|address| reporter.say(&format!("console: {address}")));
    }
    if let Some(address) = publisher.address().filter(|_| options.opens_browser) {
        reporter.say(&browser::open(&address));
    }
    let igtl = options.sharing.begin(&bedside.igtl.allow, &quit, *reporter, options.quiet)?;
    igtl.iter().for_each(|igtl| igtl.control(&controller));
    let broadcaster = publisher.broadcaster();
    let markers = bedside.marker_line.as_ref().map(|line| Markers::open(line, &controller)).transpose()?;
    let viewers = Viewers::of(&bedside.picture, display.as_ref(), *keeps_picture, broadcaster.as_ref());
    let app = LiveApp {
        options,
        operator,
        quit,
        controller,
        policy,
        reload,
        publisher,
        igtl,
        viewers,
        home: Home::default(),
        markers,
        began: Instant::now(),
    };
    app.run(leave)
}
