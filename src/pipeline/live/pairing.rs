//! The pairing thread: readings become samples with times, frames wait for poses about them, and what has a place goes on to the loom.

use std::sync::Arc;
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender};
use drivers::clock::MS;
use drivers::reading::Reading;
use serde::Serialize;
use tracing::{Span, trace_span};

use super::decision::Common;
use super::frozen::Frozen;
use super::intake::{Delivery, Intake, Word};
use super::pulse::Stage;
use super::weave::{Onto, Posed, Times};
use super::witness::{Glimpsed, Witness};
use super::zones::Guard;
use crate::ingest::Picture;
use crate::ingest::live::{Live, LiveIngest};
use crate::ledger::Queue;
use crate::refusal::{Reason, Refusal};
use crate::slice::{Image, Slice};
use crate::sync::bracket::{Answered, Bracketing, FrameTime, Unplaced};
use crate::sync::clock::Mapping;
use crate::sync::history::Unavailable;
use crate::trace::STAGE;

/// The longest that the thread waits before it looks whether frames have waited long enough.
const TURN: Duration = Duration::from_millis(20);
/// Between two times that clocks are told the time, ns.
pub(super) const TOLD_EVERY_NS: i64 = 20 * MS;

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
    /// The time that it waits.
    waits: Span,
}

/// The kind of note that a clock is published by.
pub(super) const CLOCK: &str = "clock";

/// A clock as it was published, for the recording.
#[derive(Serialize)]
struct Published<'a> {
    device: &'a str,
    clock: usize,
    #[serde(flatten)]
    mapping: Mapping,
}

/// Where deliveries come from.
pub(super) trait Feed {
    /// The next; `None` when nothing comes any more.
    fn next(&mut self) -> Option<Came>;
}

/// What comes.
#[allow(clippy::large_enum_variant, reason = "nearly all values are the large ones, moved once")]
pub(super) enum Came {
    /// A device has delivered.
    Delivery(Delivery),
    /// Nobody has until this host time, ns, and nothing that is delivered later has an earlier one.
    Quiet(i64),
}

/// Of devices.
pub(super) struct FromDevices<'a> {
    pub(super) from: &'a Receiver<Delivery>,
    pub(super) intake: &'a Intake<'a>,
}

impl Feed for FromDevices<'_> {
    fn next(&mut self) -> Option<Came> {
        loop {
            match self.from.recv_timeout(TURN) {
                Ok(delivery) => return Some(Came::Delivery(delivery)),
                Err(RecvTimeoutError::Timeout) => {
                    if let Some(now_ns) = self.intake.quiet(self.from) {
                        return Some(Came::Quiet(now_ns));
                    }
                }
                Err(RecvTimeoutError::Disconnected) => return None,
            }
        }
    }
}

/// The stage. What it does depends on what comes and on the times at which it came, and on no clock: a recording of them redoes it.
pub(super) struct Pairing<'a> {
    common: Common<'a>,
    parts: Vec<Part>,
    bracketing: Bracketing<Waiting>,
    frozen: Frozen,
    /// Pictures are not used at present.
    paused: bool,
    onlookers: Onlookers,
    onward: Onward,
    /// When something came last, and when clocks were told the time, host ns.
    now_ns: i64,
    told_ns: i64,
}

/// Who looks on, and changes nothing.
pub(super) struct Onlookers {
    /// Where there are zones in which the tracker's field is bent.
    pub(super) guard: Option<Guard>,
    pub(super) witnesses: Vec<Arc<dyn Witness>>,
    /// The frames of all sources of poses, for them.
    pub(super) frames: Vec<[String; 2]>,
}

/// The way to the loom.
pub(super) enum Onward {
    /// Of devices, which nothing holds up: what finds the queue full is dropped.
    OrDrop(Sender<Onto>),
    /// Of a recording, which waits.
    Waits(Sender<Onto>),
}

impl Onward {
    /// The volume begins anew behind the slices that are on their way. That is never dropped: weaving takes what is before it soon, or is over.
    fn clear(&self) {
        let (Self::OrDrop(onward) | Self::Waits(onward)) = self;
        drop(onward.send(Onto::Cleared));
    }
}

impl<'a> Pairing<'a> {
    pub(super) fn new(
        common: Common<'a>,
        parts: Vec<Part>,
        bracketing: Bracketing<Waiting>,
        frozen: Frozen,
        onlookers: Onlookers,
        onward: Onward,
    ) -> Self {
        let (now_ns, told_ns) = (i64::MIN, i64::MIN);
        Self { common, parts, bracketing, frozen, paused: false, onlookers, onward, now_ns, told_ns }
    }

    /// Takes what comes until nothing does any more. Returns what the user should know.
    pub(super) fn run(mut self, feed: &mut impl Feed) -> Vec<String> {
        let beat = self.common.board.pulse.of(Stage::Pairing);
        while let Some(came) = feed.next() {
            beat.turn();
            let (now_ns, delivery) = match came {
                Came::Delivery(delivery) => (delivery.at_ns, Some(delivery)),
                Came::Quiet(now_ns) => (now_ns, None),
            };
            self.now_ns = self.now_ns.max(now_ns);
            // Frames whose time was over before this came are told so before it is looked at: whether the time passed in quiet or not must make no difference.
            self.answer_all();
            if let Some(delivery) = delivery {
                self.tell_time();
                self.take(delivery);
                self.answer_all();
            }
        }
        while let Some(answered) = self.bracketing.finish(self.now_ns) {
            self.answer(answered);
        }
        self.parts.iter().flat_map(|part| part.ingest.notes().to_vec()).collect()
    }

    fn answer_all(&mut self) {
        while let Some(answered) = self.bracketing.next(self.now_ns) {
            self.answer(answered);
        }
    }

    /// Clocks are told now and then what time it is, also those whose devices say nothing.
    fn tell_time(&mut self) {
        if self.now_ns.saturating_sub(self.told_ns) < TOLD_EVERY_NS {
            return;
        }
        self.told_ns = self.now_ns;
        for source in 0..self.parts.len() {
            self.parts[source].ingest.advance(self.now_ns);
            self.publish(source);
        }
    }

    fn take(&mut self, Delivery { source, word, .. }: Delivery) {
        let reading = match word {
            Word::SetUp(timing) => {
                self.parts[source].ingest.set_up(timing);
                return self.publish(source);
            }
            Word::Latency(latency_ns) => {
                self.parts[source].ingest.set_latency(latency_ns);
                return self.publish(source);
            }
            Word::Paused(paused) => {
                self.paused = paused;
                return self.common.board.paused(paused);
            }
            Word::Cleared => {
                self.onlookers.witnesses.iter().for_each(|witness| witness.cleared());
                return self.onward.clear();
            }
            Word::Reading(reading) => reading,
        };
        let captured_ns = match &reading {
            Reading::Frame(frame) => frame.stamp.host_ns,
            _ => None,
        };
        let is_frame = matches!(reading, Reading::Frame(_));
        let _span = is_frame.then(|| trace_span!(target: STAGE, "pair", frame = reading.stamp().item).entered());
        let live = self.parts[source].ingest.take(reading);
        self.publish(source);
        let board = self.common.board;
        match live {
            Live::Pose { source: own, sample, .. } => {
                board.sampled(source, sample.invalid.is_some().then_some("not valid, by the device's word"));
                if let Some(into) = self.parts[source].sources.get(own) {
                    if let Some([from, to]) = self.onlookers.frames.get(*into) {
                        self.onlookers.witnesses.iter().for_each(|witness| witness.pose([from, to], &sample));
                    }
                    self.bracketing.pose(*into, sample);
                }
            }
            Live::Waits(_) => board.sampled(source, None),
            Live::Picture { picture: Picture { head, .. }, .. } if self.paused => {
                let why = "the session is frozen, by whoever looks at it";
                self.common.refuse(&Refusal::new(head.stamp.item, Reason::Paused, why));
            }
            Live::Picture { picture: Picture { head, image }, timed } => {
                let captured_ns = captured_ns.unwrap_or(timed.time_ns);
                let item = head.stamp.item;
                let glimpsed = Glimpsed { item, captured_ns, image: &image };
                self.onlookers.witnesses.iter().for_each(|witness| witness.glimpsed(&glimpsed));
                // Of no other span: it outlasts them.
                let waits = trace_span!(target: STAGE, parent: None, "wait for pose", frame = item);
                let waiting = Waiting { item, image, captured_ns, waits };
                let frame = FrameTime::new(&timed, head.size);
                if let Some(crowded) = self.bracketing.frame(frame, self.now_ns, waiting) {
                    self.answer(crowded);
                }
            }
            Live::Refused(refusal) if is_frame => self.common.refuse(&refusal),
            Live::Refused(refusal) => board.sampled(source, Some(refusal.reason.name())),
            Live::Unused(kind) => board.sampled(source, Some(kind)),
        }
    }

    /// What a device's clocks have published is recorded.
    fn publish(&mut self, source: usize) {
        let Part { name, ingest, .. } = &mut self.parts[source];
        while let Some((clock, mapping)) = ingest.take_published() {
            self.common.board.clock(source, clock, &mapping);
            let published = Published { device: name, clock, mapping };
            self.common.recorder.note(CLOCK, &published, self.common.clock.now_ns());
        }
    }

    /// A frame need not wait any longer.
    fn answer(&mut self, answered: Answered<Waiting>) {
        let Answered { payload: Waiting { item, image, captured_ns, waits }, frame, answer, .. } = answered;
        drop(waits);
        let refusal = match answer {
            Ok(placed) if self.frozen.is(&image, &placed, captured_ns) => {
                self.common.board.frozen(self.frozen.since_ns(captured_ns));
                Refusal::new(item, Reason::SamePicture, "the picture is the last one's, and the probe has moved")
            }
            Ok(placed) => {
                self.common.board.frozen(None);
                self.common.placed(item, &frame, &placed);
                self.watch(&frame);
                if let Some(queue) = self.common.precedent.and_then(|precedent| precedent.was_dropped(item)) {
                    return self.common.drop_before(queue, item);
                }
                let slice = Slice { image, time_ns: frame.time_ns, world_from_image: placed.world_from_image };
                let world = self.bracketing.route().world();
                self.onlookers.witnesses.iter().for_each(|witness| witness.slice(world, item, &slice));
                return self.pass(item, slice, captured_ns);
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

    /// Whether a frame was taken where the tracker's field is bent.
    fn watch(&mut self, frame: &FrameTime) {
        let Some(guard) = &mut self.onlookers.guard else { return };
        let history = self.bracketing.history(guard.source);
        if let Some(found) = history.and_then(|history| history.at(frame.time_ns).ok()) {
            guard.look(found.pose().position_mm, self.common.board);
        }
    }

    /// On to the loom.
    fn pass(&self, item: u64, slice: Slice, captured_ns: i64) {
        let is_full = match &self.onward {
            Onward::OrDrop(onward) => {
                let times = Some(Times { captured_ns, known_ns: self.now_ns });
                onward.try_send(Onto::Slice(Posed { item, slice, times })).is_err()
            }
            Onward::Waits(onward) => onward.send(Onto::Slice(Posed { item, slice, times: None })).is_err(),
        };
        if is_full {
            self.common.drop_before(Queue::Weaving, item);
        }
    }
}
