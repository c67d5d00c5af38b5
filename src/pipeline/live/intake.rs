//! Where all that devices deliver comes in: in one order, which is the recording's and that in which it is paired. Who replays the one redoes the other.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, TrySendError};
use drivers::{Description, Reading, Timing};
use serde::{Deserialize, Serialize};

use super::decision::Common;
use crate::ledger::Queue;

/// Between two tries to hand over what must not be dropped.
const PAUSE: Duration = Duration::from_millis(1);

/// The place of words that are of no device.
pub(super) const NO_DEVICE: usize = usize::MAX;

/// What a device has to say.
pub(super) struct Delivery {
    /// Which device, by its place in the session.
    pub(super) source: usize,
    /// When it came in, host ns; never before the one before.
    pub(super) at_ns: i64,
    pub(super) word: Word,
}

/// One of its words.
#[allow(clippy::large_enum_variant, reason = "nearly all values are the large ones, moved once")]
pub(super) enum Word {
    /// It was set up, perhaps anew: what its stamps mean.
    SetUp(Timing),
    /// So much more do its stamps lie behind its measurements from now on, ns.
    Latency(i64),
    /// Of no device: pictures are looked at from now on, or are not.
    Paused(bool),
    /// Of no device: the volume begins anew.
    Cleared,
    /// A reading.
    Reading(Reading),
}

/// In the recording: a device was set up, as its description before says.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct SetUp {
    pub(super) device: String,
}

/// In the recording: a device's latency from here on.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Latency {
    pub(super) device: String,
    pub(super) latency_ns: i64,
}

/// In the recording: pictures are not used from here on, or are again.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Paused {
    pub(super) paused: bool,
}

/// In the recording: the volume begins anew here.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Cleared {}

/// In the recording: the device's next reading was not paired, for want of room. A frame has its number.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Unpaired {
    pub(super) device: String,
    pub(super) item: u64,
}

/// Kinds of notes that these are.
pub(super) const PAUSED: &str = "paused";
pub(super) const CLEARED: &str = "cleared";
pub(super) const SET_UP: &str = "set_up";
pub(super) const LATENCY: &str = "latency";
pub(super) const UNPAIRED: &str = "unpaired";

struct Door {
    /// `None` once it is closed.
    onward: Option<Sender<Delivery>>,
    last_ns: i64,
}

/// The way in, which captures share: held for as long as it takes to put a reading into two queues.
pub(super) struct Intake<'a> {
    common: Common<'a>,
    names: Vec<String>,
    door: Mutex<Door>,
}

impl<'a> Intake<'a> {
    /// Of devices with these names.
    pub(super) fn new(common: Common<'a>, names: Vec<String>, onward: Sender<Delivery>) -> Self {
        Self { common, names, door: Mutex::new(Door { onward: Some(onward), last_ns: i64::MIN }) }
    }

    fn with<T>(&self, act: impl FnOnce(Option<&Sender<Delivery>>, i64) -> T) -> T {
        let mut door = self.door.lock().unwrap_or_else(PoisonError::into_inner);
        door.last_ns = door.last_ns.max(self.common.clock.now_ns());
        act(door.onward.as_ref(), door.last_ns)
    }

    /// A device was set up: never dropped, as without it no reading has a time. False where nobody takes anything any more.
    pub(super) fn set_up(&self, source: usize, description: &Description) -> bool {
        let recorder = self.common.recorder;
        self.must(source, |at_ns| {
            let device = self.names[source].clone();
            recorder.describe(source, description);
            recorder.comes_in(SET_UP, &SetUp { device }, at_ns);
            Word::SetUp(description.timing)
        })
    }

    /// From now on a device's stamps lie so much behind its measurements, ns. False where nobody takes anything any more.
    pub(super) fn latency(&self, source: usize, latency_ns: i64) -> bool {
        let recorder = self.common.recorder;
        self.must(source, |at_ns| {
            let device = self.names[source].clone();
            recorder.comes_in(LATENCY, &Latency { device, latency_ns }, at_ns);
            Word::Latency(latency_ns)
        })
    }

    /// From now on pictures are used, or are not. False where nobody takes anything any more.
    pub(super) fn pause(&self, paused: bool) -> bool {
        self.must(NO_DEVICE, |at_ns| {
            self.common.recorder.comes_in(PAUSED, &Paused { paused }, at_ns);
            Word::Paused(paused)
        })
    }

    /// The volume begins anew. False where nobody takes anything any more.
    pub(super) fn clear(&self) -> bool {
        self.must(NO_DEVICE, |at_ns| {
            self.common.recorder.comes_in(CLEARED, &Cleared {}, at_ns);
            Word::Cleared
        })
    }

    fn must(&self, source: usize, word: impl Fn(i64) -> Word) -> bool {
        loop {
            let done = self.with(|onward, at_ns| {
                let Some(onward) = onward else { return Some(false) };
                // Nobody else sends meanwhile.
                (!onward.is_full()).then(|| onward.try_send(Delivery { source, at_ns, word: word(at_ns) }).is_ok())
            });
            match done {
                Some(done) => return done,
                None => std::thread::sleep(PAUSE),
            }
        }
    }

    /// A device's reading: recorded, and paired if there is room. False where nobody takes anything any more.
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
                onward.try_send(Delivery { source, at_ns, word: Word::Reading(reading) }),
                Err(TrySendError::Disconnected(_))
            )
        })
    }

    /// The time, if nothing has come in that was not taken out: nothing that comes in later has an earlier one.
    pub(super) fn quiet(&self, from: &Receiver<Delivery>) -> Option<i64> {
        self.with(|_, now_ns| from.is_empty().then_some(now_ns))
    }

    /// Nothing comes in any more.
    pub(super) fn close(&self) {
        self.door.lock().unwrap_or_else(PoisonError::into_inner).onward = None;
    }
}
