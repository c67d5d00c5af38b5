//! Tries out a device: starts it, waits for it, and records its output for a moment.

use std::collections::BTreeMap;
use std::time::Duration;

use serde::Serialize;

use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};
use sonoweave_core::health::{Health, State};
use sonoweave_core::reading::{Counts, Frame, Pose, Reading, Status};
use sonoweave_core::{Description, Device, Next, Ticks};

/// Time limit for a device to start, ns.
pub(super) const PATIENCE: i64 = 5 * SECOND;
/// Duration of the observation, ns.
const LISTEN: i64 = 3 * SECOND / 2;
/// Polling interval of its state, ns.
const LOOK: i64 = 20 * MS;
/// Largest range of grey values in an image without contents.
const FLAT: u8 = 4;

/// Readings of one station, or of one kind.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Stream {
    /// Number of readings.
    pub(super) readings: u64,
    /// Number of readings that the device marks as invalid.
    pub(super) doubtful: u64,
    /// Status of the last of these.
    pub(super) doubt: Option<String>,
    /// The first reading, for people.
    pub(super) first: String,
    /// Readings a second, from the first to the last; `None` for fewer than two.
    pub(super) seen_hz: Option<f64>,
    #[serde(skip)]
    times_ns: [i64; 2],
}

/// Results of a trial.
#[derive(Debug, Clone)]
pub(super) struct Tried {
    /// Time until it ran; `None` if it did not.
    pub(super) ran_after: Option<Duration>,
    /// Reason why it could not be started.
    pub(super) refused: Option<String>,
    /// Its own description.
    pub(super) description: Description,
    /// Its final health.
    pub(super) health: Health,
    /// Readings lost, records refused and bytes skipped since it ran.
    pub(super) harmed: [u64; 3],
    /// Readings by station; frames and counts are station 0.
    pub(super) streams: BTreeMap<u8, Stream>,
    /// Names of transforms; their station is their place here, from 1.
    pub(super) names: Vec<String>,
    /// Size of its images.
    pub(super) picture: Option<[u32; 2]>,
    /// All images had one grey value.
    pub(super) flat: bool,
}

/// Tries out a device, and stops it afterwards.
pub(super) fn try_out(device: &mut dyn Device) -> Tried {
    let begun = Monotonic.now_ns();
    let mut tried = Tried {
        ran_after: None,
        refused: device.start().err().map(|error| error.to_string()),
        description: device.describe().clone(),
        health: device.health().clone(),
        harmed: [0; 3],
        streams: BTreeMap::new(),
        names: Vec::new(),
        picture: None,
        flat: true,
    };
    let mut until = begun + PATIENCE;
    let mut before = [0; 3];
    while tried.refused.is_none() && Monotonic.now_ns() < until {
        match device.next((Monotonic.now_ns() + LOOK).min(until)) {
            Ok(Next::Reading(reading)) => tried.take(&reading),
            Ok(Next::Pending) => {}
            Ok(Next::End) => break,
            Err(error) => tried.refused = Some(error.to_string()),
        }
        if tried.ran_after.is_none() && device.health().state == State::Running {
            let now = Monotonic.now_ns();
            tried.ran_after = Some(Duration::from_nanos(u64::try_from(now - begun).unwrap_or(0)));
            until = now + LISTEN;
            before = harmed(device.health());
        }
    }
    tried.description = device.describe().clone();
    tried.health = device.health().clone();
    if tried.ran_after.is_some() {
        let after = harmed(device.health());
        tried.harmed = [0, 1, 2].map(|n: usize| after[n].saturating_sub(before[n]));
    }
    if let Err(error) = device.stop() {
        // It counts as stopped; only its earlier output matters.
        tracing::warn!("{error}");
    }
    tried
}

fn harmed(health: &Health) -> [u64; 3] {
    [health.received.lost, health.received.refused, health.received.skipped]
}

impl Tried {
    fn take(&mut self, reading: &Reading) {
        match reading {
            Reading::Pose(Pose { stamp, station, position_cm: [x, y, z], status, .. }) => {
                self.note(*station, stamp.host_ns, status, || format!("{x:.2}, {y:.2}, {z:.2} cm"));
            }
            Reading::Counts(counts @ Counts { stamp, first, status, .. }) => {
                let numbers: Vec<String> = counts.as_slice().iter().map(ToString::to_string).collect();
                self.note(*first, stamp.host_ns, status, || numbers.join(", "));
            }
            Reading::Frame(Frame { stamp, size, channels, status, pixels, .. }) => {
                self.picture = Some(*size);
                let (low, high) = pixels.iter().fold((u8::MAX, 0), |(low, high), p| (low.min(*p), high.max(*p)));
                self.flat &= high.saturating_sub(low) < FLAT;
                let colour = if *channels == 1 { "grey" } else { "colour" };
                let [width, height] = size;
                self.note(0, stamp.host_ns, status, || {
                    format!("{width}×{height} pixels, {colour}, levels {} to {high}", low.min(high))
                });
            }
            Reading::NamedTransform(transform) => {
                let name = transform.name();
                let place = self.names.iter().position(|known| *known == name).unwrap_or_else(|| {
                    self.names.push(name);
                    self.names.len() - 1
                });
                let [x, y, z] = [3, 7, 11].map(|at| transform.matrix[at]);
                let station = u8::try_from(place + 1).unwrap_or(u8::MAX);
                self.note(station, transform.stamp.host_ns, &transform.status, || format!("{x:.2}, {y:.2}, {z:.2} mm"));
            }
            _ => {}
        }
    }

    fn note(&mut self, of: u8, host_ns: Option<i64>, status: &Status, first: impl FnOnce() -> String) {
        let at = host_ns.unwrap_or(0);
        let stream = self.streams.entry(of).or_insert_with(|| Stream {
            readings: 0,
            doubtful: 0,
            doubt: None,
            first: first(),
            seen_hz: None,
            times_ns: [at; 2],
        });
        stream.readings += 1;
        stream.times_ns[1] = at;
        let seconds = (stream.times_ns[1] - stream.times_ns[0]) as f64 * 1e-9;
        stream.seen_hz = (seconds > 0.0).then(|| (stream.readings - 1) as f64 / seconds);
        if let Status::Other(word) = status {
            stream.doubtful += 1;
            stream.doubt = Some(word.clone().into_owned());
        }
    }

    /// Returns the station of a transform by its name, if it was received.
    pub(super) fn station(&self, name: &str) -> Option<u8> {
        let place = self.names.iter().position(|known| known == name)?;
        u8::try_from(place + 1).ok()
    }

    /// Describes its clock.
    pub(super) fn clock(&self) -> String {
        let timing = &self.description.timing;
        match (timing.ticks, timing.tick_hz) {
            (Ticks::None, _) => "no clock of its own; this machine's times are used".into(),
            (Ticks::Time, Some(hz)) => format!("a clock of its own, {hz:.0} ticks a second"),
            (Ticks::Time, None) => "a clock of its own".into(),
            (Ticks::Measurements, _) => "no clock, but it numbers its measurements".into(),
        }
    }

    /// Returns the delay between a measurement and its last byte, as far as the driver knows it,
    /// ms.
    pub(super) fn known_delay_ms(&self) -> f64 {
        let timing = &self.description.timing;
        (timing.sampling_ns + timing.wire_ns) as f64 * 1e-6
    }
}
