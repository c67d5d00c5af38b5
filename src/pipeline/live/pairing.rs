//! The pairing thread: readings become samples with times, frames wait for poses about them, and what has a place goes on to the loom.

use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, TrySendError};
use drivers::clock::Clock;
use drivers::reading::Reading;
use serde::Serialize;

use super::board::Board;
use super::capture::{Delivery, InFlight, Word};
use super::recorder::{Decision, Recorder};
use super::weave::{Posed, Times};
use crate::ingest::Picture;
use crate::ingest::live::{Live, LiveIngest};
use crate::ledger::Queue;
use crate::refusal::{Reason, Refusal};
use crate::slice::{Image, Slice};
use crate::sync::bracket::{Answered, Bracketing, FrameTime, Placed, Unplaced};
use crate::sync::clock::Mapping;
use crate::sync::history::Unavailable;

/// The longest that the thread waits before it looks whether frames have waited long enough.
const TURN: Duration = Duration::from_millis(20);

/// A device of the session.
pub(super) struct Part {
    pub(super) name: String,
    pub(super) ingest: LiveIngest,
    /// Its sources of poses, by their places among all.
    pub(super) sources: Vec<usize>,
}

/// A frame that waits for its pose.
pub(super) struct Waiting {
    item: u64,
    image: Image,
    captured_ns: i64,
}

/// A clock as it was published, for the recording.
#[derive(Serialize)]
struct Published<'a> {
    device: &'a str,
    clock: usize,
    #[serde(flatten)]
    mapping: Mapping,
}

/// Pictures that come again while the probe moves.
struct Frozen {
    last: Option<(Image, [f64; 16])>,
    since_ns: Option<i64>,
    after_ns: i64,
}

impl Frozen {
    /// Whether this picture is the last one's at another pose. What is the same in both, the loom refuses.
    fn is(&mut self, image: &Image, placed: &Placed, captured_ns: i64) -> bool {
        let pose = placed.world_from_image.to_rows();
        let same = self.last.as_ref().is_some_and(|(last, _)| last.pixels().same_bits(image.pixels()));
        let moved = self.last.as_ref().is_some_and(|(_, last)| *last != pose);
        if !same {
            self.since_ns = None;
            self.last = Some((image.clone(), pose));
        } else if moved {
            self.since_ns.get_or_insert(captured_ns);
        }
        same && moved
    }

    /// For how long the scanner has shown one picture, s, if that is long enough to be said.
    fn seconds(&self, now_ns: i64) -> Option<f64> {
        let since = now_ns - self.since_ns?;
        (since >= self.after_ns).then_some(since as f64 * 1e-9)
    }
}

/// What all stages share.
#[derive(Clone, Copy)]
pub(super) struct Common<'a> {
    pub(super) clock: &'a dyn Clock,
    pub(super) board: &'a Board,
    pub(super) recorder: &'a Recorder,
    pub(super) in_flight: &'a InFlight,
}

impl Common<'_> {
    /// A frame that was on its way is refused.
    pub(super) fn refuse(&self, refusal: &Refusal) {
        self.in_flight.leave();
        self.board.refused(refusal);
        self.recorder.decide(refusal.item, &Decision::Refused(refusal), self.clock.now_ns());
    }
}

/// The stage.
pub(super) struct Pairing<'a> {
    common: Common<'a>,
    parts: Vec<Part>,
    bracketing: Bracketing<Waiting>,
    frozen: Frozen,
    onward: Sender<Posed>,
}

impl<'a> Pairing<'a> {
    pub(super) fn new(
        common: Common<'a>,
        parts: Vec<Part>,
        bracketing: Bracketing<Waiting>,
        frozen_ns: i64,
        onward: Sender<Posed>,
    ) -> Self {
        let frozen = Frozen { last: None, since_ns: None, after_ns: frozen_ns };
        Self { common, parts, bracketing, frozen, onward }
    }

    /// Takes what devices deliver until none does any more. Returns what the user should know.
    pub(super) fn run(mut self, from: &Receiver<Delivery>) -> Vec<String> {
        loop {
            match from.recv_timeout(TURN) {
                Ok(delivery) => self.take(delivery),
                Err(RecvTimeoutError::Timeout) => {
                    let now_ns = self.common.clock.now_ns();
                    for source in 0..self.parts.len() {
                        self.parts[source].ingest.advance(now_ns);
                        self.publish(source);
                    }
                }
                Err(RecvTimeoutError::Disconnected) => break,
            }
            while let Some(answered) = self.bracketing.next(self.common.clock.now_ns()) {
                self.answer(answered);
            }
        }
        while let Some(answered) = self.bracketing.finish(self.common.clock.now_ns()) {
            self.answer(answered);
        }
        self.parts.iter().flat_map(|part| part.ingest.notes().to_vec()).collect()
    }

    fn take(&mut self, Delivery { source, word }: Delivery) {
        let reading = match word {
            Word::SetUp(timing) => {
                self.parts[source].ingest.set_up(timing);
                return self.publish(source);
            }
            Word::Reading(reading) => reading,
        };
        let captured_ns = match &reading {
            Reading::Frame(frame) => frame.stamp.host_ns,
            _ => None,
        };
        let live = self.parts[source].ingest.take(reading);
        self.publish(source);
        let board = self.common.board;
        match live {
            Live::Pose { source: own, sample, .. } => {
                board.sampled(source, sample.invalid.is_some().then_some("not valid, by the device's word"));
                if let Some(into) = self.parts[source].sources.get(own) {
                    self.bracketing.pose(*into, sample);
                }
            }
            Live::Waits(_) => board.sampled(source, None),
            Live::Picture { picture: Picture { head, image }, timed } => {
                let captured_ns = captured_ns.unwrap_or(timed.time_ns);
                let waiting = Waiting { item: head.stamp.item, image, captured_ns };
                let frame = FrameTime::new(&timed, head.size);
                if let Some(crowded) = self.bracketing.frame(frame, self.common.clock.now_ns(), waiting) {
                    self.answer(crowded);
                }
            }
            Live::Refused(refusal) if captured_ns.is_some() => self.common.refuse(&refusal),
            Live::Refused(refusal) => board.sampled(source, Some(refusal.reason.name())),
            Live::Unused(kind) => board.sampled(source, Some(kind)),
        }
    }

    /// What a device's clocks have published is recorded.
    fn publish(&mut self, source: usize) {
        let Part { name, ingest, .. } = &mut self.parts[source];
        while let Some((clock, mapping)) = ingest.take_published() {
            let published = Published { device: name, clock, mapping };
            self.common.recorder.note("clock", &published, self.common.clock.now_ns());
        }
    }

    /// A frame need not wait any longer.
    fn answer(&mut self, answered: Answered<Waiting>) {
        let Answered { payload: Waiting { item, image, captured_ns }, frame, answer, .. } = answered;
        let now_ns = self.common.clock.now_ns();
        let refusal = match answer {
            Ok(placed) if self.frozen.is(&image, &placed, captured_ns) => {
                self.common.board.frozen(self.frozen.seconds(captured_ns));
                Refusal::new(item, Reason::SamePicture, "the picture is the last one's, and the probe has moved")
            }
            Ok(placed) => {
                self.common.board.frozen(None);
                let slice = Slice { image, time_ns: frame.time_ns, world_from_image: placed.world_from_image };
                let posed = Posed { item, slice, times: Times { captured_ns, known_ns: now_ns } };
                match self.onward.try_send(posed) {
                    Ok(()) => {}
                    Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => {
                        self.common.in_flight.leave();
                        self.common.board.dropped_frame(Queue::Weaving);
                        self.common.recorder.decide(item, &Decision::Dropped, now_ns);
                    }
                }
                return;
            }
            Err(unplaced) => {
                let reason = match &unplaced {
                    Unplaced::FrameClockLost | Unplaced::Pose { why: Unavailable::ClockLost, .. } => {
                        Reason::TimeInvalid
                    }
                    Unplaced::Pose { why: Unavailable::Invalid { .. }, .. } => Reason::PoseInvalid,
                    Unplaced::Pose { .. } => Reason::PoseMissing,
                };
                Refusal::new(item, reason, unplaced.to_string())
            }
        };
        self.common.refuse(&refusal);
    }
}
