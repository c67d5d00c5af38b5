//! The insertion thread: inserts slices into the volume, in the order in which they got their
//! poses.

use std::collections::VecDeque;
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError};

use mask::{MaskChange, MaskFound};
use sonoweave_core::refusal::{Reason, Refusal};
use sonoweave_core::slice::Slice;

use super::common::Common;
use super::every::{DueTime, Every};
use super::shared_volume::{PendingChanges, Shared, SharedVolume};
use super::turns::Stage;
use crate::inserter::{OutcomeSink, VolumeInserter};
use crate::{InsertedSlice, MaskOrigin, MaskRefusal, PipelineError};

/// Longest wait before the thread counts a turn, which shows that it is alive.
const TURN: Duration = Duration::from_millis(100);

/// A slice, with the arrival times of its data.
pub(super) struct Posed {
    /// Its frame's number.
    pub(super) item: u64,
    pub(super) slice: Slice,
    /// `None` in a replay, whose times are past.
    pub(super) times: Option<Times>,
}

/// An insert message; they are handled in order.
#[allow(clippy::large_enum_variant, reason = "nearly all values are the large ones, moved twice")]
pub(super) enum InsertMessage {
    /// A slice.
    Slice(Posed),
    /// The following slices go into an empty volume.
    Clear,
    /// The following slices have another mask.
    Mask(MaskChange),
}

/// Times, host ns.
#[derive(Debug, Clone, Copy)]
pub(super) struct Times {
    /// Capture time of the frame.
    pub(super) captured_ns: i64,
    /// Arrival time of the reading that made its pose known.
    pub(super) known_ns: i64,
}

/// Treatment of slices by the insertion thread.
#[derive(Debug, Clone, Copy)]
pub(super) struct Insertion {
    /// Whether no source follows: slices that wait for the mask are then inserted at the end.
    pub(super) is_last: bool,
    /// The slices after which insertion waits for the picture; after a wait for the mask, for the
    /// picture of the last slice.
    pub(super) every: Option<Every>,
    /// Whether the slices are a sequence's: a full volume is then an error, and the time of each
    /// insertion is kept. A session goes on without the slices that do not fit.
    pub(super) of_sequence: bool,
}

/// Reports the outcome of slices, some of which have waited for the mask.
struct OutcomeReporter<'a> {
    common: Common<'a>,
    waiting: &'a mut VecDeque<(u64, Option<Times>)>,
    pending: &'a mut PendingChanges,
    /// Insertion times, ms, if they are kept.
    insert_ms: Option<&'a mut Vec<f64>>,
}

impl OutcomeReporter<'_> {
    /// Removes a decided slice from the waiting ones; returns its times.
    fn leaves(&mut self, item: u64) -> Option<Option<Times>> {
        let place = self.waiting.iter().position(|(waiting, _)| *waiting == item)?;
        self.waiting.remove(place).map(|(_, times)| times)
    }
}

impl OutcomeSink for OutcomeReporter<'_> {
    fn inserted(&mut self, inserted: &InsertedSlice<'_>) -> Result<(), PipelineError> {
        let Some(times) = self.leaves(inserted.item) else { return Ok(()) };
        let Common { clock, status, observers, .. } = self.common;
        if let Some(insert_ms) = &mut self.insert_ms {
            insert_ms.push(inserted.insert.as_secs_f64() * 1e3);
        }
        self.pending.note(inserted, times.map(|times| times.captured_ns));
        let observer_bytes = observers.iter().map(|observer| observer.held_bytes()).sum();
        let mut status = status.lock();
        status.volume = self.pending.extent();
        status.memory.observer_bytes = observer_bytes;
        let weighs_shadows = inserted.reconstructor.settings().shadow_weights.is_some();
        status.dark_slices = weighs_shadows.then(|| inserted.reconstructor.work().without_shadows);
        let volume = inserted.reconstructor.volume();
        (status.memory.volume_bytes, status.memory.growth_bytes) = (volume.bytes(), volume.growth_bytes());
        status.ledger.used();
        let path = inserted.reconstructor.path().name();
        if status.path != Some(path) {
            let departure = inserted.reconstructor.upgraded().map(|departure| departure.to_string());
            (status.path, status.path_reason) = (Some(path), departure.unwrap_or_else(|| inserted.path_reason.into()));
        }
        if let Some(times) = times {
            let now_ns = clock.now_ns();
            status.first_slice_ns.get_or_insert(now_ns);
            status.capture_to_volume.add_ns(now_ns - times.captured_ns);
            status.pose_to_volume.add_ns(now_ns - times.known_ns);
        }
        drop(status);
        self.common.used(inserted.item);
        observers.iter().try_for_each(|observer| observer.inserted(inserted)).map_err(PipelineError::Observer)
    }

    fn refused(&mut self, refusal: &Refusal) {
        self.leaves(refusal.item);
        self.common.refuse(refusal);
    }

    fn masked(&mut self, found: &MaskFound, origin: MaskOrigin) {
        tracing::info!(?origin, "mask: {found}");
        self.common.status.masked(found, origin);
    }

    fn mask_refused(&mut self, refusal: &MaskRefusal) {
        self.common.status.note(format!("the mask is not changed: {refusal}"));
    }
}

/// The insertion thread.
struct Inserting<'a> {
    shared: &'a Shared,
    common: Common<'a>,
    insertion: Insertion,
    /// Slices without outcome: they wait for the mask.
    waiting: VecDeque<(u64, Option<Times>)>,
    insert_ms: Vec<f64>,
    due: DueTime,
}

impl Inserting<'_> {
    /// Changes the volume, under its lock. Returns how many slices were inserted before and after.
    fn change(
        &mut self,
        act: impl FnOnce(&mut VolumeInserter, &mut OutcomeReporter<'_>) -> Result<(), PipelineError>,
    ) -> Result<[u64; 2], PipelineError> {
        let Self { shared, common, insertion, waiting, insert_ms, .. } = self;
        let mut volume = shared.lock();
        let SharedVolume { inserter, pending, .. } = &mut *volume;
        let before = pending.inserted;
        let insert_ms = insertion.of_sequence.then_some(insert_ms);
        let mut reporter = OutcomeReporter { common: *common, waiting, pending, insert_ms };
        let acted = match act(inserter, &mut reporter) {
            Err(PipelineError::Memory { item, source }) if !insertion.of_sequence => {
                reporter.refused(&Refusal::new(item, Reason::VolumeFull, source.to_string()));
                Ok(())
            }
            acted => acted,
        };
        let after = volume.pending.inserted;
        drop(volume);
        shared.notify();
        acted.map(|()| [before, after])
    }

    fn handle(&mut self, message: InsertMessage) -> Result<(), PipelineError> {
        match message {
            InsertMessage::Slice(Posed { item, slice, times }) => {
                if let Some(Every::Millihertz(rate)) = self.insertion.every
                    && self.due.passes(slice.time_ns, &self.shared.lock().pending, rate)
                {
                    self.shared.await_picture();
                }
                self.waiting.push_back((item, times));
                let [before, after] = self.change(|inserter, reporter| inserter.insert(item, slice, reporter))?;
                if let Some(Every::Slices(every)) = self.insertion.every
                    && after / every > before / every
                {
                    self.shared.await_picture();
                }
            }
            InsertMessage::Mask(change) => {
                self.change(|inserter, reporter| inserter.change_mask(&change, reporter))?;
            }
            // Slices that wait for the mask are inserted before.
            InsertMessage::Clear => {
                self.change(|inserter, reporter| {
                    inserter.clear(reporter)?;
                    reporter.pending.clear();
                    let mut status = reporter.common.status.lock();
                    (status.volume, status.memory.volume_bytes, status.memory.growth_bytes) = (None, 0, 0);
                    drop(status);
                    Ok(())
                })?;
            }
        }
        Ok(())
    }
}

/// Inserts slices until none follows. Returns the insertion times of a sequence's slices, ms.
///
/// # Errors
/// Causes that prevent insertion of any slice.
pub(super) fn run(
    shared: &Shared,
    messages: &Receiver<InsertMessage>,
    common: Common<'_>,
    insertion: Insertion,
) -> Result<Vec<f64>, PipelineError> {
    let mut inserting = Inserting {
        shared,
        common,
        insertion,
        waiting: VecDeque::new(),
        insert_ms: Vec::new(),
        due: DueTime::default(),
    };
    let turns = common.status.turns.begin(Stage::Insertion);
    let mut result = loop {
        turns.turn();
        match messages.recv_timeout(TURN) {
            Ok(message) => {
                if let Err(error) = inserting.handle(message) {
                    break Err(error);
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break Ok(()),
        }
    };
    if result.is_ok() && insertion.is_last {
        result = inserting.change(|inserter, reporter| inserter.end(reporter)).map(drop);
    }
    shared.end();
    result.map(|()| inserting.insert_ms)
}
