//! A scripted device, which delivers given data at given times: counts and stamps are exact,
//! however late the machine is.

use std::collections::VecDeque;
use std::sync::Arc;

use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::reading::{Frame, PixelType, Pose, Reading, Stamp, Status};
use sonoweave_core::{Description, Device, Error, Health, Next, Ticks, Timing};

use crate::set::SIZE;

/// Speed of the scripted probe along z, mm/s.
pub(crate) const SPEED: f64 = 20.0;
/// Time between two frames, ns: 25 per second.
pub(crate) const FRAME: i64 = 40 * MS;
/// Time between two poses, ns: 125 per second.
pub(crate) const POSE: i64 = 8 * MS;

/// A scripted action.
#[derive(Clone)]
#[allow(clippy::large_enum_variant, reason = "nearly all values are the large ones")]
pub(crate) enum Act {
    /// Deliver a reading.
    Give(Reading),
    /// Change to another state, for a reason.
    Be(State, &'static str),
    /// Be set up again: the ticks begin at 0.
    SetUp,
    /// Lose this number of readings, by the device's own count.
    Lose(u64),
}

/// The device.
pub(crate) struct Script {
    acts: VecDeque<(i64, Act)>,
    description: Description,
    health: Health,
    started: bool,
}

impl Script {
    /// Returns a device with actions and their times, host ns. Actions keep this order
    /// regardless of the times.
    pub(crate) fn new(name: &str, timing: Timing, acts: impl IntoIterator<Item = (i64, Act)>) -> Self {
        let description = Description { name: name.into(), timing, ..Description::default() };
        Self { acts: acts.into_iter().collect(), description, health: Health::default(), started: false }
    }
}

impl Script {
    /// Keeps the device running after its last action, for a minute or until the session ends.
    pub(crate) fn that_stays(mut self) -> Self {
        let long = Monotonic.now_ns() + 60 * SECOND;
        self.acts.push_back((long, Act::Be(State::Running, "")));
        self
    }

    /// Declares a size of the grabber's frames.
    pub(crate) fn that_seems(mut self, size: [u32; 2]) -> Self {
        self.description.image_size = Some(size);
        self
    }
}

impl Device for Script {
    fn start(&mut self) -> Result<(), Error> {
        self.started = true;
        self.health.received.set_up = 1;
        self.health.state = State::Running;
        Ok(())
    }

    fn next(&mut self, deadline_ns: i64) -> Result<Next, Error> {
        assert!(self.started);
        loop {
            let Some((due_ns, _)) = self.acts.front() else { return Ok(Next::End) };
            if *due_ns > deadline_ns {
                Monotonic.wait_until(deadline_ns);
                return Ok(Next::Pending);
            }
            Monotonic.wait_until(*due_ns);
            match self.acts.pop_front() {
                Some((_, Act::Give(reading))) => {
                    self.health.received.readings += 1;
                    return Ok(Next::Reading(reading));
                }
                Some((_, Act::Be(state, why))) => (self.health.state, self.health.why) = (state, why.into()),
                Some((_, Act::SetUp)) => self.health.received.set_up += 1,
                Some((_, Act::Lose(lost))) => self.health.received.lost += lost,
                None => return Ok(Next::End),
            }
        }
    }

    fn stop(&mut self) -> Result<(), Error> {
        Ok(())
    }

    fn describe(&self) -> &Description {
        &self.description
    }

    fn health(&self) -> &Health {
        &self.health
    }
}

/// Returns the beginning of a script: soon.
pub(crate) fn begin() -> i64 {
    Monotonic.now_ns() + SECOND / 5
}

/// Returns the timing description of a grabber's stamps.
pub(crate) fn video() -> Timing {
    Timing {
        ticks: Ticks::Measurements,
        tick_hz: Some(SECOND as f64 / FRAME as f64),
        wraps_at: Some(1 << 32),
        rate_hz: Some(SECOND as f64 / FRAME as f64),
        ..Timing::default()
    }
}

/// Returns a frame with a driver number, acquired at a host time; its grey values identify the
/// image.
pub(crate) fn frame(item: u64, number: u64, at_ns: i64, picture: u64) -> Reading {
    let pixels: Arc<[u8]> =
        (0..SIZE[0] * SIZE[1]).map(|n| 40 + ((u64::from(n % 13) + picture * 7) % 200) as u8).collect();
    Reading::Frame(Frame {
        stamp: Stamp { item, host_ns: Some(at_ns), ticks: Some(number), ..Stamp::default() },
        frame_number: Some(number),
        status: Status::Ok,
        size: SIZE,
        channels: 1,
        pixel: PixelType::U8,
        orientation: "MF".into(),
        image_type: "".into(),
        pixels,
        fields: Vec::new(),
    })
}

/// Returns a grabber with frames [`FRAME`] apart, each with its own image.
pub(crate) fn frames(begin_ns: i64, count: u64) -> Script {
    let acts = (0..count).map(|n| {
        let at_ns = begin_ns + n as i64 * FRAME;
        (at_ns, Act::Give(frame(n, n, at_ns, n)))
    });
    Script::new("a scripted grabber", video(), acts)
}

/// Returns the timing description of a tracker's stamps: none, or a counter of measurements.
pub(crate) fn poses_timing(counts: bool) -> Timing {
    let hz = SECOND as f64 / POSE as f64;
    let timing = Timing { rate_hz: Some(hz), ..Timing::default() };
    match counts {
        false => timing,
        true => Timing { ticks: Ticks::Measurements, tick_hz: Some(hz), wraps_at: Some(1 << 32), ..timing },
    }
}

/// Returns the probe's position along z, mm, at a time after the script's beginning.
pub(crate) fn height_mm(after_ns: i64) -> f64 {
    after_ns as f64 * 1e-9 * SPEED
}

/// Returns a station's pose, received at a host time, at the height of the probe or of a static
/// patient.
pub(crate) fn pose(item: u64, station: u8, ticks: Option<u64>, at_ns: i64, height_mm: f64) -> Reading {
    Reading::Pose(Pose {
        stamp: Stamp { item, host_ns: Some(at_ns), ticks, ..Stamp::default() },
        station,
        position_cm: [0.0, 0.0, if station == 1 { height_mm / 10.0 } else { 0.0 }],
        quaternion_wxyz: [1.0, 0.0, 0.0, 0.0],
        buttons: 0,
        distortion: None,
        code: None,
        status: Status::Ok,
    })
}

/// Returns a tracker's readings from half a second before the first frame until half a second
/// after the last. Each has a time after the beginning and the probe's position.
pub(crate) fn measured(frames: u64) -> impl Iterator<Item = (u64, i64, f64)> {
    let (first, last) = (-SECOND / 2 / POSE, (frames as i64 * FRAME + SECOND / 2) / POSE);
    (0..).zip(first..last).map(|(item, n)| (item, n * POSE, height_mm(n * POSE)))
}

/// Returns a tracker of one station without disturbances.
pub(crate) fn poses(begin_ns: i64, frames: u64) -> Script {
    let acts = measured(frames)
        .map(move |(item, after, mm)| (begin_ns + after, Act::Give(pose(item, 1, None, begin_ns + after, mm))));
    Script::new("a scripted tracker", poses_timing(false), acts)
}
