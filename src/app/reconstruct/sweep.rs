//! A recorded sweep, and its reconstruction.

use std::ops::Range;
use std::sync::atomic::AtomicBool;

use config::Settings as Config;
use drivers::replay::SequenceSettings;
use pipeline::regions::SweepPlan;
use pipeline::session::{Finished, Sequence, Session, SessionInputs, Source, run};
use pipeline::{OffPlane, Outcome, PipelineError};
use sonoweave_core::clock::Monotonic;

use crate::app::reporter::Steps;

/// A recorded sweep, with the settings of its reconstruction.
pub(crate) struct Sweep {
    /// The recording.
    pub(crate) input: SequenceSettings,
    /// Frames to use, by their number in the recording.
    pub(crate) frames: Range<u64>,
    pub(crate) off_plane: OffPlane,
    /// Settings of mask and volume, and the observers.
    pub(crate) session: Session,
    /// The configuration that the settings follow from.
    pub(crate) config: Config,
}

impl Sweep {
    /// Returns a copy of the settings, without observers and viewers.
    pub(crate) fn without_observers(&self) -> Self {
        let Self { input, frames, off_plane, session, config } = self;
        let of_session = Session::new(session.pairing.clone(), session.mask, session.settings.clone());
        Self {
            input: input.clone(),
            frames: frames.clone(),
            off_plane: *off_plane,
            session: Session { path: session.path, planar: session.planar, smoothing: session.smoothing, ..of_session },
            config: config.clone(),
        }
    }

    /// Reconstructs the sweep. The progress of `activity` is shown by `steps`.
    ///
    /// # Errors
    /// [`PipelineError`] when no frame can be used, or the run as a whole fails.
    pub(crate) fn reconstruct(self, activity: &'static str, steps: Steps<'_>) -> Result<Outcome, PipelineError> {
        let Self { input, frames, off_plane, session, .. } = self;
        let sequence = Sequence::open(input, frames, off_plane, &session.pairing, session.smoothing)?;
        let step = steps(activity, sequence.count());
        let source = SessionInputs::of(Source::Sequence(sequence));
        let ran = run(&session, source, &Monotonic, &AtomicBool::new(false), |status| {
            step(status.ledger.frames.total);
            Vec::new()
        });
        drop(step);
        let Finished { outcome, status, .. } = ran?.finish();
        outcome.ok_or_else(|| PipelineError::NothingUsed(Box::new(status.ledger)))
    }

    /// Plans the sweep's reconstruction in regions. The progress is shown by `steps`.
    ///
    /// # Errors
    /// [`PipelineError`] when no frame can be used, or the run as a whole fails.
    pub(crate) fn plan(self, steps: Steps<'_>) -> Result<(SweepPlan, Outcome), PipelineError> {
        let Self { input, frames, off_plane, session, .. } = self;
        let sequence = Sequence::open(input, frames, off_plane, &session.pairing, session.smoothing)?;
        let step = steps("planning", sequence.count());
        SweepPlan::new(session, sequence, |status| step(status.ledger.frames.total))
    }
}
