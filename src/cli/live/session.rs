//! A session: the bedside's devices through the pipeline, and what is left of it.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use drivers::clock::{Clock, Monotonic};

use super::home;
use super::outputs::{Outputs, leave, line, say};
use super::reload::Reload;
use super::resume;
use super::stages::{instruments, record, stages};
use super::telling::{Telling, standing};
use super::terminal::Terminal;
use super::viewers::Viewers;
use crate::cli::igtl::Sharing;
use crate::cli::{Failure, values};
use crate::config::bedside::Bedside;
use crate::devices::{self, Devices};
use crate::pipeline::live::{Bed, Equipment, Looks, Witness, run};

/// Between two lines on the way.
const SAID_EVERY: Duration = Duration::from_secs(2);

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
    /// Shows the session to browsers on this machine: the page with its picture and its volume, and the status [default: the configuration's status.listen, or nowhere]
    #[arg(long, value_name = "ADDR:PORT", value_parser = values::loopback)]
    pub(in crate::cli) console: Option<SocketAddr>,
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

/// Runs a session; where it was recorded, if it was.
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
    let ends = until_told()?;
    let mut reload = Reload::new(bedside)?;
    let standing = standing(bedside)?;
    let listen = conduct.console.or(bedside.status.listen);
    let mut telling = Telling::begin(bedside, listen, conduct.kind())?;
    if !conduct.quiet {
        standing.granted().why.iter().for_each(|why| say(why));
        telling.address().iter().for_each(|address| say(&format!("console: {address}")));
    }
    let mut shared = conduct.sharing.begin(&ends, conduct.quiet)?;
    let folder = conduct.record.as_ref().or(bedside.record.folder.as_ref());
    let resumed =
        conduct.resume.as_ref().map(|session| resume::open(session, bedside)).transpose()?.unwrap_or_default();
    let [tracking_is, grabber_is] = instruments(bedside)?;
    let opened = devices::open(bedside, Monotonic.now_ns(), folder.is_some())?;
    let Devices { tracking, speech, at_home, grabber, twins } = opened;
    if let (Some(preset), Some(size)) = (&bedside.calibration.preset, grabber.describe().image_size) {
        preset.fits(Some(bedside.grabber.turned(size)), None)?;
    }
    // Devices that cannot be opened leave no session behind.
    let mut record = folder.map(|folder| record(bedside, folder)).transpose()?;
    if let Some(at_home) = at_home {
        home::listen(at_home, conduct.quiet)?;
    }
    if let (Some(record), false) = (&record, conduct.quiet) {
        say(&format!("recorded in {}", record.writer.path().display()));
    }
    if let (Some(record), Some(session)) = (&mut record, &conduct.resume) {
        record.notes.push(resume::note(session)?);
    }
    let equipment = vec![
        Equipment { instrument: tracking_is, device: tracking, speech },
        Equipment { instrument: grabber_is, device: grabber, speech: None },
    ];
    let bed = Bed { equipment, record, resumed, standing };
    let terminal = if conduct.quiet || conduct.headless { None } else { Terminal::of(&bedside.picture) };
    let screen = telling.screen();
    let viewers = Viewers::of(&bedside.picture, terminal.as_ref(), outputs.picture.is_some(), screen.as_ref());
    let looks = viewers.clone().map(|viewers| viewers as Arc<dyn Looks>);
    let (began, mut said) = (Instant::now(), Instant::now());
    let mut stages = stages(bedside, looks)?;
    stages.witnesses.extend(screen.map(|screen| screen as Arc<dyn Witness>));
    stages.witnesses.extend(telling.coach().map(|coach| coach as Arc<dyn Witness>));
    if let Some(shared) = &shared {
        shared.joins(&mut stages);
    }
    let finished = run(&stages, bed, &Monotonic, &ends, |account| {
        if conduct.duration.is_some_and(|seconds| began.elapsed() >= Duration::from_secs_f64(seconds)) {
            ends.store(true, Ordering::Relaxed);
        }
        telling.look(account, line, ends.load(Ordering::Relaxed));
        if let Some(shared) = &mut shared {
            shared.tell(|| line(account));
        }
        if let Some(terminal) = &terminal {
            terminal.say(&line(account));
        } else if !conduct.quiet && said.elapsed() >= SAID_EVERY {
            said = Instant::now();
            say(&line(account));
        }
        if !reload.is_told() {
            return Vec::new();
        }
        telling.reloading();
        let orders = reload.orders(terminal.as_ref(), viewers.as_ref());
        telling.reloaded(reload.bedside());
        orders
    })?;
    drop(twins);
    if let Some(shared) = shared {
        shared.leave(conduct.quiet);
    }
    if let Some(terminal) = &terminal {
        terminal.leave();
    }
    leave(reload.bedside(), outputs, &finished, began.elapsed(), None, None)?;
    Ok(finished.recording.map(|recording| recording.path))
}
