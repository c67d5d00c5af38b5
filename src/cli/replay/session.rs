//! Replays a recorded session.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use config::bedside::Bedside;
use drivers::replay::Pace;
use pipeline::live::{Differences, RecordedDecisions, SchedulingPolicy, SessionInputs, Source, ViewClient};
use sonoweave_core::clock::Monotonic;

use super::series::{Gallery, Series};
use crate::cli::igtl::Sharing;
use crate::cli::live::outputs::{Outputs, leave, line, say};
use crate::cli::live::resume::Chain;
use crate::cli::live::session::until_told;
use crate::cli::live::stages::{Kept, stages};
use crate::cli::{Failure, input};

/// Time between two progress lines.
const SAID_EVERY: Duration = Duration::from_secs(2);

/// A request for a session.
pub(super) struct Wanted<'a> {
    pub(super) session: &'a Path,
    /// Another session configuration.
    pub(super) config: Option<&'a Path>,
    pub(super) pace: Pace,
    /// Whether dropped frames are used too.
    pub(super) all: bool,
    /// Intermediate pictures.
    pub(super) series: Option<Series>,
    pub(super) outputs: Outputs,
    /// The OpenIGTLink server.
    pub(super) sharing: Sharing,
}

impl Wanted<'_> {
    /// Reads the recorded decisions of the session and of those that it resumes, and the
    /// settings of the replay.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be read, or a requested output cannot be written.
    pub(super) fn open(&self) -> Result<(Chain, Bedside), Failure> {
        let Self { session, config, outputs, .. } = self;
        for output in [&outputs.volume, &outputs.weights, &outputs.picture, &outputs.stats].into_iter().flatten() {
            input::check_is_not(output, session)?;
        }
        let mut chain = Chain::read(session)?;
        let (_, decisions) = chain.last();
        let bedside = match config {
            Some(path) => Bedside::read(path).map_err(Failure::configuration)?,
            None => Kept::bedside(session, decisions)?,
        };
        outputs.check(&bedside)?;
        Ok((chain, bedside))
    }
}

/// Replays the session.
///
/// # Errors
/// [`Failure`] when it cannot be read, its outputs cannot be written, or its result differs from
/// the live one.
pub(super) fn run(wanted: &Wanted<'_>) -> Result<(), Failure> {
    let Wanted { session, config, pace, all, series, outputs, sharing } = wanted;
    let (mut chain, bedside) = wanted.open()?;
    let (_, decisions) = chain.last();
    let (missing, dropped) = (decisions.missing(), decisions.dropped());
    if missing > 0 {
        say(&format!("{missing} messages were lost during the recording; their effect cannot be replayed"));
    }
    if *all {
        decisions.use_all();
        say(&format!(
            "{dropped} frames and readings that were dropped when it was live are used, {}",
            if dropped > 0 { "so that the volume is another one" } else { "of which there are none" }
        ));
    }
    let was_sealed = decisions.digest().is_some();
    let mut recorded = chain.recorded(config.is_some().then_some(&bedside), *pace)?;
    let Some(last) = recorded.pop() else { unreachable!("a chain has a session") };
    let ends = until_told()?;
    let mut shared = sharing.begin(&ends, false)?;
    let (began, mut said) = (Instant::now(), Instant::now());
    let is_looked_at = outputs.picture.is_some() || series.is_some();
    let gallery = is_looked_at.then(|| Arc::new(Gallery::new(bedside.picture.clone(), series.clone())));
    let looks = gallery.clone().map(|gallery| gallery as Arc<dyn ViewClient>);
    let mut stages = stages(&bedside, looks)?;
    if let Some(shared) = &shared {
        shared.joins(&mut stages);
    }
    let policy = SchedulingPolicy::default();
    let inputs = SessionInputs { source: Source::Recording(last), resumed: recorded, policy };
    let ended = pipeline::live::run(&stages, inputs, &Monotonic, &ends, |status| {
        if let Some(shared) = &mut shared {
            shared.tell(|| line(status));
        }
        if said.elapsed() >= SAID_EVERY {
            said = Instant::now();
            say(&line(status));
        }
        Vec::new()
    })?;
    let finished = ended.finish();
    if let Some(shared) = shared {
        shared.leave(false);
    }
    if let (Some(gallery), Some(Series { folder, .. })) = (gallery, series) {
        say(&format!("{} pictures in {}", gallery.written()?, folder.display()));
    }
    let differences = finished.decisions.as_ref().filter(|_| config.is_none()).map(RecordedDecisions::differences);
    leave(&bedside, outputs, &finished, began.elapsed(), Some(session), differences.as_ref())?;
    match differences {
        Some(Differences { count: 0, .. }) if !all && was_sealed => {
            say("the volume is the same as in the live session, bit by bit");
            Ok(())
        }
        Some(Differences { count, first: Some(first) }) => {
            Err(Failure(format!("{}: differs from the live session {count} times; first, {first}", session.display())))
        }
        _ => Ok(()),
    }
}
