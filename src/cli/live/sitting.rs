//! Sessions at one bedside, one after the other: the first by the command line, the others by the pages that look on.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use drivers::clock::{Clock, Monotonic};
use drivers::simulated::Pty;

use super::home::Home;
use super::outputs::{Outputs, leave, line, say};
use super::reload::Reload;
use super::resume;
use super::session::Conduct;
use super::stages::{instruments, record, stages};
use super::telling::Telling;
use super::terminal::Terminal;
use super::viewers::Viewers;
use crate::cli::Failure;
use crate::cli::igtl::Shared;
use crate::config::bedside::Bedside;
use crate::desk::{Desk, How};
use crate::devices::{self, Devices};
use crate::pipeline::live::{
    Account, Bed, Cutter, Equipment, Held, Looks, Order, Reader, Recorded, Session, Standing, Witness, hold,
};

/// Between two lines on the way.
const SAID_EVERY: Duration = Duration::from_secs(2);

/// What outlasts a session, and who looks on.
pub(super) struct Sitting<'a> {
    pub(super) conduct: &'a Conduct,
    /// The program is told to end.
    pub(super) quit: Arc<AtomicBool>,
    pub(super) desk: Arc<Desk>,
    pub(super) standing: Standing,
    pub(super) reload: Reload,
    pub(super) telling: Telling,
    pub(super) shared: Option<Shared>,
    pub(super) terminal: Option<Arc<Terminal>>,
    pub(super) viewers: Option<Arc<Viewers>>,
    pub(super) home: Home,
    pub(super) began: Instant,
    pub(super) said: Instant,
}

/// What a session runs on, opened.
struct Made {
    bed: Bed,
    /// Virtual devices, which are played for as long as this is there.
    twins: Vec<Pty>,
    /// Of what its volume is made.
    input: String,
}

impl Sitting<'_> {
    /// Runs them; where the last one was recorded, if it was.
    ///
    /// # Errors
    /// [`Failure`] when the first cannot begin, one cannot go on, or what the last one leaves cannot be written.
    pub(super) fn run(mut self, outputs: &Outputs) -> Result<Option<PathBuf>, Failure> {
        let Conduct { record, resume, .. } = self.conduct;
        let bedside = self.reload.bedside().clone();
        let folder = record.clone().or_else(|| bedside.record.folder.clone());
        let resumed = resume.as_ref().map(|session| resume::open(session, &bedside)).transpose()?.unwrap_or_default();
        let mut made = self.open(&bedside, folder.as_deref(), resumed, resume.as_deref())?;
        loop {
            let bedside = self.reload.bedside().clone();
            let Made { bed, twins, input } = made;
            self.telling.weaves(&bedside)?;
            let stages = self.stages(&bedside)?;
            // Of the session before, nothing is in the volume.
            stages.witnesses.iter().for_each(|witness| witness.cleared());
            self.desk.runs(bed.record.is_some(), input);
            let desk = Arc::clone(&self.desk);
            let held = hold(&stages, bed, &Monotonic, desk.turns(), |account| self.watch(account))?;
            drop(twins);
            made = match self.next(&held)? {
                Some(next) => next,
                None => return self.leave(outputs, held),
            };
        }
    }

    /// How frames become a volume, and all who look on.
    fn stages(&self, bedside: &Bedside) -> Result<Session, Failure> {
        let looks = self.viewers.clone().map(|viewers| viewers as Arc<dyn Looks>);
        let mut stages = stages(bedside, looks)?;
        if let Some(screen) = self.telling.screen() {
            stages.cutter = Some(Arc::clone(&screen) as Arc<dyn Cutter>);
            stages.witnesses.push(screen as Arc<dyn Witness>);
            stages.witnesses.push(self.telling.slices() as Arc<dyn Witness>);
            stages.readers.push(Arc::clone(&self.desk) as Arc<dyn Reader>);
        }
        stages.witnesses.extend(self.telling.coach().map(|coach| coach as Arc<dyn Witness>));
        if let Some(shared) = &self.shared {
            shared.joins(&mut stages);
        }
        Ok(stages)
    }

    /// Opens the devices, and the recording where there is to be one. Devices that cannot be opened leave no session behind.
    fn open(
        &mut self,
        bedside: &Bedside,
        folder: Option<&Path>,
        resumed: Vec<Recorded>,
        goes_on_with: Option<&Path>,
    ) -> Result<Made, Failure> {
        let quiet = self.conduct.quiet;
        let [tracking_is, grabber_is] = instruments(bedside)?;
        let opened = devices::open(bedside, Monotonic.now_ns(), folder.is_some())?;
        let Devices { tracking, speech, at_home, grabber, twins } = opened;
        if let (Some(preset), Some(size)) = (&bedside.calibration.preset, grabber.describe().image_size) {
            preset.fits(Some(bedside.grabber.turned(size)), None)?;
        }
        let mut record = folder.map(|folder| record(bedside, folder)).transpose()?;
        if let Some(at_home) = at_home {
            self.home.listen(at_home, quiet)?;
        }
        if let (Some(record), false) = (&record, quiet) {
            self.print(&format!("recorded in {}", record.writer.path().display()));
        }
        if let (Some(record), Some(session)) = (&mut record, goes_on_with) {
            record.notes.push(resume::note(session)?);
        }
        let input = record.as_ref().map_or("devices, not recorded".into(), |record| {
            let path = record.writer.path();
            path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
        });
        let equipment = vec![
            Equipment { instrument: tracking_is, device: tracking, speech },
            Equipment { instrument: grabber_is, device: grabber, speech: None },
        ];
        let bed = Bed { equipment, record, resumed, standing: self.standing.clone() };
        Ok(Made { bed, twins, input })
    }

    /// Now and then: who looks on is told, and what they wish is ordered.
    fn watch(&mut self, account: &Account) -> Vec<Order> {
        let until = self.conduct.duration.map(Duration::from_secs_f64);
        if until.is_some_and(|until| self.began.elapsed() >= until) {
            self.quit.store(true, Ordering::Relaxed);
        }
        let quits = self.quit.load(Ordering::Relaxed);
        self.desk.goes_on(&account.world, quits);
        self.telling.look(account, line, quits);
        if let Some(shared) = &mut self.shared {
            shared.tell(|| line(account));
        }
        if let Some(terminal) = &self.terminal {
            terminal.say(&line(account));
        } else if !self.conduct.quiet && self.said.elapsed() >= SAID_EVERY {
            self.said = Instant::now();
            say(&line(account));
        }
        let mut orders = self.desk.orders();
        if self.reload.is_told() {
            self.telling.reloading();
            orders.extend(self.reload.orders(self.terminal.as_ref(), self.viewers.as_ref()));
            self.telling.reloaded(self.reload.bedside());
        }
        orders
    }

    /// What follows a session that is over, if pages want more of it: until then it is looked at.
    fn next(&mut self, held: &Held<'_>) -> Result<Option<Made>, Failure> {
        let desk = Arc::clone(&self.desk);
        if !desk.stopped() {
            return Ok(None);
        }
        self.telling.over(held.account());
        if let Some(recording) = held.recording() {
            desk.happened(How::Done, format!("the recording is complete: {}", recording.path.display()));
        }
        while !self.quit.load(Ordering::Relaxed) {
            let Some(next) = desk.opens() else {
                desk.is_over();
                held.linger(desk.turns(), |account| self.watch(account));
                continue;
            };
            self.reload.begins_anew();
            let bedside = self.reload.bedside().clone();
            let folder = if next.records { Some(desk.folder().map_err(Failure)?.to_owned()) } else { None };
            match self.open(&bedside, folder.as_deref(), Vec::new(), None) {
                Ok(made) => return Ok(Some(made)),
                Err(Failure(why)) => {
                    self.print(&why);
                    desk.happened(How::Failed, format!("no session begins: {why}"));
                }
            }
        }
        Ok(None)
    }

    /// Writes what was asked for.
    fn leave(self, outputs: &Outputs, held: Held<'_>) -> Result<Option<PathBuf>, Failure> {
        let finished = held.finish();
        if let Some(shared) = self.shared {
            shared.leave(self.conduct.quiet);
        }
        if let Some(terminal) = &self.terminal {
            terminal.leave();
        }
        leave(self.reload.bedside(), outputs, &finished, self.began.elapsed(), None, None)?;
        Ok(finished.recording.map(|recording| recording.path))
    }

    /// A line for people, beside the picture in the terminal.
    fn print(&self, words: &str) {
        match &self.terminal {
            Some(terminal) => terminal.print(&format!("sonoweave: {words}")),
            None => say(words),
        }
    }
}
