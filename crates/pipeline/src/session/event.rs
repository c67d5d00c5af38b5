//! Session events: what reaches pairing, in one order. A recording has each of them, readings as
//! messages and the others as notes.

use serde::{Deserialize, Serialize};

use mask::MaskChange;
use sonoweave_core::clock::MS;
use sonoweave_core::{Reading, Timing};
use sync::clock::Mapping;

/// Interval at which clocks are advanced, ns.
pub(super) const ADVANCE_EVERY_NS: i64 = 20 * MS;

/// Device index of events that belong to no device.
pub(super) const NO_DEVICE: usize = usize::MAX;

/// A session event with its device and time.
pub(super) struct Delivery {
    /// The device, by its index in the session.
    pub(super) source: usize,
    /// Arrival time, host ns; never earlier than the previous one.
    pub(super) at_ns: i64,
    pub(super) event: SessionEvent,
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
    /// An operator changes the mask of later slices; belongs to no device.
    Mask(MaskChange),
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

/// Recorded note: an operator changes the mask from here on.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Masked {
    pub(super) change: MaskChange,
}

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
pub(super) const MASK: &str = "mask";
pub(super) const SET_UP: &str = "set_up";
pub(super) const LATENCY: &str = "latency";
pub(super) const UNPAIRED: &str = "unpaired";

/// Kinds that earlier versions recorded instead of [`FREEZE`] and [`CLEAR`].
pub(super) const FREEZE_BEFORE: &str = "paused";
pub(super) const CLEAR_BEFORE: &str = "cleared";

/// Kind of note that publishes a clock.
pub(super) const CLOCK: &str = "clock";

/// A published clock, for the recording.
#[derive(Serialize)]
pub(super) struct Published<'a> {
    pub(super) device: &'a str,
    pub(super) clock: usize,
    #[serde(flatten)]
    pub(super) mapping: Mapping,
}

/// A source of session events.
pub(super) trait Feed {
    /// Returns the next feed event; `None` after the last.
    fn next(&mut self) -> Option<FeedEvent>;
}

/// A feed event.
#[allow(clippy::large_enum_variant, reason = "nearly all values are the large ones, moved once")]
pub(super) enum FeedEvent {
    /// A session event.
    Delivery(Delivery),
    /// No event until this host time, ns; no later event has an earlier time.
    Quiet(i64),
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
