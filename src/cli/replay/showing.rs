//! A recorded session in browsers: run again, by other settings if they want, and looked at.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::reel::{Reel, Still};
use super::session::Wanted;
use crate::cli::Failure;
use crate::cli::igtl::Shared;
use crate::cli::live::outputs::{leave, line, name_of, say};
use crate::cli::live::resume::Chain;
use crate::cli::live::session::until_told;
use crate::cli::live::stages::stages;
use crate::cli::live::telling::{REPLAY, Telling};
use crate::cli::live::viewers::Viewers;
use crate::config::bedside::Bedside;
use crate::console::Listen;
use crate::desk::{Desk, How, Replayed, Seen};
use crate::pipeline::live::{
    Account, Cutter, Differences, Glimpsed, Held, Looks, Order, Precedent, Reader, Session, Witness, rerun_and_hold,
};

/// Between two lines on the way.
const SAID_EVERY: Duration = Duration::from_secs(2);

/// The recording's pictures for pages: when they were captured is long past.
struct Pages(Arc<crate::console::Screen>);

impl Witness for Pages {
    fn glimpsed(&self, glimpsed: &Glimpsed<'_>) {
        self.0.recorded(glimpsed.item, glimpsed.image);
    }
}

/// A recorded session that is shown.
struct Showing<'a> {
    wanted: &'a Wanted<'a>,
    quit: Arc<AtomicBool>,
    desk: Arc<Desk>,
    telling: Telling,
    viewers: Option<Arc<Viewers>>,
    shared: Option<Shared>,
    reel: Reel,
    said: Instant,
}

/// Shows it until it is told to end, and leaves what is wanted of the run that was looked at last.
///
/// # Errors
/// [`Failure`] when it cannot be read or shown, or what it leaves cannot be written.
pub(super) fn run(wanted: &Wanted<'_>, address: SocketAddr, keep: Option<&Path>) -> Result<(), Failure> {
    if wanted.series.is_some() {
        return Err(Failure(
            "--pictures: with --console pages look at the volume, as fast as they can; leave one of them out".into(),
        ));
    }
    let (_, bedside) = wanted.open()?;
    bedside.calibrated()?;
    let reel = Reel::open(wanted.session)?;
    let beside = match wanted.session.parent() {
        Some(folder) if folder != Path::new("") => folder.to_owned(),
        _ => PathBuf::from("."),
    };
    let replayed = Replayed::new(bedside.clone(), beside, reel.count() as u64);
    let desk = Arc::new(Desk::of_recording(keep.map(Path::to_owned), replayed));
    let quit = until_told()?;
    let listen = Listen { address, access: bedside.status.access.clone() };
    let telling = Telling::begin(&bedside, Some(listen), REPLAY, &desk)?;
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
            stages.witnesses.iter().for_each(|witness| witness.cleared());
            if let Some(screen) = self.telling.screen() {
                screen.point_out(None);
            }
            self.desk.runs(false, name_of(self.wanted.session));
            let (held, precedent) = match self.weave(&stages, &bedside, is_tried) {
                Ok(woven) => woven,
                Err(Failure(why)) if is_tried => {
                    say(&why);
                    self.desk.happened(
                        How::Failed,
                        format!("it cannot be run by these settings: {why}; it is run as it was recorded"),
                    );
                    (bedside, is_tried) = self.begins();
                    continue;
                }
                Err(failure) => return Err(failure),
            };
            let differences = (self.wanted.config.is_none() && !is_tried).then(|| precedent.differences());
            // A run that was ended came to nothing that could be told.
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

    /// By what it is run next.
    fn begins(&self) -> (Bedside, bool) {
        self.desk.replayed().map(Replayed::begins).unwrap_or_else(|| unreachable!("it is a recording's desk"))
    }

    fn stages(&self, bedside: &Bedside) -> Result<Session, Failure> {
        let looks = self.viewers.clone().map(|viewers| viewers as Arc<dyn Looks>);
        let mut stages = stages(bedside, looks)?;
        if let Some(screen) = self.telling.screen() {
            stages.cutter = Some(Arc::clone(&screen) as Arc<dyn Cutter>);
            stages.witnesses.push(Arc::new(Pages(screen)));
        }
        stages.witnesses.push(self.telling.slices() as Arc<dyn Witness>);
        stages.witnesses.extend(self.telling.coach().map(|coach| coach as Arc<dyn Witness>));
        stages.readers.push(Arc::clone(&self.desk) as Arc<dyn Reader>);
        if let Some(shared) = &self.shared {
            shared.joins(&mut stages);
        }
        Ok(stages)
    }

    /// Weaves it, until its end or until it is told to end.
    fn weave<'s>(
        &mut self,
        stages: &'s Session,
        bedside: &Bedside,
        is_tried: bool,
    ) -> Result<(Held<'s>, Precedent), Failure> {
        let Wanted { session, config, pace, all, .. } = self.wanted;
        let mut chain = Chain::read(session)?;
        if *all {
            chain.last().1.use_all();
        }
        let mut recorded = chain.recorded((config.is_some() || is_tried).then_some(bedside), *pace)?;
        let Some(last) = recorded.pop() else { unreachable!("a chain has a session") };
        let desk = Arc::clone(&self.desk);
        Ok(rerun_and_hold(stages, recorded, last, desk.turns(), |account| {
            if self.said.elapsed() >= SAID_EVERY {
                self.said = Instant::now();
                say(&line(account));
            }
            self.watch(account);
        })?)
    }

    /// Now and then: who looks on is told.
    fn watch(&mut self, account: &Account) {
        let quits = self.quit.load(Ordering::Relaxed);
        self.desk.goes_on(&account.world, quits);
        self.telling.look(account, line, quits);
        if let Some(shared) = &mut self.shared {
            shared.tell(|| line(account));
        }
    }

    /// What came of a whole run.
    fn tell(&self, held: &Held<'_>, differences: Option<&Differences>) {
        let slices = held.account().ledger.frames.used;
        let (how, says) = match differences {
            None => (How::Done, format!("it was run by other settings: {slices} slices")),
            Some(Differences { count: 0, .. }) => {
                (How::Done, format!("it was run as it was recorded, with the same outcome: {slices} slices"))
            }
            Some(Differences { count, first }) => (
                How::Failed,
                format!(
                    "it comes to something else than when it was live, {count} times; first, {}",
                    first.as_deref().unwrap_or("the volume")
                ),
            ),
        };
        say(&says);
        self.desk.happened(how, says);
    }

    /// It is looked at until another run is wanted: whether one is.
    fn look(&mut self, held: &Held<'_>) -> bool {
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
                    desk.happened(How::Failed, format!("frame {}: {why}", place + 1));
                }
                Vec::<Order>::new()
            });
        }
        false
    }

    /// Shows a frame, by its place among all, and where it lay.
    fn show(&mut self, place: usize) -> Result<(), String> {
        let Still { item, time_s, image } = self.reel.still(place)?;
        let corners = self.telling.slices().corners(item);
        if let Some(screen) = self.telling.screen() {
            screen.recorded(item, &image);
            screen.point_out(corners);
        }
        let seen = Seen { number: place as u64 + 1, frame: item, time_s, posed: corners.is_some() };
        if let Some(replayed) = self.desk.replayed() {
            replayed.sees(seen);
        }
        Ok(())
    }
}
