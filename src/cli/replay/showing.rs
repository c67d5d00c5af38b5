//! Serves a recorded session to browsers: replays it, with other settings on request, and keeps
//! serving the result.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use config::bedside::Bedside;
use console::Listen;
use pipeline::control::{Progress, Replayed, SessionController, ViewedFrame};
use pipeline::live::{
    Differences, EndedSession, PlaneViewer, Reader, RecordedDecisions, SchedulingPolicy, Session, SessionInputs,
    SessionStatus, Source, ViewClient,
};
use pipeline::{CapturedFrame, Observer};
use sonoweave_core::clock::Monotonic;

use super::reel::{Reel, Still};
use super::session::Wanted;
use crate::cli::Failure;
use crate::cli::igtl::Shared;
use crate::cli::live::outputs::{leave, line, name_of, say};
use crate::cli::live::resume::Chain;
use crate::cli::live::session::until_told;
use crate::cli::live::stages::stages;
use crate::cli::live::status_publisher::{REPLAY, StatusPublisher};
use crate::cli::live::viewers::Viewers;

/// Time between two progress lines.
const SAID_EVERY: Duration = Duration::from_secs(2);

/// Passes the recording's images to pages; their capture times are in the past.
struct Pages(Arc<console::FrameBroadcaster>);

impl Observer for Pages {
    fn captured(&self, glimpsed: &CapturedFrame<'_>) {
        self.0.recorded(glimpsed.item, glimpsed.image);
    }
}

/// A served recorded session.
struct Showing<'a> {
    wanted: &'a Wanted<'a>,
    quit: Arc<AtomicBool>,
    desk: Arc<SessionController>,
    telling: StatusPublisher,
    viewers: Option<Arc<Viewers>>,
    shared: Option<Shared>,
    reel: Reel,
    said: Instant,
}

/// Serves the session until Ctrl-C or SIGTERM, then writes the outputs of the last replay.
///
/// # Errors
/// [`Failure`] when it cannot be read or served, or its outputs cannot be written.
pub(super) fn run(wanted: &Wanted<'_>, address: SocketAddr, keep: Option<&Path>) -> Result<(), Failure> {
    if wanted.series.is_some() {
        return Err(Failure("--pictures: cannot be combined with --console; leave one of them out".into()));
    }
    let (_, bedside) = wanted.open()?;
    bedside.calibrated().map_err(Failure::configuration)?;
    let reel = Reel::open(wanted.session)?;
    let beside = match wanted.session.parent() {
        Some(folder) if folder != Path::new("") => folder.to_owned(),
        _ => PathBuf::from("."),
    };
    let replayed = Replayed::new(bedside.clone(), beside, reel.count() as u64);
    let desk = Arc::new(SessionController::of_recording(keep.map(Path::to_owned), replayed));
    let quit = until_told()?;
    let listen = Listen { address, access: bedside.status.access.clone() };
    let telling = StatusPublisher::begin(&bedside, Some(listen), REPLAY, &desk)?;
    telling.address().iter().for_each(|address| say(&format!("console: {address}")));
    let shared = wanted.sharing.begin(&quit, false)?;
    let viewers = Viewers::of(&bedside.picture, None, wanted.outputs.picture.is_some(), telling.screen().as_ref());
    Showing { wanted, quit, desk, telling, viewers, shared, reel, said: Instant::now() }.run()
}

impl Showing<'_> {
    fn run(mut self) -> Result<(), Failure> {
        let (mut bedside, mut is_tried) = self.begins();
        loop {
            let began = Instant::now();
            self.telling.weaves(&bedside)?;
            if let Some(viewers) = &self.viewers {
                viewers.look(&bedside.picture);
            }
            let stages = self.stages(&bedside)?;
            stages.observers.iter().for_each(|observer| observer.cleared());
            if let Some(screen) = self.telling.screen() {
                screen.highlight(None);
            }
            self.desk.runs(false, name_of(self.wanted.session));
            let held = match self.weave(&stages, &bedside, is_tried) {
                Ok(woven) => woven,
                Err(Failure(why)) if is_tried => {
                    say(&why);
                    self.desk.happened(
                        Progress::Failed,
                        format!("these settings cannot be used: {why}; the replay uses the recorded settings"),
                    );
                    (bedside, is_tried) = self.begins();
                    continue;
                }
                Err(failure) => return Err(failure),
            };
            let differences = held
                .decisions()
                .filter(|_| self.wanted.config.is_none() && !is_tried)
                .map(RecordedDecisions::differences);
            // An aborted replay has no result to report.
            if !self.desk.stopped() && !self.quit.load(Ordering::Relaxed) {
                self.tell(&held, differences.as_ref());
            }
            self.telling.over(held.account());
            if !self.look(&held) {
                let finished = held.finish();
                if let Some(shared) = self.shared {
                    shared.leave(false);
                }
                return leave(
                    &bedside,
                    &self.wanted.outputs,
                    &finished,
                    began.elapsed(),
                    Some(self.wanted.session),
                    differences.as_ref(),
                );
            }
            drop(held);
            (bedside, is_tried) = self.begins();
        }
    }

    /// Returns the settings of the next replay, and whether they are an override.
    fn begins(&self) -> (Bedside, bool) {
        self.desk.replayed().map(Replayed::begins).unwrap_or_else(|| unreachable!("it is a recording's desk"))
    }

    fn stages(&self, bedside: &Bedside) -> Result<Session, Failure> {
        let looks = self.viewers.clone().map(|viewers| viewers as Arc<dyn ViewClient>);
        let mut stages = stages(bedside, looks)?;
        if let Some(screen) = self.telling.screen() {
            stages.plane_viewer = Some(Arc::clone(&screen) as Arc<dyn PlaneViewer>);
            stages.observers.push(Arc::new(Pages(screen)));
        }
        stages.observers.push(self.telling.slices() as Arc<dyn Observer>);
        stages.observers.extend(self.telling.coach().map(|coach| coach as Arc<dyn Observer>));
        stages.readers.push(Arc::clone(&self.desk) as Arc<dyn Reader>);
        if let Some(shared) = &self.shared {
            shared.joins(&mut stages);
        }
        Ok(stages)
    }

    /// Runs the replay until its end, or until a signal or a command stops it.
    fn weave<'s>(
        &mut self,
        stages: &'s Session,
        bedside: &Bedside,
        is_tried: bool,
    ) -> Result<EndedSession<'s>, Failure> {
        let Wanted { session, config, pace, all, .. } = self.wanted;
        let mut chain = Chain::read(session)?;
        if *all {
            chain.last().1.use_all();
        }
        let mut recorded = chain.recorded((config.is_some() || is_tried).then_some(bedside), *pace)?;
        let Some(last) = recorded.pop() else { unreachable!("a chain has a session") };
        let desk = Arc::clone(&self.desk);
        let policy = SchedulingPolicy::default();
        let inputs = SessionInputs { source: Source::Recording(last), resumed: recorded, policy };
        Ok(pipeline::live::run(stages, inputs, &Monotonic, desk.turns(), |account| {
            if self.said.elapsed() >= SAID_EVERY {
                self.said = Instant::now();
                say(&line(account));
            }
            self.watch(account);
            Vec::new()
        })?)
    }

    /// Publishes the status to observers. The pipeline calls this at regular intervals.
    fn watch(&mut self, account: &SessionStatus) {
        let quits = self.quit.load(Ordering::Relaxed);
        self.desk.goes_on(&account.world, quits);
        self.telling.look(account, line, quits);
        if let Some(shared) = &mut self.shared {
            shared.tell(|| line(account));
        }
    }

    /// Reports the result of a complete replay.
    fn tell(&self, held: &EndedSession<'_>, differences: Option<&Differences>) {
        let slices = held.account().ledger.frames.used;
        let (how, says) = match differences {
            None => (Progress::Done, format!("the replay with other settings has ended: {slices} slices")),
            Some(Differences { count: 0, .. }) => (
                Progress::Done,
                format!("the replay with the recorded settings ended with the same outcome: {slices} slices"),
            ),
            Some(Differences { count, first }) => (
                Progress::Failed,
                format!(
                    "the replay differs from the live session {count} times; first, {}",
                    first.as_deref().unwrap_or("the volume")
                ),
            ),
        };
        say(&says);
        self.desk.happened(how, says);
    }

    /// Serves the result until another replay is requested. Returns whether one is.
    fn look(&mut self, held: &EndedSession<'_>) -> bool {
        let desk = Arc::clone(&self.desk);
        while !self.quit.load(Ordering::Relaxed) {
            if desk.opens().is_some() {
                return true;
            }
            desk.is_over();
            held.linger(desk.turns(), |account| {
                self.watch(account);
                if let Some(place) = desk.replayed().and_then(Replayed::wanted)
                    && let Err(why) = self.show(place)
                {
                    desk.happened(Progress::Failed, format!("frame {}: {why}", place + 1));
                }
                Vec::new()
            });
        }
        false
    }

    /// Shows a frame, by its place among all, and its position.
    fn show(&mut self, place: usize) -> Result<(), String> {
        let Still { item, time_s, image } = self.reel.still(place)?;
        let corners = self.telling.slices().corners(item);
        if let Some(screen) = self.telling.screen() {
            screen.recorded(item, &image);
            screen.highlight(corners);
        }
        let seen = ViewedFrame { number: place as u64 + 1, frame: item, time_s, posed: corners.is_some() };
        if let Some(replayed) = self.desk.replayed() {
            replayed.sees(seen);
        }
        Ok(())
    }
}
