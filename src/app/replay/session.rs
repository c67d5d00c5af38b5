//! Replays a recorded session.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use config::bedside::{Bedside, Tracking};
use drivers::replay::Pace;
use pipeline::command::Command;
use pipeline::session::{Differences, RecordedDecisions, SchedulingPolicy, SessionInputs, Source, ViewClient};
use reconstruct::Compounding;
use sonoweave_core::clock::Monotonic;

use super::series::{Gallery, Series};
use super::session_movie::MovieRequest;
use crate::app::correct;
use crate::app::igtl::Sharing;
use crate::app::input;
use crate::app::live::ended::{Ended, Leave};
use crate::app::live::outputs::{Outputs, line};
use crate::app::live::resume::Chain;
use crate::app::live::session::quit_on_signal;
use crate::app::live::stages::{Kept, stages};
use crate::app::reporter::Reporter;
use crate::failure::Failure;

/// A request for a session.
pub(crate) struct ReplayRequest<'a> {
    pub(crate) session: &'a Path,
    /// Another session configuration.
    pub(crate) config: Option<&'a Path>,
    pub(crate) pace: Pace,
    /// Whether the corrections that stand are applied.
    pub(crate) corrected: bool,
    /// Whether dropped frames are used too.
    pub(crate) all: bool,
    /// Intermediate pictures.
    pub(crate) series: Option<Series>,
    /// A movie of the session.
    pub(crate) movie: Option<MovieRequest>,
    pub(crate) outputs: Outputs,
    /// The OpenIGTLink server.
    pub(crate) sharing: Sharing,
}

impl ReplayRequest<'_> {
    /// Reads the recorded decisions of the session and of those that it resumes, and the
    /// settings of the replay.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be read, or a requested output cannot be written.
    pub(crate) fn open(&self) -> Result<(Chain, Bedside), Failure> {
        let Self { session, config, outputs, movie, .. } = self;
        for output in [&outputs.volume, &outputs.weights, &outputs.errors, &outputs.picture].into_iter().flatten() {
            input::check_is_not(output, session)?;
        }
        if let Some(MovieRequest { path, .. }) = movie {
            input::check_is_not(path, session)?;
        }
        outputs.json.check([*session])?;
        let mut chain = Chain::read(session)?;
        let (_, decisions) = chain.last();
        let mut bedside = match config {
            Some(path) => Bedside::read(path).map_err(Failure::configuration)?,
            None => Kept::bedside(session, decisions)?,
        };
        // On the general path, the sums for standard errors leave the volume as it is.
        let settings = &mut bedside.volume.settings;
        if outputs.errors.is_some() && config.is_none() && settings.compounding == Compounding::Mean {
            if matches!(bedside.tracking, Tracking::Arm(_)) {
                fail_usage!(
                    "--error: the session of an arm, whose path may be the planar one, keeps no sums for it; give \
                     --config with volume.standard_error = true, or leave it out"
                );
            }
            settings.standard_error = true;
        }
        outputs.check(&bedside)?;
        Ok((chain, bedside))
    }
}

/// Replays the session.
///
/// # Errors
/// [`Failure`] when it cannot be read, its outputs cannot be written, or its result differs from
/// the live one.
pub(crate) fn run(request: &ReplayRequest<'_>, reporter: &dyn Reporter, leave: Leave<'_>) -> Result<(), Failure> {
    let ReplayRequest { session, config, pace, corrected, all, series, movie, outputs, sharing } = request;
    let (mut chain, bedside) = request.open()?;
    let (_, decisions) = chain.last();
    let (missing, dropped) = (decisions.missing(), decisions.dropped());
    if missing > 0 {
        reporter.say(&format!("{missing} messages were lost during the recording; their effect cannot be replayed"));
    }
    if *all {
        decisions.use_all();
        reporter.say(&format!(
            "{dropped} frames and readings that were dropped when it was live are used, {}",
            if dropped > 0 { "so that the volume is another one" } else { "of which there are none" }
        ));
    }
    let has_digest = decisions.digest().is_some();
    if *corrected {
        let other = config.is_some().then_some(&bedside);
        correct::apply(&mut chain, other)?.iter().for_each(|sentence| reporter.say(sentence));
    }
    let is_corrected = chain.links().any(|(_, decisions)| decisions.corrections().is_some());
    let mut recorded = chain.recorded(config.is_some().then_some(&bedside), *pace)?;
    let Some(last) = recorded.pop() else { unreachable!("a chain has a session") };
    let quit = quit_on_signal()?;
    let mut igtl = sharing.begin(&[], &quit, reporter, false)?;
    let began = Instant::now();
    let is_rendered = outputs.picture.is_some() || series.is_some() || movie.is_some();
    let gallery = || Gallery::new(bedside.picture.clone(), series.clone(), movie.clone()).map(Arc::new);
    let gallery = is_rendered.then(gallery).transpose()?;
    let client = gallery.clone().map(|gallery| gallery as Arc<dyn ViewClient>);
    let mut stages = stages(&bedside, client)?;
    if let Some(igtl) = &igtl {
        igtl.observe(&mut stages);
    }
    let policy = SchedulingPolicy::default();
    let inputs = SessionInputs { source: Source::Recording(last), resumed: recorded, policy };
    let ended = pipeline::session::run(&stages, inputs, &Monotonic, &AtomicBool::new(false), |status| {
        if let Some(igtl) = &mut igtl {
            igtl.send_status(|| line(status));
        }
        reporter.status(&|| line(status));
        if quit.load(Ordering::Relaxed) { vec![Command::Stop.into()] } else { Vec::new() }
    })?;
    let finished = ended.finish();
    if let Some(igtl) = igtl {
        igtl.leave(reporter, false);
    }
    if let Some(written) = gallery.and_then(|gallery| gallery.finish().transpose()) {
        reporter.say(&written?);
    }
    let differences = finished.decisions.as_ref().filter(|_| config.is_none()).map(RecordedDecisions::differences);
    leave(&Ended {
        bedside: &bedside,
        finished: &finished,
        wall: began.elapsed(),
        replayed: Some(session),
        differences: differences.as_ref(),
    })?;
    match differences {
        Some(Differences { count: 0, .. }) if !all && has_digest => {
            reporter.say(if is_corrected {
                "the poses before their corrections are the same as in the live session, bit by bit"
            } else {
                "the volume is the same as in the live session, bit by bit"
            });
            Ok(())
        }
        Some(Differences { count, first: Some(first) }) => Err(Failure::new(format!(
            "{}: differs from the live session {count} times; first, {first}",
            session.display()
        ))),
        _ => Ok(()),
    }
}
