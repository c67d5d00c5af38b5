//! Pairing by time: frames wait until poses exist on both sides of their time. Each then gets its
//! pose in the world with an error bound, or the reason why it has none.
//!
//! Trackers are later or earlier than frames, by latencies, lines and buffers. A frame
//! therefore waits until each station between image and world has a pose at its time or after
//! it. The wait is limited in time, and the queue in length. Frames are answered in the order
//! of arrival. Poses are never extrapolated: a frame that waited in vain gets the station and
//! the reason.

use std::collections::VecDeque;
use std::fmt;
use std::sync::Arc;

use glam::DAffine3;
use serde::{Serialize, Serializer};

use sonoweave_core::frames::{Image, Transform, World};
use sonoweave_core::reading::transform_name;

use super::PairingOptions;
use super::smoothed::{SmoothingEffect, Way, lever_mm};
use crate::clock::{TimeFlags, Timed};
use crate::graph::{Edge, Names, NoPath, Route};
use crate::history::{How, PoseHistory, PoseSample, Rigid, Unavailable};
use crate::smoothing::{Smoothing, smoothed};

/// A source of poses: a tracker's station, or an arm.
#[derive(Debug, Clone, PartialEq)]
pub struct Source {
    /// The moving frame, such as `Probe` or `Reference`.
    pub from: String,
    /// The frame in which it is tracked, such as `Tracker`.
    pub to: String,
    /// Longest gap between two poses that is interpolated, ns.
    pub longest_gap_ns: i64,
    /// Position error by the tracker's manufacturer or its calibration, mm; 0 if unknown.
    pub noise_mm: f64,
    /// Orientation error, likewise, rad; 0 if unknown.
    pub noise_rad: f64,
    /// Smoothing of its poses; `None` if they are interpolated.
    pub smoothing: Option<Smoothing>,
}

impl Source {
    /// Returns a source for a frame tracked in another, with unknown noise, not smoothed.
    pub fn new(from: &str, to: &str) -> Self {
        Self {
            from: from.into(),
            to: to.into(),
            longest_gap_ns: 100_000_000,
            noise_mm: 0.0,
            noise_rad: 0.0,
            smoothing: None,
        }
    }
}

/// Settings of pairing by time.
#[derive(Debug, Clone, PartialEq)]
pub struct TimedOptions {
    /// The names of the frames, and the constant transforms.
    pub pairing: PairingOptions,
    /// Sources of poses.
    pub sources: Vec<Source>,
    /// Longest wait of a frame, ns: the trackers' greatest latency plus a period, with a
    /// margin. A frame waits longer by the time that smoothing looks ahead.
    pub wait_ns: i64,
    /// Largest number of waiting frames.
    pub most_waiting: usize,
    /// Poses kept of each source.
    pub kept: usize,
}

impl Default for TimedOptions {
    fn default() -> Self {
        Self {
            pairing: PairingOptions::default(),
            sources: Vec::new(),
            wait_ns: 500_000_000,
            most_waiting: 64,
            kept: 2048,
        }
    }
}

/// Time and size of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameTime {
    /// Acquisition time of the image, host ns.
    pub time_ns: i64,
    /// Bound on the error of the time, ns.
    pub bound_ns: i64,
    /// Flags of the time.
    pub flags: TimeFlags,
    /// Width and height in MF orientation, pixels.
    pub size: [u32; 2],
}

impl FrameTime {
    /// Takes the time from a clock.
    pub fn new(timed: &Timed, size: [u32; 2]) -> Self {
        Self { time_ns: timed.time_ns, bound_ns: timed.bound_ns, flags: timed.flags, size }
    }
}

/// Pose of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// Maps pixels to world mm.
    pub world_from_image: Transform<World, Image>,
    /// Interpolation of the worst of the poses used.
    pub how: How,
    /// Bound on the position error of the image's corners, mm: from the clocks, the
    /// interpolation, and the trackers' noise as far as it is known. Calibration errors are not
    /// included.
    pub error_mm: f64,
    /// Flags of the times used.
    pub flags: TimeFlags,
    /// The effect of smoothing; `None` if no source is smoothed.
    pub smoothing: Option<SmoothingEffect>,
}

fn as_text<S: Serializer>(name: &Arc<str>, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(name)
}

/// Reason for which a frame has no pose.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Unplaced {
    /// A source has no pose at its time.
    Pose {
        /// Index of the source in [`TimedOptions::sources`].
        source: usize,
        /// Name of the source, such as `ProbeToTracker`.
        #[serde(serialize_with = "as_text")]
        name: Arc<str>,
        /// Reason.
        why: Unavailable,
    },
    /// The acquisition time of the frame is unknown: its clock was lost.
    FrameClockLost,
}

impl fmt::Display for Unplaced {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Pose { name, why, .. } => write!(f, "{name}: {why}"),
            Self::FrameClockLost => {
                write!(f, "when the frame was seen is not known: the clock of the pictures was lost")
            }
        }
    }
}

/// A frame whose wait has ended.
#[derive(Debug)]
pub struct Answered<T> {
    /// Data given with the frame.
    pub payload: T,
    /// Its time.
    pub frame: FrameTime,
    /// Time waited, ns.
    pub waited_ns: i64,
    /// Whether it was answered early because too many frames waited.
    pub crowded: bool,
    /// Its pose, or the reason why it has none.
    pub answer: Result<Placed, Unplaced>,
}

#[derive(Debug)]
struct Waiting<T> {
    payload: T,
    frame: FrameTime,
    since_ns: i64,
}

/// The stage. `T` is the data that comes with a frame, such as its image.
#[derive(Debug)]
pub struct TimedPairing<T> {
    options: TimedOptions,
    route: Route,
    /// Names of the sources.
    names: Vec<Arc<str>>,
    histories: Vec<PoseHistory>,
    waiting: VecDeque<Waiting<T>>,
}

impl<T> TimedPairing<T> {
    /// Returns a stage that only knows the chain of transforms to the world.
    ///
    /// # Errors
    /// [`NoPath`] when no chain leads from the image to the world.
    pub fn new(options: TimedOptions) -> Result<Self, NoPath> {
        let names: Vec<Names> = options.sources.iter().map(|s| (s.from.clone(), s.to.clone())).collect();
        let route = options.pairing.route(&names)?;
        let histories = options.sources.iter().map(|s| PoseHistory::new(options.kept, s.longest_gap_ns)).collect();
        let waiting = VecDeque::with_capacity(options.most_waiting + 1);
        let names = names.iter().map(|(from, to)| transform_name(from, to).into()).collect();
        Ok(Self { options, route, names, histories, waiting })
    }

    /// The chain of transforms to the world.
    pub fn route(&self) -> &Route {
        &self.route
    }

    /// The poses of a source.
    pub fn history(&self, source: usize) -> Option<&PoseHistory> {
        self.histories.get(source)
    }

    /// Number of waiting frames.
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// Adds a pose of a source, given by its index in the options; ignores unknown sources.
    pub fn pose(&mut self, source: usize, sample: PoseSample) {
        if let Some(history) = self.histories.get_mut(source) {
            history.insert(sample);
        }
    }

    /// Adds a frame that arrived at `now_ns`. If too many are waiting, the first of them is
    /// answered.
    pub fn frame(&mut self, frame: FrameTime, now_ns: i64, payload: T) -> Option<Answered<T>> {
        self.waiting.push_back(Waiting { payload, frame, since_ns: now_ns });
        if self.waiting.len() <= self.options.most_waiting {
            return None;
        }
        let first = self.waiting.pop_front()?;
        let answer = self.place(&first.frame);
        Some(answered(first, now_ns, true, answer))
    }

    /// Returns the first waiting frame if its wait has ended. Call until `None`.
    pub fn next(&mut self, now_ns: i64) -> Option<Answered<T>> {
        let first = self.waiting.front()?;
        let may_wait = now_ns.saturating_sub(first.since_ns) < self.wait_ns();
        // A pose before the end of its wait would be computed in vain.
        if may_wait && !self.reaches_ahead(first.frame.time_ns) {
            return None;
        }
        let answer = self.place(&first.frame);
        let may_change =
            matches!(&answer, Err(Unplaced::Pose { why: Unavailable::After { .. } | Unavailable::Nothing, .. }));
        if may_change && may_wait {
            return None;
        }
        let first = self.waiting.pop_front()?;
        Some(answered(first, now_ns, false, answer))
    }

    /// Time at which the first waiting frame has waited long enough, host ns.
    pub fn deadline_ns(&self) -> Option<i64> {
        self.waiting.front().map(|first| first.since_ns.saturating_add(self.wait_ns()))
    }

    /// The sources between image and world that are smoothed, and their settings.
    fn smoothed(&self) -> impl Iterator<Item = (usize, &Smoothing)> {
        self.route.steps.iter().filter_map(|step| match step.edge {
            Edge::PerFrame(index) => Some((index, self.options.sources[index].smoothing.as_ref()?)),
            Edge::Static(_) => None,
        })
    }

    /// Longest wait of a frame, ns.
    fn wait_ns(&self) -> i64 {
        let ahead_ns = self.smoothed().map(|(_, smoothing)| smoothing.until_ns(0)).max();
        self.options.wait_ns.saturating_add(ahead_ns.unwrap_or(0))
    }

    /// Whether all samples have come that smoothing uses at a time.
    fn reaches_ahead(&self, time_ns: i64) -> bool {
        self.smoothed().all(|(index, smoothing)| {
            self.histories[index].newest_ns().is_some_and(|newest_ns| newest_ns >= smoothing.until_ns(time_ns))
        })
    }

    /// Answers the first waiting frame with the poses at hand, at the end of a stream.
    pub fn finish(&mut self, now_ns: i64) -> Option<Answered<T>> {
        let first = self.waiting.pop_front()?;
        let answer = self.place(&first.frame);
        Some(answered(first, now_ns, false, answer))
    }

    /// Computes a frame's pose from the poses at hand.
    ///
    /// # Errors
    /// [`Unplaced`]. A reason that may change with time is only given if nothing else prevents
    /// the pose.
    pub fn place(&self, frame: &FrameTime) -> Result<Placed, Unplaced> {
        if frame.flags.has(TimeFlags::LOST) {
            return Err(Unplaced::FrameClockLost);
        }
        let mut missing = None;
        let mut way = Way::new(frame.size);
        let mut errors = [0.0; 4];
        let (mut how, mut flags) = (How::Exact, frame.flags);
        for step in &self.route.steps {
            let index = match step.edge {
                Edge::Static(index) => {
                    let affine = self.options.pairing.statics[index].affine;
                    way.step(if step.inverted { affine.inverse() } else { affine });
                    continue;
                }
                Edge::PerFrame(index) => index,
            };
            let found = match self.histories[index].at(frame.time_ns) {
                Ok(found) => found,
                Err(why) => {
                    let may_change = matches!(why, Unavailable::After { .. } | Unavailable::Nothing);
                    let unplaced = self.unplaced(index, why);
                    if !may_change {
                        return Err(unplaced);
                    }
                    missing.get_or_insert(unplaced);
                    continue;
                }
            };
            if found.how.gap_ns() > how.gap_ns() {
                how = found.how;
            }
            flags |= found.about[0].flags | found.about[1].flags;
            let walked = |pose: &Rigid| if step.inverted { pose.inverse() } else { *pose };
            let source = &self.options.sources[index];
            for (corner, error) in way.corners.iter().zip(&mut errors) {
                *error += found.error_mm(frame.bound_ns, |pose| walked(pose).point(*corner))
                    + source.noise_mm
                    + source.noise_rad * lever_mm(*corner, &found.about[0].pose, step.inverted);
            }
            let pose = found.pose();
            match &source.smoothing {
                None => way.step(walked(&pose).affine()),
                Some(settings) => {
                    let smoothed = smoothed(&self.histories[index], frame.time_ns, settings);
                    way.smoothed_step(&pose, step.inverted, smoothed);
                }
            }
        }
        if let Some(missing) = missing {
            return Err(missing);
        }
        let error_mm = errors.into_iter().fold(0.0, f64::max);
        let smoothing = self.smoothed().next().map(|_| way.effect());
        let world_from_image = Transform::from_affine(way.reached);
        Ok(Placed { world_from_image, how, error_mm, flags, smoothing })
    }

    /// Returns the map from pixels to world mm for given poses of the sources, by their indices;
    /// `None` if one on the way has no pose.
    pub fn compose(&self, pose: impl Fn(usize) -> Option<Rigid>) -> Option<Transform<World, Image>> {
        let mut world_from_image = DAffine3::IDENTITY;
        for step in &self.route.steps {
            let affine = match step.edge {
                Edge::Static(index) => self.options.pairing.statics[index].affine,
                Edge::PerFrame(index) => pose(index)?.affine(),
            };
            world_from_image = if step.inverted { affine.inverse() } else { affine } * world_from_image;
        }
        Some(Transform::from_affine(world_from_image))
    }

    fn unplaced(&self, source: usize, why: Unavailable) -> Unplaced {
        Unplaced::Pose { source, name: Arc::clone(&self.names[source]), why }
    }
}

fn answered<T>(waiting: Waiting<T>, now_ns: i64, crowded: bool, answer: Result<Placed, Unplaced>) -> Answered<T> {
    let Waiting { payload, frame, since_ns } = waiting;
    Answered { payload, frame, waited_ns: now_ns.saturating_sub(since_ns), crowded, answer }
}

#[cfg(test)]
mod tests;
