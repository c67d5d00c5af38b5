//! The plan of a sweep: which slices enter, and all that is needed to insert each of them into any
//! region by itself, in another process, too.

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};

use serde::{Deserialize, Serialize};

use mask::Mask;
use reconstruct::{Entered, Settings};
use sonoweave_core::clock::Monotonic;
use sonoweave_core::frames::{Image as ImageFrame, Transform, World};
use volume::brick::BrickBox;

use crate::observer::{InsertedSlice, Observer};
use crate::session::{Finished, Sequence, SequenceInput, Session, SessionInputs, SessionStatus, Source, run};
use crate::{Outcome, PipelineError};

/// A slice that enters the volume.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PlannedSlice {
    /// Number of its frame in the recording.
    pub item: u64,
    /// Its time, ns.
    pub time_ns: i64,
    /// Maps its pixels to world mm.
    pub world_from_image: Transform<World, ImageFrame>,
    /// Decisions about it, and the bricks that it may change.
    pub entered: Entered,
}

/// The plan of a sweep's reconstruction.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SweepPlan {
    /// The recording.
    #[serde(with = "file")]
    pub input: SequenceInput,
    /// Settings of the reconstruction.
    pub settings: Settings,
    /// Pixels that are data.
    pub mask: Mask,
    /// The slices that enter, in their order.
    pub slices: Vec<PlannedSlice>,
}

/// A recording in a plan's file: its path. Frames in memory have none.
mod file {
    use std::path::PathBuf;

    use drivers::replay::SequenceSettings;
    use serde::ser::Error as _;
    use serde::{Deserialize as _, Deserializer, Serialize as _, Serializer};

    use crate::session::SequenceInput;

    pub(super) fn serialize<S: Serializer>(input: &SequenceInput, to: S) -> Result<S::Ok, S::Error> {
        match input {
            SequenceInput::File(settings) => settings.path.serialize(to),
            SequenceInput::Frames(_) => Err(S::Error::custom("frames in memory have no file; write them to one")),
        }
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<SequenceInput, D::Error> {
        Ok(SequenceInput::File(SequenceSettings::new(PathBuf::deserialize(from)?)))
    }
}

/// Collects the slices that enter.
#[derive(Default)]
struct Collector(Mutex<Vec<PlannedSlice>>);

impl Observer for Collector {
    fn inserted(&self, inserted: &InsertedSlice<'_>) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        let Some(entered) = inserted.reconstructor.last() else { return Ok(()) };
        let slice = inserted.slice;
        let (item, time_ns, world_from_image) = (inserted.item, slice.time_ns, slice.world_from_image);
        let mut slices = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        slices.push(PlannedSlice { item, time_ns, world_from_image, entered });
        Ok(())
    }
}

impl SweepPlan {
    /// Plans a sweep by the session that would reconstruct it, which inserts nothing: the mask, the
    /// pairing, the refusals and their counts are the same. The general path is taken. Calls
    /// `watch` every 20 ms with the status. Returns also the outcome of all frames, with an empty
    /// volume.
    ///
    /// # Errors
    /// [`PipelineError`] if no frame can be used, or the run as a whole fails.
    pub fn new(
        mut session: Session,
        sequence: Sequence,
        mut watch: impl FnMut(&SessionStatus),
    ) -> Result<(Self, Outcome), PipelineError> {
        let collector = Arc::new(Collector::default());
        session.settings.region = Some(BrickBox::EMPTY);
        session.observers.push(Arc::clone(&collector) as Arc<dyn Observer>);
        let input = sequence.input().clone();
        let source = SessionInputs::of(Source::Sequence(sequence));
        let ran = run(&session, source, &Monotonic, &AtomicBool::new(false), |status| {
            watch(status);
            Vec::new()
        });
        let Finished { outcome, status, .. } = ran?.finish();
        let outcome = outcome.ok_or_else(|| PipelineError::NothingUsed(Box::new(status.ledger)))?;
        let slices = std::mem::take(&mut *collector.0.lock().unwrap_or_else(PoisonError::into_inner));
        let settings = Settings { region: None, ..outcome.reconstructor.settings().clone() };
        let mask = (*outcome.mask.mask).clone();
        Ok((Self { input, settings, mask, slices }, outcome))
    }
}
