//! A recorded sweep, and its reconstruction.

use std::ops::Range;
use std::sync::atomic::AtomicBool;

use config::Settings as Config;
use drivers::replay::SequenceSettings;
use pipeline::session::{Finished, Sequence, Session, SessionInputs, Source, run};
use pipeline::{OffPlane, Outcome, PipelineError};
use sonoweave_core::clock::Monotonic;

use crate::cli::{Failure, input};

/// A recorded sweep, with the settings of its reconstruction.
pub(in crate::cli) struct Sweep {
    /// The recording.
    pub(in crate::cli) input: SequenceSettings,
    /// Frames to use, by their number in the recording.
    pub(in crate::cli) frames: Range<u64>,
    pub(in crate::cli) off_plane: OffPlane,
    /// Settings of mask and volume, and the observers.
    pub(in crate::cli) session: Session,
    /// The configuration that the settings follow from.
    pub(in crate::cli) config: Config,
}

impl Sweep {
    /// Reconstructs the sweep. A progress bar shows `activity`.
    ///
    /// # Errors
    /// [`Failure`] when no frame can be used, or the run as a whole fails.
    pub(in crate::cli) fn reconstruct(self, activity: &'static str) -> Result<Outcome, Failure> {
        let Self { input, frames, off_plane, session, .. } = self;
        let sequence = Sequence::open(input, frames, off_plane, &session.pairing)?;
        let bar = input::progress(activity, sequence.count());
        let source = SessionInputs::of(Source::Sequence(sequence));
        let ran = run(&session, source, &Monotonic, &AtomicBool::new(false), |status| {
            bar.set_position(status.ledger.frames.total);
            Vec::new()
        });
        bar.finish_and_clear();
        let Finished { outcome, status, .. } = ran?.finish();
        Ok(outcome.ok_or_else(|| PipelineError::NothingUsed(Box::new(status.ledger)))?)
    }
}
