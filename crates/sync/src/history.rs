//! A station's poses by time, and interpolation between them, with the reason if there is no
//! pose.
//!
//! Between two samples, positions are interpolated linearly and orientations along the shorter
//! rotation at constant speed. There is no pose before the first sample or after the last,
//! across a gap that is too long, or beside a sample that the station marked invalid.

use std::borrow::Cow;
use std::collections::VecDeque;
use std::fmt;

use glam::{DAffine3, DQuat, DVec3};
use serde::Serialize;

use sonoweave_core::rotation::slerp;

use super::clock::TimeFlags;

/// A rigid pose in f64: maps points of the sensor's frame to points of the tracker's, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rigid {
    /// Unit quaternion.
    pub rotation: DQuat,
    /// Position, mm.
    pub position_mm: DVec3,
}

impl Rigid {
    /// The identity.
    pub const IDENTITY: Self = Self { rotation: DQuat::IDENTITY, position_mm: DVec3::ZERO };

    /// Maps a point.
    pub fn point(&self, p: DVec3) -> DVec3 {
        self.rotation * p + self.position_mm
    }

    /// Returns the inverse map.
    pub fn inverse(&self) -> Self {
        let back = self.rotation.conjugate();
        Self { rotation: back, position_mm: -(back * self.position_mm) }
    }

    /// Returns the pose as an affine map.
    pub fn affine(&self) -> DAffine3 {
        DAffine3::from_rotation_translation(self.rotation, self.position_mm)
    }

    /// Interpolates to another pose: linear in position, by the shorter rotation at constant
    /// speed in orientation. `share` is from 0 to 1.
    ///
    /// Between two equal poses the result is the same bit for bit: repeated slices of a resting
    /// probe are recognised by that.
    pub fn between(&self, other: &Self, share: f64) -> Self {
        if self == other {
            return *self;
        }
        Self {
            rotation: slerp(self.rotation, other.rotation, share).normalize(),
            position_mm: self.position_mm.lerp(other.position_mm, share),
        }
    }
}

/// A station's pose at a time.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseSample {
    /// Measurement time, host ns.
    pub time_ns: i64,
    /// Bound on the error of the time, ns.
    pub bound_ns: i64,
    /// Flags of the time.
    pub flags: TimeFlags,
    /// The pose.
    pub pose: Rigid,
    /// Reason not to use it, from the station or the stage before.
    pub invalid: Option<Cow<'static, str>>,
}

/// Reason why there is no pose at a time.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "why")]
pub enum Unavailable {
    /// Nothing was received.
    Nothing,
    /// The time precedes all samples kept.
    Before {
        /// Distance, ns.
        by_ns: i64,
    },
    /// The time follows all samples received.
    After {
        /// Distance, ns.
        by_ns: i64,
    },
    /// The samples around it are too far apart.
    Gap {
        /// Their distance, ns.
        gap_ns: i64,
    },
    /// A sample beside it must not be used.
    Invalid {
        /// The station's own word.
        word: Cow<'static, str>,
    },
    /// The measurement times of the samples around it are unknown: the clock was lost.
    ClockLost,
}

impl fmt::Display for Unavailable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ms = |ns: &i64| *ns as f64 * 1e-6;
        match self {
            Self::Nothing => write!(f, "nothing was received"),
            Self::Before { by_ns } => write!(f, "the time is {:.1} ms before the first pose that is kept", ms(by_ns)),
            Self::After { by_ns } => {
                write!(f, "no pose came after the time: the last is {:.1} ms before it", ms(by_ns))
            }
            Self::Gap { gap_ns } => write!(f, "the poses about the time lie {:.1} ms apart", ms(gap_ns)),
            Self::Invalid { word } => write!(f, "a pose about the time is not valid: {word}"),
            Self::ClockLost => write!(f, "the clock of the poses about the time was lost"),
        }
    }
}

/// Derivation of a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum How {
    /// A sample was measured at exactly that time.
    Exact,
    /// Interpolated between two samples.
    Interpolated {
        /// Their distance, ns.
        gap_ns: i64,
    },
}

impl How {
    /// Time between the samples, ns.
    pub fn gap_ns(self) -> i64 {
        match self {
            Self::Exact => 0,
            Self::Interpolated { gap_ns } => gap_ns,
        }
    }
}

/// The samples around a time.
#[derive(Debug, Clone, Copy)]
pub struct Found<'a> {
    /// The last at or before it, and the first after it; twice the same if exact.
    pub about: [&'a PoseSample; 2],
    /// The samples beyond these, if they are valid and near enough.
    pub beyond: [Option<&'a PoseSample>; 2],
    /// Position of the time between the two, from 0 to 1.
    pub share: f64,
    /// Derivation of the pose.
    pub how: How,
}

impl Found<'_> {
    /// Returns the pose.
    pub fn pose(&self) -> Rigid {
        match self.how {
            How::Exact => self.about[0].pose,
            How::Interpolated { .. } => self.about[0].pose.between(&self.about[1].pose, self.share),
        }
    }

    /// Bound on the position error of a point, mm. `place` maps the point by a pose; `other_ns`
    /// is the error of the clock that gave the query time.
    ///
    /// The bound is the sum of two terms. The first is the point's motion during the clocks'
    /// errors, at the fastest speed of the neighbouring intervals. The second is the deviation
    /// of the straight line from the true motion: gap/4 times the changes of velocity on either
    /// side. This is exact for one sudden change and four times too large for constant
    /// acceleration. Without samples beyond, the point may be off by half its motion across the
    /// gap. Intervals shorter than the uncertainty of their ends' times give no velocity.
    pub fn error_mm(&self, other_ns: i64, place: impl Fn(&Rigid) -> DVec3) -> f64 {
        let [first, second] = self.about;
        let all = [self.beyond[0], Some(first), Some(second), self.beyond[1]]
            .map(|sample| Some((sample?, place(&sample?.pose))));
        let interval = |at: usize| {
            let ((a, from), (b, to)) = (all[at]?, all[at + 1]?);
            let (passed_ns, uncertain_ns) = (b.time_ns - a.time_ns, a.bound_ns.max(b.bound_ns));
            (passed_ns > uncertain_ns).then(|| (to - from, passed_ns, passed_ns - uncertain_ns))
        };
        let intervals = [interval(0), interval(1), interval(2)];
        let seconds = |ns: i64| ns as f64 * 1e-9;
        let [left, across, right] = intervals.map(|of| of.map(|(moved, passed_ns, _)| moved / seconds(passed_ns)));
        // It may have moved in the shortest time that is possible.
        let known =
            intervals.iter().flatten().map(|(moved, _, least_ns)| moved.length() / seconds(*least_ns)).reduce(f64::max);
        let fastest = known.unwrap_or_else(|| {
            // The whole motion over the whole time.
            let moved: f64 = all.windows(2).filter_map(|two| Some((two[1]?.1 - two[0]?.1).length())).sum();
            let span = all.iter().flatten().map(|(sample, _)| sample.time_ns);
            let passed = span.clone().max().unwrap_or(0) - span.min().unwrap_or(0);
            if passed > 0 { moved / seconds(passed) } else { 0.0 }
        });
        let off = seconds(first.bound_ns.max(second.bound_ns).saturating_add(other_ns));
        let gap = seconds(self.how.gap_ns());
        let change = |a: Option<DVec3>, b: Option<DVec3>| Some((a? - b?).length());
        let bend = match (self.how, change(left, across), change(across, right)) {
            (How::Exact, ..) => 0.0,
            (_, None, None) => 0.5 * (place(&second.pose) - place(&first.pose)).length().max(fastest * gap),
            (_, a, b) => 0.25 * gap * (a.or(b).unwrap_or(0.0) + b.or(a).unwrap_or(0.0)),
        };
        fastest * off + bend
    }
}

/// Counts of inserted samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Inserted {
    /// Samples inserted.
    pub samples: u64,
    /// Inserted samples that were earlier than a sample already present.
    pub out_of_order: u64,
    /// Samples at exactly the time of an existing one, which they replace.
    pub repeated: u64,
    /// Samples ignored because they were earlier than all kept ones.
    pub too_old: u64,
}

/// The newest poses of a station.
#[derive(Debug)]
pub struct PoseHistory {
    samples: VecDeque<PoseSample>,
    kept: usize,
    longest_gap_ns: i64,
    inserted: Inserted,
}

impl PoseHistory {
    /// Returns a history of `kept` poses, at least 4. Poses further apart than `longest_gap_ns`
    /// are not interpolated.
    pub fn new(kept: usize, longest_gap_ns: i64) -> Self {
        let kept = kept.max(4);
        Self { samples: VecDeque::with_capacity(kept + 1), kept, longest_gap_ns, inserted: Inserted::default() }
    }

    /// Counts of all samples so far.
    pub fn inserted(&self) -> Inserted {
        self.inserted
    }

    /// Samples kept.
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// The newest time, ns.
    pub fn newest_ns(&self) -> Option<i64> {
        self.samples.back().map(|sample| sample.time_ns)
    }

    /// Discards all samples, for example after the transmitter was moved.
    pub fn clear(&mut self) {
        self.samples.clear();
    }

    /// Inserts a sample in order of time.
    pub fn insert(&mut self, sample: PoseSample) {
        let is_newest = self.samples.back().is_none_or(|last| last.time_ns < sample.time_ns);
        if is_newest {
            self.samples.push_back(sample);
        } else {
            let at = self.place(sample.time_ns);
            if let Some(same) = self.samples.get_mut(at)
                && same.time_ns == sample.time_ns
            {
                *same = sample;
                self.inserted.repeated += 1;
                self.inserted.samples += 1;
                return;
            }
            if at == 0 && self.samples.len() >= self.kept {
                self.inserted.too_old += 1;
                return;
            }
            self.inserted.out_of_order += 1;
            self.samples.insert(at, sample);
        }
        self.inserted.samples += 1;
        if self.samples.len() > self.kept {
            self.samples.pop_front();
        }
    }

    /// Index of the first sample at or after a time.
    fn place(&self, time_ns: i64) -> usize {
        self.samples.partition_point(|sample| sample.time_ns < time_ns)
    }

    /// Returns the samples around a time, by binary search.
    ///
    /// # Errors
    /// [`Unavailable`]: the reason why there is no pose. [`Unavailable::After`] and
    /// [`Unavailable::Nothing`] may change when more is received; the others will not.
    pub fn at(&self, time_ns: i64) -> Result<Found<'_>, Unavailable> {
        let (Some(oldest), Some(newest)) = (self.samples.front(), self.samples.back()) else {
            return Err(Unavailable::Nothing);
        };
        if time_ns < oldest.time_ns {
            return Err(Unavailable::Before { by_ns: oldest.time_ns.saturating_sub(time_ns) });
        }
        if time_ns > newest.time_ns {
            return Err(Unavailable::After { by_ns: time_ns.saturating_sub(newest.time_ns) });
        }
        let second = self.place(time_ns);
        let is_exact = self.samples[second].time_ns == time_ns;
        let first = if is_exact { second } else { second - 1 };
        let about = [&self.samples[first], &self.samples[second]];
        for sample in about {
            if let Some(word) = &sample.invalid {
                return Err(Unavailable::Invalid { word: word.clone() });
            }
        }
        if about.iter().any(|sample| sample.flags.has(TimeFlags::LOST)) {
            return Err(Unavailable::ClockLost);
        }
        let gap_ns = about[1].time_ns.saturating_sub(about[0].time_ns);
        if gap_ns > self.longest_gap_ns {
            return Err(Unavailable::Gap { gap_ns });
        }
        let near = |sample: &&PoseSample| {
            sample.invalid.is_none() && sample.time_ns.abs_diff(time_ns) <= 2 * self.longest_gap_ns.unsigned_abs()
        };
        let beyond = [
            first.checked_sub(1).and_then(|at| self.samples.get(at)).filter(near),
            self.samples.get(second + 1).filter(near),
        ];
        let how = if is_exact { How::Exact } else { How::Interpolated { gap_ns } };
        let share = if is_exact { 0.0 } else { (time_ns - about[0].time_ns) as f64 / gap_ns as f64 };
        Ok(Found { about, beyond, share, how })
    }

    /// Returns the usable samples from one time to another, both included, in their order. One with
    /// the pose of the one before is a repeat, and left out.
    pub(crate) fn distinct(&self, from_ns: i64, until_ns: i64) -> Vec<&PoseSample> {
        let mut distinct: Vec<&PoseSample> = Vec::new();
        let within = self.samples.range(self.place(from_ns)..self.place(until_ns.saturating_add(1)));
        for sample in within.filter(|sample| sample.invalid.is_none() && !sample.flags.has(TimeFlags::LOST)) {
            if distinct.last().is_none_or(|last| last.pose != sample.pose) {
                distinct.push(sample);
            }
        }
        distinct
    }
}

#[cfg(test)]
mod tests;
