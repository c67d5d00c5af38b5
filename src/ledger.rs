//! What became of every frame and reading: used, or lost and why.
//!
//! A frame enters by [`Ledger::arrived`] and leaves by [`Ledger::used`] or [`Ledger::refused`]; between the two it waits. So
//! total = used + refused + waiting holds at any moment, by construction.

use std::collections::BTreeMap;
use std::fmt;

use serde::Serialize;

use crate::refusal::{Reason, Refusal};

/// Counts of frames.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Frames {
    /// Frames that arrived.
    pub total: u64,
    /// Frames that went into the volume.
    pub used: u64,
    /// Frames that arrived and are not decided upon yet.
    pub waiting: u64,
    /// Frames refused, by reason; reasons that did not occur are absent.
    pub refused: BTreeMap<Reason, u64>,
}

/// The account of a run.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Ledger {
    /// What became of the frames.
    pub frames: Frames,
    /// Tracker poses that were off a rotation and were replaced by the nearest one.
    pub poses_projected: u64,
    /// How far the worst of them was off: max |RᵀR − I|.
    pub worst_projection: f64,
    /// Frames without a time of their own.
    pub untimed: u64,
    /// Readings that no stage takes, by kind.
    pub unused_readings: BTreeMap<&'static str, u64>,
    /// The first frame refused for each reason.
    pub first_refusals: BTreeMap<Reason, Refusal>,
}

impl Ledger {
    /// A frame has arrived and waits.
    pub fn arrived(&mut self) {
        self.frames.total += 1;
        self.frames.waiting += 1;
    }

    /// A waiting frame went into the volume.
    ///
    /// # Panics
    /// When no frame waits: the caller has lost count.
    pub fn used(&mut self) {
        self.leave();
        self.frames.used += 1;
    }

    /// A waiting frame was refused.
    ///
    /// # Panics
    /// When no frame waits: the caller has lost count.
    pub fn refused(&mut self, refusal: &Refusal) {
        self.leave();
        *self.frames.refused.entry(refusal.reason).or_default() += 1;
        self.first_refusals.entry(refusal.reason).or_insert_with(|| refusal.clone());
    }

    fn leave(&mut self) {
        assert!(self.frames.waiting > 0, "a frame leaves the ledger that never arrived");
        self.frames.waiting -= 1;
    }

    /// A tracker pose was replaced by the nearest rigid one.
    pub fn projected(&mut self, poses: u64, deviation: f64) {
        self.poses_projected += poses;
        self.worst_projection = self.worst_projection.max(deviation);
    }

    /// A reading of a kind that no stage takes.
    pub fn unused(&mut self, kind: &'static str) {
        *self.unused_readings.entry(kind).or_default() += 1;
    }

    /// Frames refused, for whatever reason.
    pub fn refused_total(&self) -> u64 {
        self.frames.refused.values().sum()
    }
}

/// A summary for people: a line of totals, then a line a reason with its first frame.
impl fmt::Display for Ledger {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Frames { total, used, waiting, refused } = &self.frames;
        write!(f, "{used} of {total} frames used")?;
        if *waiting > 0 {
            write!(f, ", {waiting} waiting")?;
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
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_frame_is_accounted_for_at_any_moment() {
        let mut ledger = Ledger::default();
        let balanced = |l: &Ledger| l.frames.total == l.frames.used + l.frames.waiting + l.refused_total();
        for item in 0..6 {
            ledger.arrived();
            assert!(balanced(&ledger));
            match item % 3 {
                0 => ledger.used(),
                1 => ledger.refused(&Refusal::new(item, Reason::PoseInvalid, "ProbeToTracker is INVALID")),
                _ => {}
            }
            assert!(balanced(&ledger));
        }
        assert_eq!((ledger.frames.used, ledger.frames.waiting, ledger.refused_total()), (2, 2, 2));
        let text = ledger.to_string();
        assert!(text.starts_with("2 of 6 frames used, 2 waiting, 2 refused:"), "{text}");
        assert!(text.contains("2 × pose_invalid, first frame 1: ProbeToTracker is INVALID"), "{text}");
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
    fn a_frame_cannot_leave_twice() {
        let mut ledger = Ledger::default();
        ledger.arrived();
        ledger.used();
        ledger.used();
    }
}
