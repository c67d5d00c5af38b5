//! Converts hardware readings into poses and images in mm and on the host's clock.
//!
//! - **Units.** Tracker positions are cm on the wire and mm from here on; quaternions are
//!   normalised. Arm counts become poses by the arm's kinematics. Named transforms are in mm
//!   already; near-rotations become the nearest rotation.
//! - **Clock.** Each device has one [`ClockMap`], or several if its streams count
//!   independently: stations of a tracker without ticks, or axes of an arm with one line each.
//!   A station's record that waited for another record on the wire is dated earlier by the
//!   other's length.
//! - **Validity.** The device's own status stays with the pose; an impossible pose is refused.
//!   Its time still updates the clock.

use std::borrow::Cow;

use glam::{DQuat, DVec3};

use sonoweave_core::frames::{affine_from_rows, nearest_rigid};
use sonoweave_core::reading::{AXES, Counts, Frame, NamedTransform, Pose, Reading, Stamp, Status};
use sonoweave_core::refusal::{Reason, Refusal};
use sonoweave_core::{Ticks, Timing};

use super::{Ingest, Picture, RIGID_TOLERANCE};
use crate::clock::{ClockMap, ClockSettings, Mapping, TimeFlags, Timed};
use crate::history::{PoseSample, Rigid};

/// A quaternion whose length differs from 1 by more is refused. Single precision and four
/// digits leave 10⁻⁴.
const UNIT_TOLERANCE: f64 = 0.02;
const MM_PER_CM: f64 = 10.0;
/// Longest gap between two counts of an axis that is interpolated, ns.
const LONGEST_GAP_NS: i64 = 100_000_000;

/// Kinematics of an arm: the pose of its last link.
pub trait Kinematics: Send {
    /// Returns the pose for the joints' counts, base first. Counts are fractional if the axes
    /// were read at different times. `None` for counts that the arm cannot have.
    fn tracker_from_probe(&self, counts: &[f64]) -> Option<Rigid>;
}

impl<F: Fn(&[f64]) -> Option<Rigid> + Send> Kinematics for F {
    fn tracker_from_probe(&self, counts: &[f64]) -> Option<Rigid> {
        self(counts)
    }
}

/// Kind of data that a device delivers.
pub enum Gives {
    /// Poses of these stations (from 1), in the order in which their records are sent.
    Stations(Vec<u8>),
    /// Transforms with these names, such as `ProbeToTracker`, from a server that has one clock
    /// for all.
    Named(Vec<String>),
    /// Counts of an arm.
    Arm {
        /// Number of joints.
        joints: usize,
        /// Their kinematics.
        kinematics: Box<dyn Kinematics>,
        /// Poses spread over the arm's working range; empty if they are unknown.
        reach: Vec<Rigid>,
    },
    /// Images.
    Pictures,
}

/// Result of converting a reading.
#[derive(Debug)]
#[allow(clippy::large_enum_variant, reason = "nearly all values are the large ones, moved once")]
pub enum Live {
    /// A pose of a source.
    Pose {
        /// Position in the list of stations or names; 0 for an arm.
        source: usize,
        /// The pose and its time.
        sample: PoseSample,
        /// Details of the time's conversion.
        timed: Timed,
    },
    /// An image; the time in its head is that of the clock.
    Picture {
        /// The image.
        picture: Picture,
        /// Details of the time's conversion.
        timed: Timed,
    },
    /// An axis' count, kept until the other axes have counts, too.
    Waits(Timed),
    /// A reading that cannot be used. Its time, if it had one, updated the clock.
    Refused(Refusal),
    /// A reading that no stage uses, by kind.
    Unused(&'static str),
}

/// The count of an axis at a time.
#[derive(Debug, Clone, Copy)]
struct Count {
    time_ns: i64,
    bound_ns: i64,
    flags: TimeFlags,
    count: f64,
}

/// Axes that are read one by one.
#[derive(Debug, Default)]
struct Axes {
    /// The last two counts of each.
    counts: [[Option<Count>; 2]; AXES],
    /// Reason for which an axis' count must not be used.
    invalid: [Option<Cow<'static, str>>; AXES],
    last_ns: Option<i64>,
}

/// The record of a station.
#[derive(Debug, Clone, Copy)]
struct StationRecord {
    source: usize,
    host_ns: i64,
    ticks: Option<u64>,
    /// Records of the same measurement that were sent before it.
    before: i64,
}

/// A device's readings.
pub struct LiveIngest {
    gives: Gives,
    timing: Timing,
    latency_ns: i64,
    clocks: Vec<ClockMap>,
    axes: Axes,
    /// The record received last.
    received: Option<StationRecord>,
    ingest: Ingest,
    refused: u64,
}

impl LiveIngest {
    /// Returns the ingest for a device with this timing. `latency_ns` is the configured or
    /// calibrated latency beyond it.
    pub fn new(gives: Gives, timing: Timing, latency_ns: i64) -> Self {
        let mut live = Self {
            gives,
            timing,
            latency_ns,
            clocks: Vec::new(),
            axes: Axes::default(),
            received: None,
            ingest: Ingest::new(),
            refused: 0,
        };
        live.wind();
        live
    }

    /// Creates the clocks: one for the device, or one for each independent stream.
    fn wind(&mut self) {
        let (timing, latency) = (self.timing, self.latency_ns);
        self.clocks = match &self.gives {
            Gives::Stations(stations) if timing.ticks == Ticks::None => {
                stations.iter().map(|_| ClockMap::new(ClockSettings::new(&timing, latency))).collect()
            }
            Gives::Stations(_) | Gives::Named(_) => vec![ClockMap::new(ClockSettings::new(&timing, latency))],
            Gives::Arm { joints, .. } => {
                (0..(*joints).clamp(1, AXES)).map(|_| ClockMap::new(ClockSettings::new(&timing, latency))).collect()
            }
            Gives::Pictures => {
                // Both fields of a video frame are images with their own times; only their own
                // numbers distinguish them.
                let timing = match by_field(&timing) {
                    true => Timing { tick_hz: timing.rate_hz, wraps_at: None, ..timing },
                    false => timing,
                };
                vec![ClockMap::new(ClockSettings::video(&timing, latency))]
            }
        };
    }

    /// Handles the set-up of the device: its timing may have changed, and its ticks begin anew.
    pub fn set_up(&mut self, timing: Timing) {
        if self.timing == timing {
            self.clocks.iter_mut().for_each(ClockMap::restart);
        } else {
            self.timing = timing;
            self.wind();
        }
        self.axes = Axes::default();
    }

    /// Sets the latency of the stamps beyond the one that the driver knows, ns. Clocks begin
    /// anew.
    pub fn set_latency(&mut self, latency_ns: i64) {
        if self.latency_ns != latency_ns {
            self.latency_ns = latency_ns;
            self.wind();
            self.axes = Axes::default();
        }
    }

    /// The clocks: of the device, of each station, or of each axis.
    pub fn clocks(&self) -> &[ClockMap] {
        &self.clocks
    }

    /// Advances the clocks to the present time.
    pub fn advance(&mut self, now_ns: i64) {
        for clock in &mut self.clocks {
            clock.advance(now_ns);
        }
    }

    /// Returns a published mapping that was not taken yet, and the index of its clock. Call
    /// until `None`, after each other call.
    pub fn take_published(&mut self) -> Option<(usize, Mapping)> {
        self.clocks.iter_mut().enumerate().find_map(|(at, clock)| Some((at, clock.take_published()?)))
    }

    /// Notes for the user: sentences, each given once.
    pub fn notes(&self) -> &[String] {
        self.ingest.notes()
    }

    /// Readings refused so far.
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// Converts a reading into a pose or image with its measurement time.
    pub fn take(&mut self, reading: Reading) -> Live {
        let live = match reading {
            Reading::Pose(pose) => self.pose(pose),
            Reading::Counts(counts) => self.counts(counts),
            Reading::Frame(frame) => self.frame(&frame),
            Reading::NamedTransform(transform) => self.named(&transform),
            Reading::Recorded(_) => Ok(Live::Unused("recorded")),
            Reading::Raw(_) => Ok(Live::Unused("raw")),
        };
        live.unwrap_or_else(|refusal| {
            self.refused += 1;
            Live::Refused(refusal)
        })
    }

    fn pose(&mut self, pose: Pose) -> Result<Live, Refusal> {
        let Gives::Stations(stations) = &self.gives else { return Ok(Live::Unused("pose")) };
        let Some(source) = stations.iter().position(|station| *station == pose.station) else {
            return Ok(Live::Unused("pose of a station that was not asked for"));
        };
        let timed = self.measured(source, &pose.stamp)?;
        let rigid = rigid(&pose)?;
        Ok(Live::Pose { source, sample: sample(&timed, rigid, invalid(pose.status)), timed })
    }

    fn named(&mut self, transform: &NamedTransform) -> Result<Live, Refusal> {
        let Gives::Named(names) = &self.gives else { return Ok(Live::Unused("named transform")) };
        let name = transform.name();
        let Some(source) = names.iter().position(|known| *known == name) else {
            return Ok(Live::Unused("transform that was not asked for"));
        };
        let timed = self.measured(source, &transform.stamp)?;
        let rigid = rigid_of(transform)?;
        Ok(Live::Pose { source, sample: sample(&timed, rigid, invalid(transform.status.clone())), timed })
    }

    /// Returns the time at which a source's pose was measured.
    fn measured(&mut self, source: usize, stamp: &Stamp) -> Result<Timed, Refusal> {
        let host_ns = received(stamp)?;
        let last = self.received;
        let before = self.sent_before(source, host_ns, stamp.ticks);
        let waited_ns = self.timing.wire_ns.saturating_mul(before);
        let counts = self.timing.ticks != Ticks::None;
        let mut timed =
            self.clocks[if counts { 0 } else { source }].push(host_ns.saturating_sub(waited_ns), stamp.ticks);
        if counts && last.is_some_and(|last| last.source != source) {
            // The stations of one measurement share its ticks.
            timed.flags = timed.flags.without(TimeFlags::REPEATED);
        }
        Ok(timed)
    }

    /// Returns the number of received records of the same measurement that this one waited for
    /// on the wire. A record that was sent and lost makes this one late. A record that was
    /// never sent must not make it early.
    fn sent_before(&mut self, source: usize, host_ns: i64, ticks: Option<u64>) -> i64 {
        let cycle_ns = self.timing.rate_hz.filter(|hz| *hz > 0.0).map_or(10_000_000, |hz| (1e9 / hz) as i64);
        let is_same = |last: &StationRecord| match ticks {
            Some(_) => last.ticks == ticks,
            None => host_ns.saturating_sub(last.host_ns) < cycle_ns / 2,
        };
        let before =
            self.received.filter(|last| last.source < source && is_same(last)).map_or(0, |last| last.before + 1);
        self.received = Some(StationRecord { source, host_ns, ticks, before });
        before
    }

    fn counts(&mut self, counts: Counts) -> Result<Live, Refusal> {
        let Gives::Arm { joints, kinematics, .. } = &self.gives else { return Ok(Live::Unused("counts")) };
        let joints = (*joints).clamp(1, AXES);
        let host_ns = received(&counts.stamp)?;
        let given = counts.as_slice();
        if counts.first == 0 && given.len() >= joints {
            let timed = self.clocks[0].push(host_ns, counts.stamp.ticks);
            let mut values = [0.0; AXES];
            values.iter_mut().zip(given).for_each(|(value, count)| *value = *count as f64);
            let rigid = place(kinematics.as_ref(), &values[..joints], counts.stamp.item)?;
            return Ok(Live::Pose { source: 0, sample: sample(&timed, rigid, invalid(counts.status)), timed });
        }
        let axis = usize::from(counts.first);
        let (Some(clock), [count]) = (self.clocks.get_mut(axis), given) else {
            return Ok(Live::Unused("counts of other axes than the arm has"));
        };
        let timed = clock.push(host_ns, counts.stamp.ticks);
        let Timed { time_ns, bound_ns, flags, .. } = timed;
        self.axes.note(axis, Count { time_ns, bound_ns, flags, count: *count as f64 }, invalid(counts.status));
        let Some((at, values)) = self.axes.together(joints) else { return Ok(Live::Waits(timed)) };
        let rigid = place(kinematics.as_ref(), &values[..joints], counts.stamp.item)?;
        let invalid = self.axes.invalid[..joints].iter().flatten().next().cloned();
        let Count { time_ns, bound_ns, flags, .. } = at;
        Ok(Live::Pose { source: 0, sample: PoseSample { time_ns, bound_ns, flags, pose: rigid, invalid }, timed })
    }

    fn frame(&mut self, frame: &Frame) -> Result<Live, Refusal> {
        let Gives::Pictures = self.gives else { return Ok(Live::Unused("frame")) };
        let host_ns = received(&frame.stamp)?;
        let ticks = if by_field(&self.timing) { frame.frame_number } else { frame.stamp.ticks };
        let timed = self.clocks[0].push(host_ns, ticks);
        let mut picture = self.ingest.picture(frame)?;
        picture.head.time_ns = timed.time_ns;
        Ok(Live::Picture { picture, timed })
    }
}

impl Axes {
    fn note(&mut self, axis: usize, count: Count, invalid: Option<Cow<'static, str>>) {
        self.counts[axis] = [self.counts[axis][1], Some(count)];
        self.invalid[axis] = invalid;
    }

    /// Returns the newest time that all axes have counts around, and the counts at that time,
    /// each linear between its last two.
    fn together(&mut self, joints: usize) -> Option<(Count, [f64; AXES])> {
        let newest = self.counts[..joints].iter().map(|counts| counts[1].map(|count| count.time_ns));
        let time_ns = newest.min().flatten()?;
        if self.last_ns.is_some_and(|last| last >= time_ns) {
            return None;
        }
        let mut at = Count { time_ns, bound_ns: 0, flags: TimeFlags::NONE, count: 0.0 };
        let mut values = [0.0; AXES];
        for (value, counts) in values.iter_mut().zip(&self.counts[..joints]) {
            let last = counts[1]?;
            *value = last.count;
            (at.bound_ns, at.flags) = (at.bound_ns.max(last.bound_ns), at.flags | last.flags);
            if last.time_ns == time_ns {
                continue;
            }
            let first = counts[0].filter(|first| first.time_ns <= time_ns)?;
            let gap_ns = last.time_ns - first.time_ns;
            if gap_ns > LONGEST_GAP_NS {
                return None;
            }
            let share = (time_ns - first.time_ns) as f64 / gap_ns as f64;
            *value = first.count + share * (last.count - first.count);
            (at.bound_ns, at.flags) = (at.bound_ns.max(first.bound_ns), at.flags | first.flags);
        }
        self.last_ns = Some(time_ns);
        Some((at, values))
    }
}

/// Returns whether each field of a frame is an image of its own.
fn by_field(timing: &Timing) -> bool {
    timing.tick_hz.zip(timing.rate_hz).is_some_and(|(frames, pictures)| pictures > 1.5 * frames)
}

fn received(stamp: &Stamp) -> Result<i64, Refusal> {
    stamp.host_ns.ok_or_else(|| {
        Refusal::new(stamp.item, Reason::TimeInvalid, "has no time of receipt, as hardware's readings have")
    })
}

fn invalid(status: Status) -> Option<Cow<'static, str>> {
    match status {
        Status::Ok => None,
        Status::Other(word) => Some(word),
    }
}

fn sample(timed: &Timed, pose: Rigid, invalid: Option<Cow<'static, str>>) -> PoseSample {
    PoseSample { time_ns: timed.time_ns, bound_ns: timed.bound_ns, flags: timed.flags, pose, invalid }
}

fn place(kinematics: &dyn Kinematics, counts: &[f64], item: u64) -> Result<Rigid, Refusal> {
    kinematics
        .tracker_from_probe(counts)
        .ok_or_else(|| Refusal::new(item, Reason::PoseInvalid, format!("the arm cannot have the counts {counts:?}")))
}

/// Returns a tracker's pose in mm, with a unit quaternion.
///
/// # Errors
/// A [`Refusal`] for numbers that are not finite, or a quaternion whose length is not 1.
pub fn rigid(pose: &Pose) -> Result<Rigid, Refusal> {
    let [w, x, y, z] = pose.quaternion_wxyz;
    let (position, quaternion) = (DVec3::from_array(pose.position_cm), DQuat::from_xyzw(x, y, z, w));
    if !(position.is_finite() && quaternion.is_finite()) {
        let detail = format!("the pose of station {} holds NaN or infinity", pose.station);
        return Err(Refusal::new(pose.stamp.item, Reason::PoseNotFinite, detail));
    }
    let length = quaternion.length();
    if (length - 1.0).abs() > UNIT_TOLERANCE {
        let detail = format!("the quaternion of station {} has the length {length:.4}, not 1", pose.station);
        return Err(Refusal::new(pose.stamp.item, Reason::PoseNotRigid, detail));
    }
    Ok(Rigid { rotation: quaternion.normalize(), position_mm: position * MM_PER_CM })
}

/// Returns a named transform as a pose.
fn rigid_of(transform: &NamedTransform) -> Result<Rigid, Refusal> {
    let refusal = |reason, problem: String| {
        Refusal::new(transform.stamp.item, reason, format!("{} cannot be used: {problem}", transform.name()))
    };
    let affine = affine_from_rows(&transform.matrix).map_err(|bad| refusal(Reason::from(&bad), bad.to_string()))?;
    let (nearest, _) =
        nearest_rigid(&affine, RIGID_TOLERANCE).map_err(|bad| refusal(Reason::from(&bad), bad.to_string()))?;
    Ok(Rigid { rotation: DQuat::from_mat3(&nearest.matrix3).normalize(), position_mm: nearest.translation })
}

#[cfg(test)]
mod tests;
