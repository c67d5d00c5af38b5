//! State shared by all stages: clock, status, recording, and the frames on their way.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use sonoweave_core::clock::Clock;
use sonoweave_core::ledger::Queue;
use sonoweave_core::refusal::Refusal;
use sync::pairing::timed::{FrameTime, Placed};

use super::decision::{DECISION, Decided, FrameOutcome, PLACED, PlacedFrame};
use super::recorded_decisions::RecordedDecisions;
use super::recorder::Recorder;
use super::status::StatusCollector;
use crate::Observer;

/// Reason of frames that found a queue full.
pub(super) const DROPPED: &str = "dropped";

/// Frames between capture and the volume, over all queues. Their number is limited, which bounds
/// the memory that they hold.
pub(super) struct InFlight {
    frames: AtomicI64,
    most: i64,
}

impl InFlight {
    pub(super) fn new(most: u64) -> Self {
        Self { frames: AtomicI64::new(0), most: i64::try_from(most).unwrap_or(i64::MAX).max(4) }
    }

    /// Counts one more frame if there is room; returns whether there was.
    pub(super) fn enter(&self) -> bool {
        let before = self.frames.fetch_add(1, Ordering::Relaxed);
        if before >= self.most {
            self.leave();
            return false;
        }
        true
    }

    pub(super) fn leave(&self) {
        self.frames.fetch_sub(1, Ordering::Relaxed);
    }
}

/// State shared by all stages.
#[derive(Clone, Copy)]
pub(super) struct Common<'a> {
    pub(super) clock: &'a dyn Clock,
    pub(super) status: &'a StatusCollector,
    pub(super) recorder: &'a Recorder,
    pub(super) in_flight: &'a InFlight,
    /// The recorded decisions, if this session is a replay.
    pub(super) decisions: Option<&'a RecordedDecisions>,
    /// The observers, which change nothing.
    pub(super) observers: &'a [Arc<dyn Observer>],
}

impl Common<'_> {
    /// Records that a frame got its pose.
    pub(super) fn placed(&self, item: u64, frame: &FrameTime, placed: &Placed) {
        if self.decisions.is_none() && !self.recorder.records() {
            return;
        }
        let found = PlacedFrame::new(item, frame, placed);
        if let Some(decisions) = self.decisions {
            decisions.placed(&found);
        }
        self.recorder.note(PLACED, &found, self.clock.now_ns());
    }

    fn decide(&self, frame: u64, outcome: FrameOutcome) {
        self.in_flight.leave();
        if let Some(decisions) = self.decisions {
            decisions.decided(frame, &outcome);
        }
        self.recorder.note(DECISION, &Decided { frame, outcome }, self.clock.now_ns());
    }

    /// Counts a frame on its way as inserted into the volume.
    pub(super) fn used(&self, item: u64) {
        self.decide(item, FrameOutcome::Used);
    }

    /// Counts a frame on its way as refused.
    pub(super) fn refuse(&self, refusal: &Refusal) {
        self.status.refused(refusal);
        self.lost(refusal.item, refusal.reason.name());
        self.decide(refusal.item, FrameOutcome::of(refusal));
    }

    /// Tells the observers of a frame that does not reach the volume.
    pub(super) fn lost(&self, item: u64, reason: &'static str) {
        self.observers.iter().for_each(|observer| observer.lost(item, reason));
    }

    /// Counts a frame on its way as dropped before a full queue.
    pub(super) fn drop_before(&self, queue: Queue, item: u64) {
        self.status.dropped_frame(queue);
        self.lost(item, DROPPED);
        self.decide(item, FrameOutcome::Dropped(queue));
    }
}
