//! The event sequencer: brings all session events into one order. They are recorded and paired
//! in that same order, so that a replay reproduces the pairing.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, TrySendError};

use mask::MaskChange;
use sonoweave_core::ledger::Queue;
use sonoweave_core::{Description, Reading};

use super::common::Common;
use super::event::{
    CLEAR, Clear, Delivery, FREEZE, Feed, FeedEvent, Freeze, LATENCY, Latency, MASK, Masked, NO_DEVICE, SET_UP,
    SessionEvent, SetUp, UNPAIRED, Unpaired,
};

/// Pause between two attempts to pass on an event that must not be dropped.
const PAUSE: Duration = Duration::from_millis(1);

/// The queue to pairing, and the time of its last event.
struct Outlet {
    /// `None` once it is closed.
    sender: Option<Sender<Delivery>>,
    last_ns: i64,
}

/// The event sequencer, shared by the captures. Its lock is held only while a reading is put
/// into two queues.
pub(super) struct EventSequencer<'a> {
    common: Common<'a>,
    names: Vec<String>,
    outlet: Mutex<Outlet>,
}

impl<'a> EventSequencer<'a> {
    /// Returns a sequencer for devices with these names.
    pub(super) fn new(common: Common<'a>, names: Vec<String>, sender: Sender<Delivery>) -> Self {
        Self { common, names, outlet: Mutex::new(Outlet { sender: Some(sender), last_ns: i64::MIN }) }
    }

    fn with<T>(&self, act: impl FnOnce(Option<&Sender<Delivery>>, i64) -> T) -> T {
        let mut outlet = self.outlet.lock().unwrap_or_else(PoisonError::into_inner);
        outlet.last_ns = outlet.last_ns.max(self.common.clock.now_ns());
        act(outlet.sender.as_ref(), outlet.last_ns)
    }

    /// Adds a device's set-up. It is never dropped, since readings have no time without it.
    /// Returns false if pairing has ended.
    pub(super) fn set_up(&self, source: usize, description: &Description) -> bool {
        let recorder = self.common.recorder;
        self.send_undroppable(source, |at_ns| {
            let device = self.names[source].clone();
            recorder.describe(source, description);
            recorder.comes_in(SET_UP, &SetUp { device }, at_ns);
            SessionEvent::SetUp(description.timing)
        })
    }

    /// Sets a device's latency from now on, ns. Returns false if pairing has ended.
    pub(super) fn latency(&self, source: usize, latency_ns: i64) -> bool {
        let recorder = self.common.recorder;
        self.send_undroppable(source, |at_ns| {
            let device = self.names[source].clone();
            recorder.comes_in(LATENCY, &Latency { device, latency_ns }, at_ns);
            SessionEvent::Latency(latency_ns)
        })
    }

    /// Ignores frames from now on, or uses them again. Returns false if pairing has ended.
    pub(super) fn freeze(&self, on: bool) -> bool {
        self.send_undroppable(NO_DEVICE, |at_ns| {
            self.common.recorder.comes_in(FREEZE, &Freeze { on }, at_ns);
            SessionEvent::Freeze(on)
        })
    }

    /// Clears the volume. Returns false if pairing has ended.
    pub(super) fn clear(&self) -> bool {
        self.send_undroppable(NO_DEVICE, |at_ns| {
            self.common.recorder.comes_in(CLEAR, &Clear {}, at_ns);
            SessionEvent::Clear
        })
    }

    /// Changes the mask of later slices. Returns false if pairing has ended.
    pub(super) fn mask(&self, change: MaskChange) -> bool {
        self.send_undroppable(NO_DEVICE, |at_ns| {
            self.common.recorder.comes_in(MASK, &Masked { change }, at_ns);
            SessionEvent::Mask(change)
        })
    }

    fn send_undroppable(&self, source: usize, event: impl Fn(i64) -> SessionEvent) -> bool {
        loop {
            let done = self.with(|sender, at_ns| {
                let Some(sender) = sender else { return Some(false) };
                // The lock is held, so no other thread sends meanwhile.
                (!sender.is_full()).then(|| sender.try_send(Delivery { source, at_ns, event: event(at_ns) }).is_ok())
            });
            match done {
                Some(done) => return done,
                None => std::thread::sleep(PAUSE),
            }
        }
    }

    /// Records a device's reading, and passes it to pairing if there is room. Returns false if
    /// pairing has ended.
    pub(super) fn take(&self, source: usize, reading: Reading) -> bool {
        let Common { status, recorder, in_flight, .. } = self.common;
        self.with(|sender, at_ns| {
            let Some(sender) = sender else { return false };
            if matches!(reading, Reading::Raw(_)) {
                recorder.take(source, reading, at_ns);
                return true;
            }
            let is_frame = matches!(reading, Reading::Frame(_));
            status.arrived(source);
            if sender.is_full() || (is_frame && !in_flight.enter()) {
                status.dropped(source, Queue::Pairing);
                let unpaired = Unpaired { device: self.names[source].clone(), item: reading.stamp().item };
                recorder.comes_in(UNPAIRED, &unpaired, at_ns);
                recorder.take(source, reading, at_ns);
                return true;
            }
            if recorder.records() {
                recorder.take(source, reading.clone(), at_ns);
            }
            !matches!(
                sender.try_send(Delivery { source, at_ns, event: SessionEvent::Reading(reading) }),
                Err(TrySendError::Disconnected(_))
            )
        })
    }

    /// Returns the time if the queue is empty. No later event has an earlier time.
    pub(super) fn quiet(&self, from: &Receiver<Delivery>) -> Option<i64> {
        self.with(|_, now_ns| from.is_empty().then_some(now_ns))
    }

    /// Closes the sequencer: no event follows.
    pub(super) fn close(&self) {
        self.outlet.lock().unwrap_or_else(PoisonError::into_inner).sender = None;
    }
}

/// Longest wait before the thread checks whether frames have waited long enough.
const TURN: Duration = Duration::from_millis(20);
/// The feed of live devices.
pub(super) struct FromDevices<'a> {
    pub(super) events: &'a Receiver<Delivery>,
    pub(super) sequencer: &'a EventSequencer<'a>,
}

impl Feed for FromDevices<'_> {
    fn next(&mut self) -> Option<FeedEvent> {
        loop {
            match self.events.recv_timeout(TURN) {
                Ok(delivery) => return Some(FeedEvent::Delivery(delivery)),
                Err(RecvTimeoutError::Timeout) => {
                    if let Some(now_ns) = self.sequencer.quiet(self.events) {
                        return Some(FeedEvent::Quiet(now_ns));
                    }
                }
                Err(RecvTimeoutError::Disconnected) => return None,
            }
        }
    }
}
