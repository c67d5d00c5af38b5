//! `--live`: records the devices while it guides the operator: next step, progress, and end.
//!
//! The recording is calibrated in the same way as an earlier recording. The guide only decides
//! when to stop.

pub mod poses;

use std::io::{IsTerminal as _, stderr};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use config::bedside::Bedside;
use pipeline::session::{DeviceRole, RecordEvent, SessionDevice, SessionStatus, record_only};
use sonoweave_core::clock::{Clock as _, Monotonic};
use sync::ingest::live::Live;

use super::super::live::outputs::{say, troubles};
use super::super::live::session::{check_duration, quit_on_signal};
use super::super::live::stages::record_of;
use super::super::live::{home::Home, status_publisher};
use super::super::{Failure, values};
use super::recorded::GRABBER;
use crate::devices::{self, Devices};

/// Shortest time between two evaluations.
const ADVISED_EVERY: Duration = Duration::from_millis(500);
/// Shortest pause between evaluations, as a multiple of the last one's duration. Incoming
/// samples must not wait.
const PAUSE: u32 = 4;
/// Time between two lines of output without a terminal.
const PRINTED_EVERY: Duration = Duration::from_secs(2);
/// Steps of the progress bar.
const STEPS: f64 = 1000.0;

/// Flags for a recording that is made now.
#[derive(Debug, Clone, Default, Args)]
pub struct Gathering {
    /// Write the recording of --live to this folder [default: the configuration's, else the
    /// current one]
    #[arg(long, value_name = "DIR")]
    record: Option<PathBuf>,
    /// End --live after so many seconds, enough or not [default: when it is enough, or by
    /// Ctrl-C]
    #[arg(long, value_name = "S", value_parser = values::positive)]
    duration: Option<f64>,
}

impl Gathering {
    /// Returns the session configuration whose devices are to be recorded, if requested.
    ///
    /// # Errors
    /// [`Failure`] for flags without a recording, and for a duration that no session lasts. The
    /// parser cannot report the former: an argument excluded by --live satisfies its
    /// requirement.
    pub fn of<'a>(&self, live: Option<&'a PathBuf>) -> Result<Option<&'a PathBuf>, Failure> {
        let needless = [("--record", self.record.is_some()), ("--duration", self.duration.is_some())];
        if let Some((flag, _)) = needless.into_iter().find(|(_, is_given)| live.is_none() && *is_given) {
            fail!("{flag}: applies to --live BEDSIDE.toml only; give it, too");
        }
        check_duration(self.duration)?;
        Ok(live)
    }
}

/// Advice to the operator.
#[derive(Debug, Clone, PartialEq)]
pub struct Advice {
    /// A sentence.
    pub message: String,
    /// Progress towards the goal, 0 to 1; 1 is enough.
    pub share: f64,
    /// Samples before this are to be left out, s from the recording's beginning.
    pub from_s: Option<f64>,
}

impl Advice {
    /// Advice that something is missing, at progress 0.
    pub fn missing(message: impl Into<String>) -> Self {
        Self { message: message.into(), share: 0.0, from_s: None }
    }

    /// Advice at the given progress.
    pub fn at(share: f64, message: impl Into<String>) -> Self {
        Self { message: message.into(), share, from_s: None }
    }
}

/// Evaluates the samples of one kind of calibration.
pub trait Guide {
    /// Takes a sample of a device. Device 0 is the tracker or the arm, device 1 the grabber.
    fn add(&mut self, device: usize, live: Live);
    /// Returns the next advice, from all samples so far.
    fn advise(&mut self) -> Advice;
}

/// A finished recording, and the part of it that counts.
pub struct Gathered {
    /// The session's file.
    pub session: PathBuf,
    /// Start of the part that counts, s from the session's beginning; `None` for all of it.
    pub from_s: Option<f64>,
}

/// Records a session's devices until the guide has enough, Ctrl-C is pressed, or the time is
/// over. Only the roles that `begin` returns are recorded; the first of them carries the
/// probe.
///
/// # Errors
/// [`Failure`] when the devices cannot be opened or nothing can be recorded.
pub fn lead<G: Guide>(
    path: &Path,
    gathering: &Gathering,
    begin: impl FnOnce(&Bedside) -> Result<(G, Vec<DeviceRole>), Failure>,
) -> Result<Gathered, Failure> {
    let bedside = Bedside::read(path).map_err(Failure::configuration)?;
    let (mut guide, roles) = begin(&bedside)?;
    let here = PathBuf::from(".");
    let folder = gathering.record.as_ref().or(bedside.record.folder.as_ref()).unwrap_or(&here);
    let ends = quit_on_signal()?;
    let policy = status_publisher::policy(&bedside)?;
    let Devices { tracking, protocol, at_home, grabber, twins } = devices::open(&bedside, Monotonic.now_ns(), true)?;
    let record = record_of(&bedside, folder, roles.len() > GRABBER)?;
    if let Some(at_home) = at_home {
        Home::default().listen(at_home, false)?;
    }
    say(&format!(
        "recorded in {}; Ctrl-C ends the recording and calibrates with the present data",
        record.writer.path().display()
    ));
    let opened = [(tracking, protocol), (grabber, None)];
    let opened = roles.into_iter().zip(opened);
    let devices: Vec<SessionDevice> =
        opened.map(|(role, (device, protocol))| SessionDevice { role, device, protocol }).collect();
    let (began, mut display) = (Instant::now(), AdviceDisplay::new());
    let (mut advised, mut took) = (Instant::now(), Duration::ZERO);
    let mut last = Advice::missing("waiting for the devices");
    let (recording, account) =
        record_only(devices, Some(record), &policy, bedside.mask, &Monotonic, &ends, |event| match event {
            RecordEvent::Sample(device, live) => guide.add(device, live),
            RecordEvent::Turn(account) => {
                if advised.elapsed() >= ADVISED_EVERY.max(PAUSE * took) {
                    let start = Instant::now();
                    last = guide.advise();
                    (took, advised) = (start.elapsed(), Instant::now());
                    display.show(&last, account);
                }
                if last.share >= 1.0
                    || gathering.duration.is_some_and(|s| began.elapsed() >= Duration::from_secs_f64(s))
                {
                    ends.store(true, Ordering::Relaxed);
                }
            }
        })?;
    drop(twins);
    display.end(&last);
    let Some(recording) = recording else { return Err(Failure("nothing was recorded".into())) };
    account.notes.iter().for_each(|note| say(note));
    let lost = recording.lost.total() + recording.after_end.total();
    if lost > 0 {
        say(&format!(
            "{lost} messages were not recorded, for lack of time or disk space; their poses and frames are missing"
        ));
    }
    Ok(Gathered { session: recording.path, from_s: last.from_s })
}

/// Output of the advice: a progress bar in a terminal, lines elsewhere.
struct AdviceDisplay {
    bar: Option<ProgressBar>,
    printed: Option<(String, Instant)>,
}

impl AdviceDisplay {
    fn new() -> Self {
        let bar = stderr().is_terminal().then(|| {
            let bar = ProgressBar::with_draw_target(Some(STEPS as u64), ProgressDrawTarget::stderr());
            if let Ok(style) = ProgressStyle::with_template("{wide_bar} {percent:>3}%\n{wide_msg}") {
                bar.set_style(style);
            }
            bar
        });
        Self { bar, printed: None }
    }

    fn show(&mut self, advice: &Advice, account: &SessionStatus) {
        let text = advice.message.clone() + &troubles(account);
        if let Some(bar) = &self.bar {
            bar.set_position((advice.share.clamp(0.0, 1.0) * STEPS) as u64);
            bar.set_message(text);
            return;
        }
        let is_due = |(printed, at): &(String, Instant)| *printed != text && at.elapsed() >= PRINTED_EVERY;
        if self.printed.as_ref().is_none_or(is_due) {
            say(&format!("{:3.0} %: {text}", 100.0 * advice.share.clamp(0.0, 1.0)));
            self.printed = Some((text, Instant::now()));
        }
    }

    fn end(&self, last: &Advice) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
        say(&if last.share >= 1.0 { format!("enough: {}", last.message) } else { format!("ended: {}", last.message) });
    }
}
