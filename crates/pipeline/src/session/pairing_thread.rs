//! The pairing thread: converts readings to timed samples, holds frames until the poses around
//! them are known, and passes posed slices to the inserter.

use crossbeam_channel::Sender;
use tracing::{Span, trace_span};

use sonoweave_core::ledger::Queue;
use sonoweave_core::reading::Reading;
use sonoweave_core::refusal::{Reason, Refusal};
use sonoweave_core::slice::{Image, Slice};
use sync::history::Unavailable;
use sync::ingest::Picture;
use sync::ingest::live::{Live, LiveIngest};
use sync::pairing::timed::{Answered, FrameTime, Placed, TimedPairing, Unplaced};
use sync::smoothing::noise_of;

use super::common::Common;
use super::event::{ADVANCE_EVERY_NS, CLOCK, Delivery, Feed, FeedEvent, Published, SessionEvent};
use super::insertion_thread::{InsertMessage, Posed, Times};
use super::stuck::StuckDetector;
use super::turns::Stage;
use super::zones::Guard;
use crate::CapturedFrame;
use crate::smoothing::SensorNoise;
use crate::trace::STAGE;

/// A device of the session.
pub(super) struct Part {
    pub(super) name: String,
    pub(super) ingest: LiveIngest,
    /// Its pose sources, by their indices among all.
    pub(super) sources: Vec<usize>,
}

/// A frame that waits for its pose.
pub(super) struct Waiting {
    item: u64,
    image: Image,
    captured_ns: i64,
    /// Trace span of its wait.
    waits: Span,
}

/// The pairing stage. Its result depends only on the events and their times, on no clock: a
/// replay of them reproduces it.
pub(super) struct Pairing<'a> {
    common: Common<'a>,
    parts: Vec<Part>,
    timed: TimedPairing<Waiting>,
    stuck: StuckDetector,
    /// Whether the user has frozen the session.
    frozen: bool,
    /// Monitor of the zones in which the tracker's field is distorted, if there are any.
    guard: Option<Guard>,
    /// The coordinate frames of all pose sources, for the observers.
    frames: Vec<[String; 2]>,
    sender: SliceSink,
    /// Time of the last event, and of the last advance of the clocks, host ns.
    now_ns: i64,
    advanced_ns: i64,
}

/// The slice sink.
pub(super) enum SliceSink {
    /// For live devices, which never wait: a slice that finds the queue full is dropped.
    OrDrop(Sender<InsertMessage>),
    /// For a recording, which waits for room.
    Waits(Sender<InsertMessage>),
    /// For poses alone.
    Nowhere,
}

impl SliceSink {
    /// Passes an order on, after the slices that are on their way. It is never dropped: insertion
    /// soon makes room, or has ended.
    fn order(&self, message: InsertMessage) {
        if let Self::OrDrop(sender) | Self::Waits(sender) = self {
            drop(sender.send(message));
        }
    }
}

impl<'a> Pairing<'a> {
    pub(super) fn new(
        common: Common<'a>,
        parts: Vec<Part>,
        timed: TimedPairing<Waiting>,
        stuck: StuckDetector,
        guard: Option<Guard>,
        frames: Vec<[String; 2]>,
        sender: SliceSink,
    ) -> Self {
        let (now_ns, advanced_ns) = (i64::MIN, i64::MIN);
        Self { common, parts, timed, stuck, frozen: false, guard, frames, sender, now_ns, advanced_ns }
    }

    /// Handles events until the feed ends. Returns notes for the user.
    pub(super) fn run(mut self, feed: &mut impl Feed) -> Vec<String> {
        let turns = self.common.status.turns.begin(Stage::Pairing);
        while let Some(event) = feed.next() {
            turns.turn();
            let (now_ns, delivery) = match event {
                FeedEvent::Delivery(delivery) => (delivery.at_ns, Some(delivery)),
                FeedEvent::Quiet(now_ns) => (now_ns, None),
            };
            self.now_ns = self.now_ns.max(now_ns);
            // Expires frames before handling this event, so that idle gaps cannot change the
            // result.
            self.answer_all();
            if let Some(delivery) = delivery {
                self.advance_clocks();
                self.take(delivery);
                self.answer_all();
            }
        }
        while let Some(answered) = self.timed.finish(self.now_ns) {
            self.answer(answered);
        }
        // No estimate was due in a short session.
        if self.common.status.lock().smoothing.as_ref().is_some_and(|account| account.sensors.is_empty()) {
            self.estimate_noise();
        }
        self.parts.iter().flat_map(|part| part.ingest.notes().to_vec()).collect()
    }

    fn answer_all(&mut self) {
        while let Some(answered) = self.timed.next(self.now_ns) {
            self.answer(answered);
        }
    }

    /// Advances all clocks periodically, also those of silent devices.
    fn advance_clocks(&mut self) {
        if self.now_ns.saturating_sub(self.advanced_ns) < ADVANCE_EVERY_NS {
            return;
        }
        self.advanced_ns = self.now_ns;
        for source in 0..self.parts.len() {
            self.parts[source].ingest.advance(self.now_ns);
            self.publish(source);
        }
    }

    fn take(&mut self, Delivery { source, event, .. }: Delivery) {
        let reading = match event {
            SessionEvent::SetUp(timing) => {
                self.parts[source].ingest.set_up(timing);
                return self.publish(source);
            }
            SessionEvent::Latency(latency_ns) => {
                self.parts[source].ingest.set_latency(latency_ns);
                return self.publish(source);
            }
            SessionEvent::Freeze(on) => {
                self.frozen = on;
                return self.common.status.freeze(on);
            }
            SessionEvent::Clear => {
                self.common.observers.iter().for_each(|observer| observer.cleared());
                return self.sender.order(InsertMessage::Clear);
            }
            SessionEvent::Mask(change) => return self.sender.order(InsertMessage::Mask(change)),
            SessionEvent::Reading(reading) => reading,
        };
        let captured_ns = match &reading {
            Reading::Frame(frame) => frame.stamp.host_ns,
            _ => None,
        };
        let is_frame = matches!(reading, Reading::Frame(_));
        let _span = is_frame.then(|| trace_span!(target: STAGE, "pair", frame = reading.stamp().item).entered());
        let live = self.parts[source].ingest.take(reading);
        self.publish(source);
        let status = self.common.status;
        match live {
            Live::Pose { source: own, sample, .. } => {
                status.sampled(source, sample.invalid.is_some().then_some("not valid, by the device's word"));
                if let Some(into) = self.parts[source].sources.get(own) {
                    if let Some([from, to]) = self.frames.get(*into) {
                        self.common.observers.iter().for_each(|observer| observer.pose([from, to], &sample));
                    }
                    self.timed.pose(*into, sample);
                }
            }
            Live::Waits(_) => status.sampled(source, None),
            Live::Picture { picture: Picture { head, .. }, .. } if self.frozen => {
                self.common.refuse(&Refusal::new(head.stamp.item, Reason::Frozen, "the session is frozen"));
            }
            Live::Picture { picture: Picture { head, image }, timed } => {
                let captured_ns = captured_ns.unwrap_or(timed.time_ns);
                let item = head.stamp.item;
                let frame = CapturedFrame { item, captured_ns, image: &image };
                self.common.observers.iter().for_each(|observer| observer.captured(&frame));
                // The span has no parent, since it outlasts all others.
                let waits = trace_span!(target: STAGE, parent: None, "wait for pose", frame = item);
                let waiting = Waiting { item, image, captured_ns, waits };
                let frame = FrameTime::new(&timed, head.size);
                if let Some(crowded) = self.timed.frame(frame, self.now_ns, waiting) {
                    self.answer(crowded);
                }
            }
            Live::Refused(refusal) if is_frame => self.common.refuse(&refusal),
            Live::Refused(refusal) => status.sampled(source, Some(refusal.reason.name())),
            Live::Unused(kind) => status.sampled(source, Some(kind)),
        }
    }

    /// Records the mappings that a device's clocks have published.
    fn publish(&mut self, source: usize) {
        let Part { name, ingest, .. } = &mut self.parts[source];
        while let Some((clock, mapping)) = ingest.take_published() {
            self.common.status.clock(source, clock, &mapping);
            let published = Published { device: name, clock, mapping };
            self.common.recorder.note(CLOCK, &published, self.common.clock.now_ns());
        }
    }

    /// Handles a frame that need not wait any longer.
    fn answer(&mut self, answered: Answered<Waiting>) {
        let Answered { payload: Waiting { item, image, captured_ns, waits }, frame, answer, .. } = answered;
        drop(waits);
        let refusal = match answer {
            Ok(placed) if self.stuck.is(&image, &placed, captured_ns) => {
                self.common.status.stuck(self.stuck.since_ns(captured_ns));
                Refusal::new(item, Reason::SamePicture, "the picture is the last one's, and the probe has moved")
            }
            Ok(placed) => {
                self.common.status.stuck(None);
                self.common.placed(item, &frame, &placed);
                self.count_smoothing(&placed);
                self.watch(&frame);
                if let Some(queue) = self.common.decisions.and_then(|decisions| decisions.was_dropped(item)) {
                    return self.common.drop_before(queue, item);
                }
                let (world_from_image, image) = match self.common.decisions {
                    Some(decisions) => match decisions.corrected(item, placed.world_from_image) {
                        Ok(pose) => (pose, decisions.corrected_image(item, image, &pose)),
                        Err(refusal) => return self.common.refuse(&refusal),
                    },
                    None => (placed.world_from_image, image),
                };
                let slice = Slice { image, time_ns: frame.time_ns, world_from_image };
                let world = self.timed.route().world();
                self.common.observers.iter().for_each(|observer| observer.slice(world, item, &slice));
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

    /// Counts a frame's smoothing, and sometimes estimates the sensors' noise.
    fn count_smoothing(&self, placed: &Placed) {
        let Some(effect) = &placed.smoothing else { return };
        let is_due = self.common.status.lock().smoothing.as_mut().is_some_and(|account| account.count(effect));
        if is_due {
            self.estimate_noise();
        }
    }

    /// Estimates the noise of the sensors from their latest poses.
    fn estimate_noise(&self) {
        let noise =
            |(at, [from, to]): (usize, &[String; 2])| SensorNoise::of([from, to], noise_of(self.timed.history(at)?));
        let sensors = self.frames.iter().enumerate().filter_map(noise).collect();
        if let Some(account) = &mut self.common.status.lock().smoothing {
            account.sensors = sensors;
        }
    }

    /// Checks whether a frame was taken where the tracker's field is distorted.
    fn watch(&mut self, frame: &FrameTime) {
        let Some(guard) = &mut self.guard else { return };
        let history = self.timed.history(guard.source);
        if let Some(found) = history.and_then(|history| history.at(frame.time_ns).ok())
            && let Some(found) = guard.check(found.pose().position_mm)
        {
            self.common.status.in_zones(found);
        }
    }

    /// Passes a slice to the inserter.
    fn pass(&self, item: u64, slice: Slice, captured_ns: i64) {
        let is_full = match &self.sender {
            SliceSink::OrDrop(sender) => {
                let times = Some(Times { captured_ns, known_ns: self.now_ns });
                sender.try_send(InsertMessage::Slice(Posed { item, slice, times })).is_err()
            }
            SliceSink::Waits(sender) => sender.send(InsertMessage::Slice(Posed { item, slice, times: None })).is_err(),
            SliceSink::Nowhere => false,
        };
        if is_full {
            self.common.drop_before(Queue::Insertion, item);
        }
    }
}
