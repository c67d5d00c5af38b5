//! `--live`: records the devices while it guides the operator: next step, progress, and end.
//!
//! The recording is calibrated in the same way as an earlier recording. The guide only decides
//! when to stop.

mod options;
pub mod poses;

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use config::bedside::Bedside;
use pipeline::session::{DeviceRole, RecordEvent, SessionDevice, SessionStatus, record_only};
use sonoweave_core::clock::{Clock as _, Monotonic};
use sync::ingest::live::Live;

use super::recorded::GRABBER;
use crate::app::devices::{self, Devices};
use crate::app::live::home::Home;
use crate::app::live::session::quit_on_signal;
use crate::app::live::stages::record_of;
use crate::app::live::status_publisher;
use crate::failure::Failure;
pub use options::Gathering;

/// Shortest time between two evaluations.
const ADVISED_EVERY: Duration = Duration::from_millis(500);
/// Shortest pause between evaluations, as a multiple of the last one's duration. Incoming
/// samples must not wait.
const PAUSE: u32 = 4;

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

/// Outlet to the operator of a calibration.
pub trait Advisor {
    /// Says a sentence.
    fn say(&self, sentence: &str);
    /// Shows advice, together with the devices' problems.
    fn show(&mut self, advice: &Advice, status: &SessionStatus);
    /// Shows the last advice for good.
    fn end(&mut self, last: &Advice);
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
    advisor: &mut dyn Advisor,
    begin: impl FnOnce(&Bedside) -> Result<(G, Vec<DeviceRole>), Failure>,
) -> Result<Gathered, Failure> {
    let bedside = Bedside::read(path).map_err(Failure::configuration)?;
    let (mut guide, roles) = begin(&bedside)?;
    let here = PathBuf::from(".");
    let folder = gathering.record.as_ref().or(bedside.record.folder.as_ref()).unwrap_or(&here);
    let ends = quit_on_signal()?;
    let policy = status_publisher::policy(&bedside)?;
    let Devices { tracking, protocol, at_home, grabber } = devices::open(&bedside, Monotonic.now_ns(), true)?;
    let record = record_of(&bedside, folder, roles.len() > GRABBER)?;
    if let Some(at_home) = at_home {
        Home::default().listen(at_home, |how| advisor.say(how))?;
    }
    advisor.say(&format!(
        "recorded in {}; Ctrl-C ends the recording and calibrates with the present data",
        record.writer.path().display()
    ));
    let opened = [(tracking, protocol), (grabber, None)];
    let opened = roles.into_iter().zip(opened);
    let devices: Vec<SessionDevice> =
        opened.map(|(role, (device, protocol))| SessionDevice { role, device, protocol }).collect();
    let began = Instant::now();
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
                    advisor.show(&last, account);
                }
                if last.share >= 1.0
                    || gathering.duration.is_some_and(|s| began.elapsed() >= Duration::from_secs_f64(s))
                {
                    ends.store(true, Ordering::Relaxed);
                }
            }
        })?;
    advisor.end(&last);
    let Some(recording) = recording else { return Err(Failure::new("nothing was recorded; begin again")) };
    account.notes.iter().for_each(|note| advisor.say(note));
    let lost = recording.lost.total() + recording.after_end.total();
    if lost > 0 {
        advisor.say(&format!(
            "{lost} messages were not recorded, for lack of time or disk space; their poses and frames are missing"
        ));
    }
    Ok(Gathered { session: recording.path, from_s: last.from_s })
}
