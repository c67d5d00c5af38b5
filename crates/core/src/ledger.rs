//! The frame ledger: the outcome of every frame and reading, used or lost and why.
//!
//! A frame enters by [`Ledger::arrived`] and leaves by [`Ledger::used`], [`Ledger::refused`] or
//! [`Ledger::dropped`]; in between it waits. Therefore total = used + refused + dropped +
//! waiting at any moment, by construction. The same holds for each device's readings
//! ([`Readings`]). Losses before arrival, counted by the device or the operating system's
//! kernel, are not in the total.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};

use crate::refusal::{Reason, Refusal};

/// Counts of frames.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Frames {
    /// Frames that arrived.
    pub total: u64,
    /// Frames that went into the volume.
    pub used: u64,
    /// Frames that arrived and have no outcome yet.
    pub waiting: u64,
    /// Frames refused, by reason; reasons that did not occur are absent.
    pub refused: BTreeMap<Reason, u64>,
    /// Frames dropped because a queue was full, by queue. Omitted if empty.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub dropped: BTreeMap<Queue, u64>,
    /// Frames that never arrived, counted by the source; not in the total. Omitted if 0.
    #[serde(skip_serializing_if = "none")]
    pub lost: u64,
}

/// Queues that can be full.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Queue {
    /// Device readings, before pairing.
    Pairing,
    /// Slices, before insertion.
    #[serde(alias = "weaving")]
    Insertion,
}

impl Queue {
    /// All queues.
    pub const ALL: [Self; 2] = [Self::Pairing, Self::Insertion];

    /// The name in statistics; the serialised form is the same.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pairing => "pairing",
            Self::Insertion => "insertion",
        }
    }
}

/// Readings of a device other than frames.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Readings {
    /// The device.
    pub device: String,
    /// Readings that arrived.
    pub total: u64,
    /// Readings used as samples.
    pub used: u64,
    /// Readings refused, by reason.
    pub refused: BTreeMap<&'static str, u64>,
    /// Readings dropped because the queue before pairing was full.
    pub dropped: u64,
    /// Readings that never arrived, counted by the device; not in the total.
    pub lost: u64,
}

impl Readings {
    /// Returns the number of readings that arrived and have no outcome yet.
    pub fn waiting(&self) -> u64 {
        self.total - self.used - self.dropped - self.refused.values().sum::<u64>()
    }
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde calls it so")]
fn none(count: &u64) -> bool {
    *count == 0
}

/// The frame ledger of a run.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Ledger {
    /// Frames by outcome.
    pub frames: Frames,
    /// Tracker poses that were not exact rotations and were replaced by the nearest one.
    pub poses_projected: u64,
    /// Largest such deviation: max |RᵀR − I|.
    pub worst_projection: f64,
    /// Frames without a time of their own.
    pub untimed: u64,
    /// Readings that no stage uses, by kind.
    pub unused_readings: BTreeMap<&'static str, u64>,
    /// The first frame refused for each reason.
    pub first_refusals: BTreeMap<Reason, Refusal>,
    /// Readings by device, for a run on devices.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub readings: Vec<Readings>,
}

impl Ledger {
    /// Records that a frame has arrived and waits.
    pub fn arrived(&mut self) {
        self.frames.total += 1;
        self.frames.waiting += 1;
    }

    /// Records that a waiting frame went into the volume.
    ///
    /// # Panics
    /// When no frame waits: the caller has miscounted.
    pub fn used(&mut self) {
        self.leave();
        self.frames.used += 1;
    }

    /// Records that a waiting frame was refused.
    ///
    /// # Panics
    /// When no frame waits: the caller has miscounted.
    pub fn refused(&mut self, refusal: &Refusal) {
        self.leave();
        *self.frames.refused.entry(refusal.reason).or_default() += 1;
        self.first_refusals.entry(refusal.reason).or_insert_with(|| refusal.clone());
    }

    /// Records that a waiting frame was dropped because a queue was full.
    ///
    /// # Panics
    /// When no frame waits: the caller has miscounted.
    pub fn dropped(&mut self, queue: Queue) {
        self.leave();
        *self.frames.dropped.entry(queue).or_default() += 1;
    }

    fn leave(&mut self) {
        assert!(self.frames.waiting > 0, "a frame leaves the ledger that never arrived");
        self.frames.waiting -= 1;
    }

    /// Records tracker poses that were replaced by the nearest rigid ones.
    pub fn projected(&mut self, poses: u64, deviation: f64) {
        self.poses_projected += poses;
        self.worst_projection = self.worst_projection.max(deviation);
    }

    /// Records a reading of a kind that no stage uses.
    pub fn unused(&mut self, kind: &'static str) {
        *self.unused_readings.entry(kind).or_default() += 1;
    }

    /// Adds the outcomes of frames that went into the same volume by another run. Readings by
    /// device are not added.
    pub fn add(&mut self, other: &Self) {
        let Frames { total, used, waiting, refused, dropped, lost } = &other.frames;
        self.frames.total += total;
        self.frames.used += used;
        self.frames.waiting += waiting;
        refused.iter().for_each(|(reason, count)| *self.frames.refused.entry(*reason).or_default() += count);
        dropped.iter().for_each(|(queue, count)| *self.frames.dropped.entry(*queue).or_default() += count);
        self.frames.lost += lost;
        self.projected(other.poses_projected, other.worst_projection);
        self.untimed += other.untimed;
        other.unused_readings.iter().for_each(|(kind, count)| *self.unused_readings.entry(kind).or_default() += count);
        for (reason, refusal) in &other.first_refusals {
            self.first_refusals.entry(*reason).or_insert_with(|| refusal.clone());
        }
    }

    /// Frames refused, for any reason.
    pub fn refused_total(&self) -> u64 {
        self.frames.refused.values().sum()
    }
}

/// A human-readable summary: a line of totals, then a line for each reason with its first
/// frame.
impl fmt::Display for Ledger {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Frames { total, used, waiting, refused, dropped, lost } = &self.frames;
        write!(f, "{used} of {total} frames used")?;
        if *waiting > 0 {
            write!(f, ", {waiting} waiting")?;
        }
        for (queue, count) in dropped {
            write!(f, ", {count} dropped before {}", queue.name())?;
        }
        if *lost > 0 {
            write!(f, ", {lost} lost before they came")?;
        }
        if !refused.is_empty() {
            write!(f, ", {} refused:", self.refused_total())?;
        }
        for (reason, count) in refused {
            write!(f, "\n  {count} × {reason}")?;
            if let Some(first) = self.first_refusals.get(reason) {
                write!(f, ", first frame {}: {}", first.item, first.detail)?;
            }
        }
        if self.untimed > 0 {
            write!(f, "\n{} frames without a time; their number was taken", self.untimed)?;
        }
        for (kind, count) in &self.unused_readings {
            write!(f, "\n{count} readings of kind {kind} not used")?;
        }
        for Readings { device, total, used, refused, dropped, lost } in &self.readings {
            write!(f, "\n{device}: {used} of {total} readings used")?;
            for (reason, count) in refused {
                write!(f, ", {count} refused: {reason}")?;
            }
            for (count, what) in [(dropped, "dropped before pairing"), (lost, "lost before they came")] {
                if *count > 0 {
                    write!(f, ", {count} {what}")?;
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_counts_always_add_up() {
        let mut ledger = Ledger::default();
        let balanced = |l: &Ledger| {
            let dropped: u64 = l.frames.dropped.values().sum();
            l.frames.total == l.frames.used + l.frames.waiting + dropped + l.refused_total()
        };
        for item in 0..8 {
            ledger.arrived();
            assert!(balanced(&ledger));
            match item % 4 {
                0 => ledger.used(),
                3 => ledger.dropped(Queue::Insertion),
                1 => ledger.refused(&Refusal::new(item, Reason::PoseInvalid, "ProbeToTracker is INVALID")),
                _ => {}
            }
            assert!(balanced(&ledger));
        }
        assert_eq!((ledger.frames.used, ledger.frames.waiting, ledger.refused_total()), (2, 2, 2));
        let text = ledger.to_string();
        assert!(text.starts_with("2 of 8 frames used, 2 waiting, 2 dropped before insertion, 2 refused:"), "{text}");
        assert!(text.contains("2 × pose_invalid, first frame 1: ProbeToTracker is INVALID"), "{text}");
    }

    #[test]
    fn sum_has_outcomes_of_both_and_first_refusal() {
        let of = |used: u64, refused: u64| {
            let mut ledger = Ledger::default();
            (0..used + refused).for_each(|_| ledger.arrived());
            (0..used).for_each(|_| ledger.used());
            for item in 0..refused {
                ledger.refused(&Refusal::new(10 * used + item, Reason::Repeated, "same"));
            }
            ledger.projected(used, used as f64);
            ledger.unused("counts");
            ledger
        };
        let mut sum = of(3, 2);
        sum.add(&of(4, 1));
        let Frames { total, used, waiting, .. } = sum.frames;
        assert_eq!((total, used, waiting, sum.refused_total()), (10, 7, 0, 3));
        assert_eq!(sum.first_refusals[&Reason::Repeated].item, 30);
        assert_eq!((sum.poses_projected, sum.worst_projection, sum.unused_readings["counts"]), (7, 4.0, 2));
    }

    #[test]
    fn statistics_hold_frames_by_reason() {
        let mut ledger = Ledger::default();
        ledger.arrived();
        ledger.refused(&Refusal::new(0, Reason::Colour, "3 channels"));
        ledger.projected(2, 1e-6);
        ledger.projected(1, 1e-7);
        ledger.unused("counts");
        let json = serde_json::to_value(&ledger).unwrap();
        assert_eq!(json["frames"]["total"], 1);
        assert_eq!(json["frames"]["refused"]["colour"], 1);
        assert_eq!(json["poses_projected"], 3);
        assert_eq!(json["worst_projection"], 1e-6);
        assert_eq!(json["unused_readings"]["counts"], 1);
        assert!(ledger.to_string().contains("1 readings of kind counts not used"));
    }

    #[test]
    #[should_panic(expected = "never arrived")]
    fn frame_leaving_twice_panics() {
        let mut ledger = Ledger::default();
        ledger.arrived();
        ledger.used();
        ledger.used();
    }
}
