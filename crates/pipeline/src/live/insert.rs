//! The insertion thread: inserts slices into the volume, in the order in which they got their
//! poses.

use std::collections::VecDeque;
use std::num::NonZeroU64;
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError};

use sonoweave_core::refusal::{Reason, Refusal};
use sonoweave_core::slice::Slice;

use super::common::Common;
use super::pulse::Stage;
use super::shared_volume::{PendingChanges, Shared, SharedVolume};
use crate::inserter::OutcomeSink;
use crate::{InsertedSlice, PipelineError};

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
}

/// Times, host ns.
#[derive(Debug, Clone, Copy)]
pub(super) struct Times {
    /// Capture time of the frame.
    pub(super) captured_ns: i64,
    /// Arrival time of the reading that made its pose known.
    pub(super) known_ns: i64,
}

/// Reports the outcome of slices, some of which have waited for the mask.
struct OutcomeReporter<'a> {
    common: Common<'a>,
    waiting: &'a mut VecDeque<(u64, Option<Times>)>,
    news: &'a mut PendingChanges,
}

impl OutcomeReporter<'_> {
    /// Removes a decided slice from the waiting ones; returns its times.
    fn leaves(&mut self, item: u64) -> Option<Option<Times>> {
        let place = self.waiting.iter().position(|(waiting, _)| *waiting == item)?;
        self.waiting.remove(place).map(|(_, times)| times)
    }
}

impl OutcomeSink for OutcomeReporter<'_> {
    fn woven(&mut self, woven: &InsertedSlice<'_>) -> Result<(), PipelineError> {
        let Some(times) = self.leaves(woven.item) else { return Ok(()) };
        let Common { clock, board, observers, .. } = self.common;
        self.news.note(woven, times.map(|times| times.captured_ns));
        let mut account = board.lock();
        account.volume = self.news.bulk();
        account.ledger.used();
        let path = woven.weaver.path().name();
        if account.path != Some(path) {
            let departure = woven.weaver.upgraded().map(|departure| departure.to_string());
            (account.path, account.path_reason) = (Some(path), departure.unwrap_or_else(|| woven.path_reason.into()));
        }
        if let Some(times) = times {
            let now_ns = clock.now_ns();
            account.first_slice_ns.get_or_insert(now_ns);
            account.capture_to_volume.add_ns(now_ns - times.captured_ns);
            account.pose_to_volume.add_ns(now_ns - times.known_ns);
        }
        drop(account);
        self.common.used(woven.item);
        observers.iter().try_for_each(|observer| observer.inserted(woven)).map_err(PipelineError::Observer)
    }

    fn refused(&mut self, refusal: &Refusal) {
        self.leaves(refusal.item);
        self.common.refuse(refusal);
    }
}

/// Clears the volume, after the slices that wait for the mask were inserted.
fn clear(
    shared: &Shared,
    common: Common<'_>,
    waiting: &mut VecDeque<(u64, Option<Times>)>,
) -> Result<(), PipelineError> {
    let mut fabric = shared.lock();
    let SharedVolume { loom, news, .. } = &mut *fabric;
    loom.clear(&mut OutcomeReporter { common, waiting, news })?;
    news.clear();
    common.board.lock().volume = None;
    drop(fabric);
    shared.tell();
    Ok(())
}

/// Inserts slices until none follows. If `ends`, slices that wait for the mask are then inserted
/// too. If every n-th slice is rendered, insertion waits for its picture; after a wait for the
/// mask, for the picture of the last slice.
///
/// # Errors
/// Causes that prevent insertion of any slice. A full volume is not an error: its slices are
/// refused.
pub(super) fn run(
    shared: &Shared,
    from: &Receiver<InsertMessage>,
    common: Common<'_>,
    ends: bool,
    pictured: Option<NonZeroU64>,
) -> Result<(), PipelineError> {
    let mut waiting = VecDeque::new();
    let mut result = Ok(());
    let beat = common.board.pulse.of(Stage::Weaving);
    loop {
        beat.turn();
        let Posed { item, slice, times } = match from.recv_timeout(TURN) {
            Ok(InsertMessage::Slice(posed)) => posed,
            Ok(InsertMessage::Clear) => {
                result = clear(shared, common, &mut waiting);
                match result {
                    Ok(()) => continue,
                    Err(_) => break,
                }
            }
            Err(RecvTimeoutError::Timeout) => continue,
            Err(RecvTimeoutError::Disconnected) => break,
        };
        waiting.push_back((item, times));
        let mut fabric = shared.lock();
        let SharedVolume { loom, news, .. } = &mut *fabric;
        let before = news.woven;
        let mut teller = OutcomeReporter { common, waiting: &mut waiting, news };
        let taken = loom.take(item, slice, &mut teller);
        match taken {
            Ok(()) => {}
            Err(PipelineError::Memory { item, source }) => {
                teller.refused(&Refusal::new(item, Reason::VolumeFull, source.to_string()));
            }
            Err(error) => {
                result = Err(error);
                break;
            }
        }
        let woven = news.woven;
        drop(fabric);
        shared.tell();
        if pictured.is_some_and(|every| woven / every > before / every) {
            shared.await_picture();
        }
    }
    let mut fabric = shared.lock();
    let SharedVolume { loom, news, ended, .. } = &mut *fabric;
    if result.is_ok() && ends {
        let mut teller = OutcomeReporter { common, waiting: &mut waiting, news };
        result = loom.end(&mut teller);
    }
    *ended = true;
    drop(fabric);
    shared.tell();
    result
}
