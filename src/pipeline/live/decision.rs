//! What is decided upon frames, as a recording has it: where each was placed, and what became of it.

use drivers::clock::Clock;
use serde::{Deserialize, Serialize};

use super::board::Board;
use super::capture::InFlight;
use super::precedent::Precedent;
use super::recorder::Recorder;
use crate::ledger::Queue;
use crate::refusal::Refusal;
use crate::sync::bracket::{FrameTime, Placed};

/// Kinds of the notes.
pub(super) const PLACED: &str = "placed";
pub(super) const DECISION: &str = "decision";

/// A frame found its pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct PlacedFrame {
    /// Its number.
    pub(super) frame: u64,
    /// When its picture was seen, host ns.
    pub(super) time_ns: i64,
    /// Pixels to world mm: three rows of four.
    pub(super) world_from_image: [f64; 12],
    /// How far the truth may lie from the time, ns.
    pub(super) bound_ns: i64,
    /// What lies between the poses that its own was made of, ns.
    pub(super) gap_ns: i64,
    /// How far a corner of the picture may be off, mm; `None` where nobody knows.
    pub(super) error_mm: Option<f64>,
}

impl PlacedFrame {
    pub(super) fn new(item: u64, frame: &FrameTime, placed: &Placed) -> Self {
        let rows = placed.world_from_image.to_rows();
        let mut world_from_image = [0.0; 12];
        world_from_image.copy_from_slice(&rows[..12]);
        Self {
            frame: item,
            time_ns: frame.time_ns,
            world_from_image,
            bound_ns: frame.bound_ns,
            gap_ns: placed.how.gap_ns(),
            error_mm: Some(placed.error_mm).filter(|mm| mm.is_finite()),
        }
    }

    /// Time and pose, bit by bit.
    pub(super) fn bits(&self) -> (i64, [u64; 12]) {
        (self.time_ns, self.world_from_image.map(f64::to_bits))
    }
}

/// What became of a frame.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Fate {
    /// It is in the volume.
    Used,
    /// It is not: why, by name, and in words.
    Refused { reason: String, detail: String },
    /// It found the queue before a stage full.
    Dropped(Queue),
}

impl Fate {
    pub(super) fn of(refusal: &Refusal) -> Self {
        Self::Refused { reason: refusal.reason.name().into(), detail: refusal.detail.clone() }
    }

    /// In words, without details.
    pub(super) fn words(&self) -> String {
        match self {
            Self::Used => "used".into(),
            Self::Refused { reason, .. } => format!("refused ({reason})"),
            Self::Dropped(queue) => format!("dropped before {}", queue.name()),
        }
    }
}

/// A frame and its fate.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Decided {
    pub(super) frame: u64,
    #[serde(flatten)]
    pub(super) fate: Fate,
}

/// What all stages share.
#[derive(Clone, Copy)]
pub(super) struct Common<'a> {
    pub(super) clock: &'a dyn Clock,
    pub(super) board: &'a Board,
    pub(super) recorder: &'a Recorder,
    pub(super) in_flight: &'a InFlight,
    /// What was decided when this session was live, if it is a recording.
    pub(super) precedent: Option<&'a Precedent>,
}

impl Common<'_> {
    /// A frame has found its pose.
    pub(super) fn placed(&self, item: u64, frame: &FrameTime, placed: &Placed) {
        if self.precedent.is_none() && !self.recorder.records() {
            return;
        }
        let found = PlacedFrame::new(item, frame, placed);
        if let Some(precedent) = self.precedent {
            precedent.placed(&found);
        }
        self.recorder.note(PLACED, &found, self.clock.now_ns());
    }

    fn decide(&self, frame: u64, fate: Fate) {
        self.in_flight.leave();
        if let Some(precedent) = self.precedent {
            precedent.decided(frame, &fate);
        }
        self.recorder.note(DECISION, &Decided { frame, fate }, self.clock.now_ns());
    }

    /// A frame that was on its way is in the volume.
    pub(super) fn used(&self, item: u64) {
        self.decide(item, Fate::Used);
    }

    /// A frame that was on its way is refused.
    pub(super) fn refuse(&self, refusal: &Refusal) {
        self.board.refused(refusal);
        self.decide(refusal.item, Fate::of(refusal));
    }

    /// A frame that was on its way found a queue full.
    pub(super) fn drop_before(&self, queue: Queue, item: u64) {
        self.board.dropped_frame(queue);
        self.decide(item, Fate::Dropped(queue));
    }
}
