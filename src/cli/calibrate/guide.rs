//! `--live`: devices are recorded while whoever holds the probe is told what to do, how much is missing, and when it is enough.
//!
//! What is calibrated is the recording, by the same way as one that was made before: the guide decides nothing but when to stop.

pub mod poses;

use std::io::{IsTerminal as _, stderr};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use clap::Args;
use drivers::clock::{Clock as _, Monotonic};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::super::live::outputs::{say, troubles};
use super::super::live::session::{check_duration, until_told};
use super::super::live::stages::record_of;
use super::super::live::{home::Home, telling};
use super::super::{Failure, values};
use super::recorded::GRABBER;
use crate::config::bedside::Bedside;
use crate::devices::{self, Devices};
use crate::ingest::live::Live;
use crate::pipeline::live::{Account, Bed, Equipment, Heard, Instrument, gather};

/// Between two judgements at least, …
const JUDGED_EVERY: Duration = Duration::from_millis(500);
/// … and as many times as long as one takes: what comes in meanwhile must not wait.
const BREATH: u32 = 4;
/// Between two lines where there is no terminal.
const SAID_EVERY: Duration = Duration::from_secs(2);
/// Steps of the bar.
const STEPS: f64 = 1000.0;

/// How a recording is made that is still to be made.
#[derive(Debug, Clone, Default, Args)]
pub struct Gathering {
    /// With --live, the folder for the recording [default: the bedside's, else this one]
    #[arg(long, value_name = "DIR")]
    record: Option<PathBuf>,
    /// With --live, ends after so many seconds, enough or not [default: when it is enough, or by Ctrl-C]
    #[arg(long, value_name = "S", value_parser = values::positive)]
    duration: Option<f64>,
}

impl Gathering {
    /// The bedside whose devices are to be recorded, if that is asked for.
    ///
    /// # Errors
    /// [`Failure`] for flags that nothing is recorded for, and for a time that no session lasts. The parser does not say it: what --live excludes excuses its absence.
    pub fn of<'a>(&self, live: Option<&'a PathBuf>) -> Result<Option<&'a PathBuf>, Failure> {
        let needless = [("--record", self.record.is_some()), ("--duration", self.duration.is_some())];
        if let Some((flag, _)) = needless.into_iter().find(|(_, is_given)| live.is_none() && *is_given) {
            return Err(Failure(format!("{flag}: is of --live BEDSIDE.toml, which is not there")));
        }
        check_duration(self.duration)?;
        Ok(live)
    }
}

/// What to do now.
#[derive(Debug, Clone, PartialEq)]
pub struct Advice {
    /// A sentence.
    pub says: String,
    /// How much there is of what is needed, 0 to 1; 1 is enough.
    pub share: f64,
    /// What was recorded before this is to be left out, s from the recording's beginning.
    pub from_s: Option<f64>,
}

impl Advice {
    /// That something is missing.
    pub fn missing(says: impl Into<String>) -> Self {
        Self { says: says.into(), share: 0.0, from_s: None }
    }

    /// So much of it is there.
    pub fn at(share: f64, says: impl Into<String>) -> Self {
        Self { says: says.into(), share, from_s: None }
    }
}

/// Who knows what is needed.
pub trait Guide {
    /// A sample of a device has come: of the first, which carries the probe, or of the second, the grabber.
    fn hear(&mut self, device: usize, live: Live);
    /// What to do next, by all that was heard.
    fn advise(&mut self) -> Advice;
}

/// A recording that was made, and from when on it counts.
pub struct Gathered {
    /// The session.
    pub session: PathBuf,
    /// s from its beginning; all of it without.
    pub from_s: Option<f64>,
}

/// Records the devices of a bedside until the guide has enough, Ctrl-C, or the time is over: those of its instruments that are asked for, of which what carries the probe is the first.
///
/// # Errors
/// [`Failure`] when the devices cannot be opened or nothing can be recorded.
pub fn lead<G: Guide>(
    path: &Path,
    conduct: &Gathering,
    begin: impl FnOnce(&Bedside) -> Result<(G, Vec<Instrument>), Failure>,
) -> Result<Gathered, Failure> {
    let bedside = Bedside::read(path)?;
    let (mut guide, instruments) = begin(&bedside)?;
    let here = PathBuf::from(".");
    let folder = conduct.record.as_ref().or(bedside.record.folder.as_ref()).unwrap_or(&here);
    let ends = until_told()?;
    let standing = telling::standing(&bedside)?;
    let Devices { tracking, speech, at_home, grabber, twins } = devices::open(&bedside, Monotonic.now_ns(), true)?;
    let record = record_of(&bedside, folder, instruments.len() > GRABBER)?;
    if let Some(at_home) = at_home {
        Home::default().listen(at_home, false)?;
    }
    say(&format!("recorded in {}; Ctrl-C ends it and calibrates by what there is", record.writer.path().display()));
    let opened = [(tracking, speech), (grabber, None)];
    let equipment = instruments.into_iter().zip(opened);
    let equipment: Vec<Equipment> =
        equipment.map(|(instrument, (device, speech))| Equipment { instrument, device, speech }).collect();
    let bed = Bed { equipment, record: Some(record), resumed: Vec::new(), standing };
    let (began, mut screen) = (Instant::now(), Screen::new());
    let (mut judged, mut took) = (Instant::now(), Duration::ZERO);
    let mut last = Advice::missing("waiting for the devices");
    let (recording, account) = gather(bed, bedside.mask, &Monotonic, &ends, |heard| match heard {
        Heard::Sample(device, live) => guide.hear(device, live),
        Heard::Turn(account) => {
            if judged.elapsed() >= JUDGED_EVERY.max(BREATH * took) {
                let start = Instant::now();
                last = guide.advise();
                (took, judged) = (start.elapsed(), Instant::now());
                screen.show(&last, account);
            }
            if last.share >= 1.0 || conduct.duration.is_some_and(|s| began.elapsed() >= Duration::from_secs_f64(s)) {
                ends.store(true, Ordering::Relaxed);
            }
        }
    })?;
    drop(twins);
    screen.end(&last);
    let Some(recording) = recording else { return Err(Failure("nothing was recorded".into())) };
    account.notes.iter().for_each(|note| say(note));
    let lost = recording.lost.total() + recording.after_end.total();
    if lost > 0 {
        say(&format!(
            "{lost} messages were not recorded, for want of time or room on the disk; so far as they were poses or pictures, they are missing"
        ));
    }
    Ok(Gathered { session: recording.path, from_s: last.from_s })
}

/// Where the advice is shown: one place in a terminal, lines elsewhere.
struct Screen {
    bar: Option<ProgressBar>,
    said: Option<(String, Instant)>,
}

impl Screen {
    fn new() -> Self {
        let bar = stderr().is_terminal().then(|| {
            let bar = ProgressBar::with_draw_target(Some(STEPS as u64), ProgressDrawTarget::stderr());
            if let Ok(style) = ProgressStyle::with_template("{wide_bar} {percent:>3}%\n{wide_msg}") {
                bar.set_style(style);
            }
            bar
        });
        Self { bar, said: None }
    }

    fn show(&mut self, advice: &Advice, account: &Account) {
        let text = advice.says.clone() + &troubles(account);
        if let Some(bar) = &self.bar {
            bar.set_position((advice.share.clamp(0.0, 1.0) * STEPS) as u64);
            bar.set_message(text);
            return;
        }
        let is_due = |(said, at): &(String, Instant)| *said != text && at.elapsed() >= SAID_EVERY;
        if self.said.as_ref().is_none_or(is_due) {
            say(&format!("{:3.0} %: {text}", 100.0 * advice.share.clamp(0.0, 1.0)));
            self.said = Some((text, Instant::now()));
        }
    }

    fn end(&self, last: &Advice) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
        say(&if last.share >= 1.0 { format!("enough: {}", last.says) } else { format!("ended: {}", last.says) });
    }
}
