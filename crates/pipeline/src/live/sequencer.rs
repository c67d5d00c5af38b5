//! The event sequencer: brings all session events into one order. They are recorded and paired
//! in that same order, so that a replay reproduces the pairing.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, TrySendError};
use serde::{Deserialize, Serialize};

use sonoweave_core::ledger::Queue;
use sonoweave_core::{Description, Reading, Timing};

use super::decision::Common;

/// Pause between two attempts to pass on an event that must not be dropped.
const PAUSE: Duration = Duration::from_millis(1);

/// Device index of events that belong to no device.
pub(super) const NO_DEVICE: usize = usize::MAX;

/// A session event with its device and time.
pub(super) struct Delivery {
    /// The device, by its index in the session.
    pub(super) source: usize,
    /// Arrival time, host ns; never earlier than the previous one.
    pub(super) at_ns: i64,
    pub(super) word: SessionEvent,
}

/// A session event.
#[allow(clippy::large_enum_variant, reason = "nearly all values are the large ones, moved once")]
pub(super) enum SessionEvent {
    /// The device was set up, possibly again; defines the meaning of its time stamps.
    SetUp(Timing),
    /// The latency of the device's time stamps from now on, ns.
    Latency(i64),
    /// Frames are ignored from now on, or used again; belongs to no device.
    Freeze(bool),
    /// The volume is cleared; belongs to no device.
    Clear,
    /// A reading.
    Reading(Reading),
}

/// Recorded note: a device was set up, as its preceding description states.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct SetUp {
    pub(super) device: String,
}

/// Recorded note: a device's latency from here on.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Latency {
    pub(super) device: String,
    pub(super) latency_ns: i64,
}

/// Recorded note: frames are ignored from here on, or used again.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Freeze {
    #[serde(alias = "paused")]
    pub(super) on: bool,
}

/// Recorded note: the volume is cleared here.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Clear {}

/// Recorded note: the device's next reading was not paired for want of room. A frame has its
/// number.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Unpaired {
    pub(super) device: String,
    pub(super) item: u64,
}

/// Kinds of these notes.
pub(super) const FREEZE: &str = "freeze";
pub(super) const CLEAR: &str = "clear";
pub(super) const SET_UP: &str = "set_up";
pub(super) const LATENCY: &str = "latency";
pub(super) const UNPAIRED: &str = "unpaired";

/// Kinds that earlier versions recorded instead of [`FREEZE`] and [`CLEAR`].
pub(super) const FREEZE_BEFORE: &str = "paused";
pub(super) const CLEAR_BEFORE: &str = "cleared";

struct Door {
    /// `None` once it is closed.
    onward: Option<Sender<Delivery>>,
    last_ns: i64,
}

/// The event sequencer, shared by the captures. Its lock is held only while a reading is put
/// into two queues.
pub(super) struct EventSequencer<'a> {
    common: Common<'a>,
    names: Vec<String>,
    door: Mutex<Door>,
}

impl<'a> EventSequencer<'a> {
    /// Returns a sequencer for devices with these names.
    pub(super) fn new(common: Common<'a>, names: Vec<String>, onward: Sender<Delivery>) -> Self {
        Self { common, names, door: Mutex::new(Door { onward: Some(onward), last_ns: i64::MIN }) }
    }

    fn with<T>(&self, act: impl FnOnce(Option<&Sender<Delivery>>, i64) -> T) -> T {
        let mut door = self.door.lock().unwrap_or_else(PoisonError::into_inner);
        door.last_ns = door.last_ns.max(self.common.clock.now_ns());
        act(door.onward.as_ref(), door.last_ns)
    }

    /// Adds a device's set-up. It is never dropped, since readings have no time without it.
    /// Returns false if pairing has ended.
    pub(super) fn set_up(&self, source: usize, description: &Description) -> bool {
        let recorder = self.common.recorder;
        self.must(source, |at_ns| {
            let device = self.names[source].clone();
            recorder.describe(source, description);
            recorder.comes_in(SET_UP, &SetUp { device }, at_ns);
            SessionEvent::SetUp(description.timing)
        })
    }

    /// Sets a device's latency from now on, ns. Returns false if pairing has ended.
    pub(super) fn latency(&self, source: usize, latency_ns: i64) -> bool {
        let recorder = self.common.recorder;
        self.must(source, |at_ns| {
            let device = self.names[source].clone();
            recorder.comes_in(LATENCY, &Latency { device, latency_ns }, at_ns);
            SessionEvent::Latency(latency_ns)
        })
    }

    /// Ignores frames from now on, or uses them again. Returns false if pairing has ended.
    pub(super) fn freeze(&self, on: bool) -> bool {
        self.must(NO_DEVICE, |at_ns| {
            self.common.recorder.comes_in(FREEZE, &Freeze { on }, at_ns);
            SessionEvent::Freeze(on)
        })
    }

    /// Clears the volume. Returns false if pairing has ended.
    pub(super) fn clear(&self) -> bool {
        self.must(NO_DEVICE, |at_ns| {
            self.common.recorder.comes_in(CLEAR, &Clear {}, at_ns);
            SessionEvent::Clear
        })
    }

    fn must(&self, source: usize, word: impl Fn(i64) -> SessionEvent) -> bool {
        loop {
            let done = self.with(|onward, at_ns| {
                let Some(onward) = onward else { return Some(false) };
                // The lock is held, so no other thread sends meanwhile.
                (!onward.is_full()).then(|| onward.try_send(Delivery { source, at_ns, word: word(at_ns) }).is_ok())
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
        let Common { board, recorder, in_flight, .. } = self.common;
        self.with(|onward, at_ns| {
            let Some(onward) = onward else { return false };
            if matches!(reading, Reading::Raw(_)) {
                recorder.take(source, reading, at_ns);
                return true;
            }
            let is_frame = matches!(reading, Reading::Frame(_));
            board.arrived(source);
            if onward.is_full() || (is_frame && !in_flight.enter()) {
                board.dropped(source, Queue::Pairing);
                let unpaired = Unpaired { device: self.names[source].clone(), item: reading.stamp().item };
                recorder.comes_in(UNPAIRED, &unpaired, at_ns);
                recorder.take(source, reading, at_ns);
                return true;
            }
            if recorder.records() {
                recorder.take(source, reading.clone(), at_ns);
            }
            !matches!(
                onward.try_send(Delivery { source, at_ns, word: SessionEvent::Reading(reading) }),
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
        self.door.lock().unwrap_or_else(PoisonError::into_inner).onward = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn freeze_note_reads_old_and_new_key_and_writes_new() {
        for on in [true, false] {
            let read = |key| serde_json::from_str::<Freeze>(&format!("{{\"{key}\":{on}}}")).unwrap().on;
            assert_eq!([read("paused"), read("on")], [on; 2]);
            assert_eq!(serde_json::to_string(&Freeze { on }).unwrap(), format!("{{\"on\":{on}}}"));
        }
    }
}
