//! Serves a recorded session to browsers: replays it, with other settings on request, and keeps
//! serving the result.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use config::bedside::{Bedside, SettingsOverride};
use console::Listen;
use pipeline::command::{Command, Instruction};
use pipeline::control::{CorrectionRequest, Progress, Replayed, SessionController, ViewedFrame};
use pipeline::session::{
    BrickViewer, CorrectedFrames, Differences, EndedSession, PlaneViewer, Reader, RecordedDecisions, SchedulingPolicy,
    Session, SessionInputs, SessionStatus, Source, ViewClient,
};
use pipeline::{CapturedFrame, Observer};
use sonoweave_core::clock::Monotonic;

use super::reel::{Reel, Still};
use super::session::ReplayRequest;
use crate::app::correct;
use crate::app::igtl::IgtlServer;
use crate::app::input::name_of;
use crate::app::live::ended::{Ended, Leave};
use crate::app::live::outputs::line;
use crate::app::live::resume::Chain;
use crate::app::live::session::quit_on_signal;
use crate::app::live::stages::stages;
use crate::app::live::status_publisher::{REPLAY, StatusPublisher};
use crate::app::live::viewers::Viewers;
use crate::app::reporter::Reporter;
use crate::failure::{Failure, Reason};

/// Passes the recording's images to pages; their capture times are in the past.
struct Pages(Arc<console::FrameBroadcaster>);

impl Observer for Pages {
    fn captured(&self, frame: &CapturedFrame<'_>) {
        self.0.recorded(frame.item, frame.image);
    }
}

/// A served recorded session.
struct Showing<'a> {
    request: &'a ReplayRequest<'a>,
    quit: Arc<AtomicBool>,
    controller: Arc<SessionController>,
    publisher: StatusPublisher,
    viewers: Option<Arc<Viewers>>,
    igtl: Option<IgtlServer>,
    reel: Reel,
    reporter: &'a dyn Reporter,
}

/// Serves the session until Ctrl-C or SIGTERM, then writes the outputs of the last replay.
///
/// # Errors
/// [`Failure`] when it cannot be read or served, or its outputs cannot be written.
pub(crate) fn run(
    request: &ReplayRequest<'_>,
    address: SocketAddr,
    keep: Option<&Path>,
    reporter: &dyn Reporter,
    leave: Leave<'_>,
) -> Result<(), Failure> {
    for (flag, given) in [("--pictures", request.series.is_some()), ("--movie", request.movie.is_some())] {
        if given {
            fail!("{flag}: cannot be combined with --console; leave one of them out");
        }
    }
    let (_, bedside) = request.open()?;
    bedside.calibrated().map_err(Failure::configuration)?;
    let reel = Reel::open(request.session)?;
    let beside = match request.session.parent() {
        Some(folder) if folder != Path::new("") => folder.to_owned(),
        _ => PathBuf::from("."),
    };
    let replayed = Replayed::new(bedside.clone(), beside, reel.count() as u64);
    let controller = Arc::new(SessionController::of_recording(keep.map(Path::to_owned), replayed));
    let quit = quit_on_signal()?;
    let listen = Listen { address, access: bedside.status.access.clone() };
    let publisher = StatusPublisher::begin(&bedside, Some(listen), REPLAY, &controller)?;
    publisher.address().iter().for_each(|address| reporter.say(&format!("console: {address}")));
    let igtl = request.sharing.begin(&[], &quit, reporter, false)?;
    let viewers =
        Viewers::of(&bedside.picture, None, request.outputs.picture.is_some(), publisher.broadcaster().as_ref());
    Showing { request, quit, controller, publisher, viewers, igtl, reel, reporter }.run(leave)
}

impl Showing<'_> {
    fn run(mut self, leave: Leave<'_>) -> Result<(), Failure> {
        let (mut bedside, mut is_tried) = self.begins();
        loop {
            let began = Instant::now();
            self.publisher.begin_session(&bedside, Some(&name_of(self.request.session)))?;
            if let Some(viewers) = &self.viewers {
                viewers.set_picture(&bedside.picture);
            }
            let stages = self.stages(&bedside)?;
            stages.observers.iter().for_each(|observer| observer.cleared());
            if let Some(broadcaster) = self.publisher.broadcaster() {
                broadcaster.highlight(None);
            }
            self.controller.runs(false, name_of(self.request.session));
            let ended = match self.replay(&stages, &bedside, is_tried) {
                Ok(inserted) => inserted,
                Err(Failure(Reason { sentence: why, .. })) if is_tried => {
                    self.reporter.say(&why);
                    self.controller.report(
                        Progress::Failed,
                        format!("these settings cannot be used: {why}; the replay uses the recorded settings"),
                    );
                    (bedside, is_tried) = self.begins();
                    continue;
                }
                Err(failure) => return Err(failure),
            };
            let differences = ended
                .decisions()
                .filter(|_| self.request.config.is_none() && !is_tried)
                .map(RecordedDecisions::differences);
            // An aborted replay has no result to report.
            if !self.controller.stopped() && !self.quit.load(Ordering::Relaxed) {
                self.report(&ended, differences.as_ref());
            }
            self.publisher.over(ended.status());
            if !self.serve(&ended) {
                let finished = ended.finish();
                if let Some(igtl) = self.igtl {
                    igtl.leave(self.reporter, false);
                }
                return leave(&Ended {
                    bedside: &bedside,
                    finished: &finished,
                    wall: began.elapsed(),
                    replayed: Some(self.request.session),
                    differences: differences.as_ref(),
                });
            }
            drop(ended);
            (bedside, is_tried) = self.begins();
        }
    }

    /// Returns the settings of the next replay, and whether they are an override.
    fn begins(&self) -> (Bedside, bool) {
        self.controller
            .replayed()
            .map(Replayed::begins)
            .unwrap_or_else(|| unreachable!("the controller has a recording"))
    }

    fn stages(&self, bedside: &Bedside) -> Result<Session, Failure> {
        let client = self.viewers.clone().map(|viewers| viewers as Arc<dyn ViewClient>);
        let mut stages = stages(bedside, client)?;
        if let Some(broadcaster) = self.publisher.broadcaster() {
            stages.plane_viewer = Some(Arc::clone(&broadcaster) as Arc<dyn PlaneViewer>);
            stages.brick_viewer = Some(Arc::clone(&broadcaster) as Arc<dyn BrickViewer>);
            stages.observers.push(Arc::new(Pages(broadcaster)));
        }
        stages.observers.push(self.publisher.slices() as Arc<dyn Observer>);
        stages.observers.extend(self.publisher.guidance().map(|guidance| guidance as Arc<dyn Observer>));
        stages.readers.push(Arc::clone(&self.controller) as Arc<dyn Reader>);
        if let Some(igtl) = &self.igtl {
            igtl.observe(&mut stages);
        }
        Ok(stages)
    }

    /// Runs the replay until its end, or until a signal or a command stops it.
    fn replay<'s>(
        &mut self,
        stages: &'s Session,
        bedside: &Bedside,
        is_tried: bool,
    ) -> Result<EndedSession<'s>, Failure> {
        let ReplayRequest { session, config, pace, corrected, all, .. } = self.request;
        let mut chain = Chain::read(session)?;
        if *all {
            chain.last().1.use_all();
        }
        if *corrected {
            let other = (config.is_some() || is_tried).then_some(bedside);
            correct::apply(&mut chain, other)?.iter().for_each(|sentence| self.reporter.say(sentence));
            if let Some(replayed) = self.controller.replayed() {
                replayed.set_corrections(correct::standing(session)?);
            }
        }
        let mut recorded = chain.recorded((config.is_some() || is_tried).then_some(bedside), *pace)?;
        let Some(last) = recorded.pop() else { unreachable!("a chain has a session") };
        let controller = Arc::clone(&self.controller);
        let policy = SchedulingPolicy::default();
        let inputs = SessionInputs { source: Source::Recording(last), resumed: recorded, policy };
        Ok(pipeline::session::run(stages, inputs, &Monotonic, controller.turns(), |status| {
            self.reporter.status(&|| line(status));
            self.watch(status)
        })?)
    }

    /// Publishes the status to observers. The pipeline calls this at regular intervals.
    fn watch(&mut self, status: &SessionStatus) -> Vec<Instruction> {
        let quits = self.quit.load(Ordering::Relaxed);
        self.controller.update(status);
        self.publisher.publish(status, line, quits);
        if let Some(igtl) = &mut self.igtl {
            igtl.send_status(|| line(status));
            self.publisher.publish_igtl(igtl.numbers());
        }
        if quits { vec![Command::Stop.into()] } else { Vec::new() }
    }

    /// Reports the result of a complete replay.
    fn report(&self, ended: &EndedSession<'_>, differences: Option<&Differences>) {
        let slices = ended.status().ledger.frames.used;
        let corrections = ended.decisions().and_then(RecordedDecisions::corrections);
        let (how, says) = match differences {
            None => (Progress::Done, format!("the replay with other settings has ended: {slices} slices")),
            Some(Differences { count: 0, .. }) => (
                Progress::Done,
                match corrections {
                    Some(CorrectedFrames { words, .. }) => {
                        format!("the replay with corrections ({words}) has ended: {slices} slices")
                    }
                    None => {
                        format!("the replay with the recorded settings ended with the same outcome: {slices} slices")
                    }
                },
            ),
            Some(Differences { count, first }) => (
                Progress::Failed,
                format!(
                    "the replay differs from the live session {count} times; first, {}",
                    first.as_deref().unwrap_or("the volume")
                ),
            ),
        };
        self.reporter.say(&says);
        self.controller.report(how, says);
    }

    /// Serves the result until another replay is requested. Returns whether one is.
    fn serve(&mut self, ended: &EndedSession<'_>) -> bool {
        let controller = Arc::clone(&self.controller);
        while !self.quit.load(Ordering::Relaxed) {
            if controller.opens().is_some() {
                return true;
            }
            controller.is_over();
            ended.serve(controller.turns(), |status| {
                let instructions = self.watch(status);
                if let Some(place) = controller.replayed().and_then(Replayed::requested)
                    && let Err(why) = self.show(place)
                {
                    controller.report(Progress::Failed, format!("frame {}: {why}", place + 1));
                }
                if let Some(request) = controller.replayed().and_then(Replayed::correction_requested) {
                    self.correct(request);
                }
                instructions
            });
        }
        false
    }

    /// Changes the session's corrections, and begins its replay with them.
    fn correct(&self, request: CorrectionRequest) {
        let changed = match self.request.corrected {
            true => correct::change(self.request.session, request),
            false => Err(Failure::new("corrections are left out; begin the replay without --as-recorded")),
        };
        match changed {
            Ok(says) => {
                self.controller.report(Progress::Done, says);
                if let Err(why) = self.controller.again(SettingsOverride::new()) {
                    self.controller.report(Progress::Failed, why.to_string());
                }
            }
            Err(Failure(Reason { sentence: why, .. })) => self.controller.report(Progress::Failed, why),
        }
    }

    /// Shows a frame, by its place among all, and its position.
    fn show(&mut self, place: usize) -> Result<(), String> {
        let Still { item, time_s, image } = self.reel.still(place)?;
        let corners = self.publisher.slices().corners(item);
        if let Some(broadcaster) = self.publisher.broadcaster() {
            broadcaster.recorded(item, &image);
            broadcaster.highlight(corners);
        }
        let seen = ViewedFrame { number: place as u64 + 1, frame: item, time_s, posed: corners.is_some() };
        if let Some(replayed) = self.controller.replayed() {
            replayed.set_viewed(seen);
        }
        Ok(())
    }
}
