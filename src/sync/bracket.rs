//! Frames wait until poses lie about their time, and are placed in the world: how well, or why not.
//!
//! Trackers are later than frames or earlier, by latencies, lines and buffers. So a frame waits until each station on its way to the world has a pose at its time or after it,
//! for a bounded time and in a bounded queue; then it is answered, in the order in which frames came. Nothing is extrapolated: a frame that waited in vain is told so, with
//! the station and the reason.

use std::collections::VecDeque;
use std::fmt;
use std::sync::Arc;

use calibration::frames::{Image, Transform, World};
use calibration::named::StaticTransform;
use drivers::reading::transform_name;
use glam::{DAffine3, DVec3};
use serde::{Serialize, Serializer};

use super::clock::{TimeFlags, Timed};
use super::graph::{Edge, Names, NoPath, Route, WORLDS, find};
use super::history::{How, PoseHistory, PoseSample, Rigid, Unavailable};

/// What gives poses: a tracker's station, or an arm.
#[derive(Debug, Clone, PartialEq)]
pub struct Source {
    /// The frame that moves, as `Probe` or `Reference`.
    pub from: String,
    /// The frame in which it is tracked, as `Tracker`.
    pub to: String,
    /// Poses further apart have nothing between them, ns.
    pub longest_gap_ns: i64,
    /// How far a position may be off by the tracker's maker or its calibration, mm; 0 where it is not known.
    pub noise_mm: f64,
    /// The same of an orientation, rad.
    pub noise_rad: f64,
}

impl Source {
    /// Of a frame in another, with nothing known of noise.
    pub fn new(from: &str, to: &str) -> Self {
        Self { from: from.into(), to: to.into(), longest_gap_ns: 100_000_000, noise_mm: 0.0, noise_rad: 0.0 }
    }
}

/// What the stage is told.
#[derive(Debug, Clone, PartialEq)]
pub struct BracketOptions {
    /// Name of the picture's frame.
    pub image: String,
    /// Name of the frame where the volume shall live. `None`: Reference if a source names it and a way leads there, else Tracker, else World.
    pub world: Option<String>,
    /// Constant transforms; that of the probe's calibration among them.
    pub statics: Vec<StaticTransform>,
    /// What gives poses.
    pub sources: Vec<Source>,
    /// So long may a frame wait, ns: the trackers' greatest latency and a period, and then some.
    pub wait_ns: i64,
    /// So many may wait.
    pub most_waiting: usize,
    /// Poses kept of each source.
    pub kept: usize,
}

impl Default for BracketOptions {
    fn default() -> Self {
        Self {
            image: "Image".into(),
            world: None,
            statics: Vec::new(),
            sources: Vec::new(),
            wait_ns: 500_000_000,
            most_waiting: 64,
            kept: 2048,
        }
    }
}

/// A frame's own time and size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameTime {
    /// When its picture was seen, host ns.
    pub time_ns: i64,
    /// How far the truth may lie from that, ns.
    pub bound_ns: i64,
    /// What there is to say of it.
    pub flags: TimeFlags,
    /// Width and height in MF orientation, pixels.
    pub size: [u32; 2],
}

impl FrameTime {
    /// As a clock has it.
    pub fn new(timed: &Timed, size: [u32; 2]) -> Self {
        Self { time_ns: timed.time_ns, bound_ns: timed.bound_ns, flags: timed.flags, size }
    }
}

/// Where a frame lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// Maps pixels to world mm.
    pub world_from_image: Transform<World, Image>,
    /// How the worst of the poses on the way was made.
    pub how: How,
    /// How far a corner of the picture may be off, mm: by the clocks, by what lies between samples, and by the trackers' noise as far as it is known. What the calibration is
    /// off by is not in it.
    pub error_mm: f64,
    /// What there is to say of the times that it hangs on.
    pub flags: TimeFlags,
}

fn as_text<S: Serializer>(name: &Arc<str>, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(name)
}

/// Why a frame has no place.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Unplaced {
    /// A source has no pose at its time.
    Pose {
        /// Which: its place in [`BracketOptions::sources`].
        source: usize,
        /// Its name, as `ProbeToTracker`.
        #[serde(serialize_with = "as_text")]
        name: Arc<str>,
        /// Why.
        why: Unavailable,
    },
    /// When the frame was seen is not known: its clock was lost.
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

/// A frame that need not wait any longer.
#[derive(Debug)]
pub struct Answered<T> {
    /// What came with it.
    pub payload: T,
    /// Its time.
    pub frame: FrameTime,
    /// How long it has waited, ns.
    pub waited_ns: i64,
    /// Whether it was answered before its time because too many waited.
    pub crowded: bool,
    /// Where it lies, or why it has no place.
    pub answer: Result<Placed, Unplaced>,
}

#[derive(Debug)]
struct Waiting<T> {
    payload: T,
    frame: FrameTime,
    since_ns: i64,
}

/// The stage. `T` is what comes with a frame: its picture.
#[derive(Debug)]
pub struct Bracketing<T> {
    options: BracketOptions,
    route: Route,
    /// The sources' names.
    names: Vec<Arc<str>>,
    histories: Vec<PoseHistory>,
    waiting: VecDeque<Waiting<T>>,
}

impl<T> Bracketing<T> {
    /// A stage that knows nothing yet but the way to the world.
    ///
    /// # Errors
    /// [`NoPath`] when no way leads from the image to the world.
    pub fn new(options: BracketOptions) -> Result<Self, NoPath> {
        let names: Vec<Names> = options.sources.iter().map(|s| (s.from.clone(), s.to.clone())).collect();
        let statics: Vec<Names> = options.statics.iter().map(|t| (t.from.clone(), t.to.clone())).collect();
        let named = |world: &&str| names.iter().any(|(from, to)| from == *world || to == *world);
        let goals: Vec<&str> = match &options.world {
            Some(world) => vec![world],
            None => WORLDS.into_iter().filter(named).collect(),
        };
        let Some(route) = goals.iter().find_map(|goal| find(&names, &statics, &options.image, goal)) else {
            return Err(NoPath {
                image: options.image,
                world: if goals.is_empty() { WORLDS.join(" or ") } else { goals.join(" or ") },
                sequence: names.iter().map(|(from, to)| transform_name(from, to)).collect(),
                configuration: options.statics.iter().map(StaticTransform::name).collect(),
            });
        };
        let histories = options.sources.iter().map(|s| PoseHistory::new(options.kept, s.longest_gap_ns)).collect();
        let waiting = VecDeque::with_capacity(options.most_waiting + 1);
        let names = names.iter().map(|(from, to)| transform_name(from, to).into()).collect();
        Ok(Self { options, route, names, histories, waiting })
    }

    /// The way to the world.
    pub fn route(&self) -> &Route {
        &self.route
    }

    /// The poses of a source.
    pub fn history(&self, source: usize) -> Option<&PoseHistory> {
        self.histories.get(source)
    }

    /// Frames that wait.
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// Takes in a pose of a source, by its place in the options; of another there is nobody to tell.
    pub fn pose(&mut self, source: usize, sample: PoseSample) {
        if let Some(history) = self.histories.get_mut(source) {
            history.insert(sample);
        }
    }

    /// Takes in a frame that came at `now_ns`. Where too many wait already, the first of them is answered.
    pub fn frame(&mut self, frame: FrameTime, now_ns: i64, payload: T) -> Option<Answered<T>> {
        self.waiting.push_back(Waiting { payload, frame, since_ns: now_ns });
        if self.waiting.len() <= self.options.most_waiting {
            return None;
        }
        let first = self.waiting.pop_front()?;
        let answer = self.place(&first.frame);
        Some(answered(first, now_ns, true, answer))
    }

    /// The first frame that waits, if it need not any longer: to be asked until there is none.
    pub fn next(&mut self, now_ns: i64) -> Option<Answered<T>> {
        let first = self.waiting.front()?;
        let answer = self.place(&first.frame);
        let may_change =
            matches!(&answer, Err(Unplaced::Pose { why: Unavailable::After { .. } | Unavailable::Nothing, .. }));
        if may_change && now_ns.saturating_sub(first.since_ns) < self.options.wait_ns {
            return None;
        }
        let first = self.waiting.pop_front()?;
        Some(answered(first, now_ns, false, answer))
    }

    /// When the first frame that waits has waited long enough, host ns.
    pub fn deadline_ns(&self) -> Option<i64> {
        self.waiting.front().map(|first| first.since_ns.saturating_add(self.options.wait_ns))
    }

    /// At the end: what waits is answered with what there is.
    pub fn finish(&mut self, now_ns: i64) -> Option<Answered<T>> {
        let first = self.waiting.pop_front()?;
        let answer = self.place(&first.frame);
        Some(answered(first, now_ns, false, answer))
    }

    /// Where a frame lies by the poses that there are.
    ///
    /// # Errors
    /// [`Unplaced`]. What may change with time is told only where nothing else keeps the frame from its place.
    pub fn place(&self, frame: &FrameTime) -> Result<Placed, Unplaced> {
        if frame.flags.has(TimeFlags::LOST) {
            return Err(Unplaced::FrameClockLost);
        }
        let mut missing = None;
        let [right, bottom] = frame.size.map(|n| f64::from(n) - 1.0);
        let mut corners =
            [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]].map(|[u, v]| DVec3::new(u, v, 0.0));
        let mut errors = [0.0; 4];
        let mut world_from_image = DAffine3::IDENTITY;
        let (mut how, mut flags) = (How::Exact, frame.flags);
        for step in &self.route.steps {
            let affine = match step.edge {
                Edge::Static(index) => {
                    let affine = self.options.statics[index].affine;
                    if step.inverted { affine.inverse() } else { affine }
                }
                Edge::PerFrame(index) => {
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
                    for (corner, error) in corners.iter().zip(&mut errors) {
                        let lever = if step.inverted { *corner - found.about[0].pose.position_mm } else { *corner };
                        *error += found.error_mm(frame.bound_ns, |pose| walked(pose).point(*corner))
                            + source.noise_mm
                            + source.noise_rad * lever.length();
                    }
                    walked(&found.pose()).affine()
                }
            };
            corners = corners.map(|corner| affine.transform_point3(corner));
            world_from_image = affine * world_from_image;
        }
        if let Some(missing) = missing {
            return Err(missing);
        }
        let error_mm = errors.into_iter().fold(0.0, f64::max);
        Ok(Placed { world_from_image: Transform::from_affine(world_from_image), how, error_mm, flags })
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
