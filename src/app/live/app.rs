//! The live application: runs sessions one after the other. The command line begins the first,
//! pages begin the others.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use config::bedside::Bedside;
use pipeline::Observer;
use pipeline::command::{Command, Instruction};
use pipeline::control::{Progress, SessionController};
use pipeline::session::{
    BrickViewer, EndedSession, PlaneViewer, Reader, Recorded, SchedulingPolicy, Session, SessionDevice, SessionInputs,
    SessionStatus, Source, ViewClient,
};
use sonoweave_core::clock::{Clock, Monotonic};

use super::crossings_check;
use super::ended::{Ended, Leave};
use super::foreign::{refuse_example, refuse_size};
use super::home::Home;
use super::markers::Markers;
use super::options::{Operator, SessionOptions};
use super::outputs::line;
use super::reload::Reload;
use super::resume;
use super::stages::{record, roles, stages};
use super::status_publisher::StatusPublisher;
use super::viewers::Viewers;
use crate::app::devices::{self, Devices};
use crate::app::igtl::IgtlServer;
use crate::failure::{Failure, Reason};

/// State that outlasts a session, and the observers.
pub(super) struct LiveApp<'a> {
    pub(super) options: &'a SessionOptions,
    pub(super) operator: &'a Operator<'a>,
    /// Set when the program is to end.
    pub(super) quit: Arc<AtomicBool>,
    pub(super) controller: Arc<SessionController>,
    pub(super) policy: SchedulingPolicy,
    pub(super) reload: Reload,
    pub(super) publisher: StatusPublisher,
    pub(super) igtl: Option<IgtlServer>,
    pub(super) viewers: Option<Arc<Viewers>>,
    pub(super) home: Home,
    pub(super) markers: Option<Markers>,
    pub(super) began: Instant,
}

/// The opened inputs of a session.
struct Made {
    inputs: SessionInputs,
    /// Name of the volume's input.
    input: String,
}

impl LiveApp<'_> {
    /// Runs the sessions. Returns the path of the last recording, if any.
    ///
    /// # Errors
    /// [`Failure`] when the first cannot begin, one cannot continue, or the last one's outputs
    /// cannot be written.
    pub(super) fn run(mut self, leave: Leave<'_>) -> Result<Option<PathBuf>, Failure> {
        let SessionOptions { record, resume, .. } = self.options;
        let bedside = self.reload.bedside().clone();
        let folder = record.clone().or_else(|| bedside.record.folder.clone());
        let resumed = resume.as_ref().map(|session| resume::open(session, &bedside)).transpose()?.unwrap_or_default();
        let mut made = self.open(&bedside, folder.as_deref(), resumed, resume.as_deref())?;
        loop {
            let bedside = self.reload.bedside().clone();
            let Made { inputs, input } = made;
            let records = matches!(inputs.source, Source::Devices { record: Some(_), .. });
            self.publisher.begin_session(&bedside, records.then_some(input.as_str()))?;
            let stages = self.stages(&bedside)?;
            // The volume is new; observers drop the slices of the previous session.
            stages.observers.iter().for_each(|observer| observer.cleared());
            self.controller.runs(records, input);
            let controller = Arc::clone(&self.controller);
            let ended =
                pipeline::session::run(&stages, inputs, &Monotonic, controller.turns(), |status| self.watch(status))?;
            made = match self.next(&ended)? {
                Some(next) => next,
                None => return self.leave(leave, ended),
            };
        }
    }

    /// Returns the pipeline's stages, with all observers.
    fn stages(&self, bedside: &Bedside) -> Result<Session, Failure> {
        let client = self.viewers.clone().map(|viewers| viewers as Arc<dyn ViewClient>);
        let mut stages = stages(bedside, client)?;
        if let Some(broadcaster) = self.publisher.broadcaster() {
            stages.plane_viewer = Some(Arc::clone(&broadcaster) as Arc<dyn PlaneViewer>);
            stages.brick_viewer = Some(Arc::clone(&broadcaster) as Arc<dyn BrickViewer>);
            stages.observers.push(broadcaster as Arc<dyn Observer>);
            stages.observers.push(self.publisher.slices() as Arc<dyn Observer>);
            stages.readers.push(Arc::clone(&self.controller) as Arc<dyn Reader>);
        }
        stages.observers.extend(self.publisher.guidance().map(|guidance| guidance as Arc<dyn Observer>));
        if let Some(igtl) = &self.igtl {
            igtl.observe(&mut stages);
        }
        Ok(stages)
    }

    /// Opens the devices, and the recording if there is to be one. No file is created if a
    /// device cannot be opened.
    fn open(
        &mut self,
        bedside: &Bedside,
        folder: Option<&Path>,
        resumed: Vec<Recorded>,
        goes_on_with: Option<&Path>,
    ) -> Result<Made, Failure> {
        let quiet = self.options.quiet;
        let [tracking_is, grabber_is] = roles(bedside)?;
        let opened = devices::open(bedside, Monotonic.now_ns(), folder.is_some())?;
        let Devices { tracking, protocol, at_home, grabber } = opened;
        refuse_size(bedside, grabber.describe().image_size, self.options.accept_example, self.operator.reporter)?;
        let mut record = folder.map(|folder| record(bedside, folder)).transpose()?;
        if let Some(at_home) = at_home {
            // A virtual arm is switched on at home.
            let is_silent = quiet || bedside.tracking.is_virtual();
            self.home.listen(at_home, |how| {
                if !is_silent {
                    self.operator.reporter.say(how)
                }
            })?;
        }
        if let (Some(record), false) = (&record, quiet) {
            self.operator.reporter.say(&format!("recorded in {}", record.writer.path().display()));
        }
        if let (Some(record), Some(session)) = (&mut record, goes_on_with) {
            record.notes.push(resume::note(session)?);
        }
        let input = record.as_ref().map_or("devices, not recorded".into(), |record| {
            let path = record.writer.path();
            path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
        });
        let devices = vec![
            SessionDevice { role: tracking_is, device: tracking, protocol },
            SessionDevice { role: grabber_is, device: grabber, protocol: None },
        ];
        let source = Source::Devices { devices, record };
        let inputs = SessionInputs { source, resumed, policy: self.policy.clone() };
        Ok(Made { inputs, input })
    }

    /// Publishes the status to observers, and returns instructions for the session. The pipeline
    /// calls this at regular intervals.
    fn watch(&mut self, status: &SessionStatus) -> Vec<Instruction> {
        let until = self.options.duration.map(Duration::from_secs_f64);
        if until.is_some_and(|until| self.began.elapsed() >= until) {
            self.quit.store(true, Ordering::Relaxed);
        }
        let quits = self.quit.load(Ordering::Relaxed);
        self.controller.update(status);
        self.publisher.publish(status, line, quits);
        if let Some(igtl) = &mut self.igtl {
            igtl.send_status(|| line(status));
            self.publisher.publish_igtl(igtl.numbers());
        }
        self.operator.reporter.status(&|| line(status));
        for (how, sentence) in self.markers.iter().flat_map(Markers::sentences) {
            self.operator.reporter.say(&sentence);
            self.controller.report(how, sentence);
        }
        let mut instructions: Vec<_> = self.controller.commands().into_iter().map(Instruction::from).collect();
        if quits {
            instructions.push(Command::Stop.into());
        }
        if self.reload.is_requested() {
            self.publisher.reloading();
            instructions.extend(self.reload.instructions(self.operator.reporter, self.viewers.as_ref()));
            self.publisher.reloaded(self.reload.bedside());
            self.igtl.iter().for_each(|igtl| igtl.allow(&self.reload.bedside().igtl.allow));
        }
        instructions
    }

    /// Serves an ended session until a page begins another one; returns the next session's
    /// inputs, if any.
    fn next(&mut self, ended: &EndedSession<'_>) -> Result<Option<Made>, Failure> {
        let controller = Arc::clone(&self.controller);
        if !controller.stopped() {
            return Ok(None);
        }
        self.publisher.over(ended.status());
        if let Some(recording) = ended.recording() {
            controller.report(Progress::Done, format!("the recording is complete: {}", recording.path.display()));
            let (controller, path) = (Arc::clone(&controller), recording.path.clone());
            // The next session may begin meanwhile.
            std::thread::Builder::new().name("crossings".into()).spawn(move || {
                match crossings_check::check(&path) {
                    Some(Ok(sentence)) => controller.report(Progress::Done, sentence),
                    Some(Err(sentence)) => controller.report(Progress::Failed, sentence),
                    None => {}
                }
            })?;
        }
        while !self.quit.load(Ordering::Relaxed) {
            let Some(next) = controller.opens() else {
                controller.is_over();
                ended.serve(controller.turns(), |status| self.watch(status));
                continue;
            };
            self.reload.begins_anew();
            let bedside = self.reload.bedside().clone();
            let folder = if next.records { Some(controller.folder()?.to_owned()) } else { None };
            let is_own = refuse_example(&bedside, self.options.accept_example, self.operator.reporter);
            match is_own.and_then(|()| self.open(&bedside, folder.as_deref(), Vec::new(), None)) {
                Ok(made) => return Ok(Some(made)),
                Err(Failure(Reason { sentence: why, .. })) => {
                    self.operator.reporter.say(&why);
                    controller.report(Progress::Failed, format!("the session cannot begin: {why}"));
                }
            }
        }
        Ok(None)
    }

    /// Passes the result on, while pages still see the session.
    fn leave(self, leave: Leave<'_>, ended: EndedSession<'_>) -> Result<Option<PathBuf>, Failure> {
        let finished = ended.finish();
        if let Some(igtl) = self.igtl {
            igtl.leave(self.operator.reporter, self.options.quiet);
        }
        let (bedside, wall) = (self.reload.bedside(), self.began.elapsed());
        leave(&Ended { bedside, finished: &finished, wall, replayed: None, differences: None })?;
        match finished.recording.as_ref().and_then(|recording| crossings_check::check(&recording.path)) {
            Some(Err(sentence)) => self.operator.reporter.say(&sentence),
            Some(Ok(sentence)) if !self.options.quiet => self.operator.reporter.say(&sentence),
            _ => {}
        }
        Ok(finished.recording.map(|recording| recording.path))
    }
}
