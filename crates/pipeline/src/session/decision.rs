//! Recorded decisions about frames: the pose of each, and its outcome.

use serde::{Deserialize, Deserializer, Serialize};

use sonoweave_core::frames::{Image, Transform, World};
use sonoweave_core::ledger::Queue;
use sonoweave_core::refusal::{Reason, Refusal};
use sync::pairing::timed::{FrameTime, Placed};

/// Kinds of recorded notes.
pub(super) const PLACED: &str = "placed";
pub(super) const DECISION: &str = "decision";

/// A frame that got its pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct PlacedFrame {
    /// Its number.
    pub(super) frame: u64,
    /// Time at which its image was acquired, host ns.
    pub(super) time_ns: i64,
    /// Pixels to world mm: three rows of four.
    pub(super) world_from_image: [f64; 12],
    /// Bound on the error of the time, ns.
    pub(super) bound_ns: i64,
    /// Time between the poses that its own was interpolated from, ns.
    pub(super) gap_ns: i64,
    /// Possible error at a corner of the image, mm; `None` if unknown.
    pub(super) error_mm: Option<f64>,
    /// Pixels to world mm before smoothing, if poses are smoothed: three rows of four.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) unsmoothed: Option<[f64; 12]>,
}

fn rows(of: &Transform<World, Image>) -> [f64; 12] {
    let mut rows = [0.0; 12];
    rows.copy_from_slice(&of.to_rows()[..12]);
    rows
}

impl PlacedFrame {
    pub(super) fn new(item: u64, frame: &FrameTime, placed: &Placed) -> Self {
        Self {
            frame: item,
            time_ns: frame.time_ns,
            world_from_image: rows(&placed.world_from_image),
            bound_ns: frame.bound_ns,
            gap_ns: placed.how.gap_ns(),
            error_mm: Some(placed.error_mm).filter(|mm| mm.is_finite()),
            unsmoothed: placed.smoothing.as_ref().map(|effect| rows(&effect.unsmoothed)),
        }
    }

    /// Returns time and pose as bits, for exact comparison.
    pub(super) fn bits(&self) -> (i64, [u64; 12]) {
        (self.time_ns, self.world_from_image.map(f64::to_bits))
    }
}

/// Outcome of a frame.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum FrameOutcome {
    /// It is in the volume.
    Used,
    /// It was refused: the reason's name, and details as text.
    Refused {
        #[serde(deserialize_with = "reason")]
        reason: String,
        detail: String,
    },
    /// It found the queue before a stage full.
    Dropped(Queue),
}

/// Reads a reason's name. Earlier versions called [`Reason::Frozen`] "paused".
fn reason<'de, D: Deserializer<'de>>(from: D) -> Result<String, D::Error> {
    let name = String::deserialize(from)?;
    Ok(if name == "paused" { Reason::Frozen.name().into() } else { name })
}

impl FrameOutcome {
    pub(super) fn of(refusal: &Refusal) -> Self {
        Self::Refused { reason: refusal.reason.name().into(), detail: refusal.detail.clone() }
    }

    /// Returns the outcome as text, without details, which are sentences and may be reworded.
    pub(super) fn words(&self) -> String {
        match self {
            Self::Used => "used".into(),
            Self::Refused { reason, .. } => format!("refused ({reason})"),
            Self::Dropped(queue) => format!("dropped before {}", queue.name()),
        }
    }
}

/// A frame and its outcome.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Decided {
    pub(super) frame: u64,
    #[serde(flatten)]
    pub(super) outcome: FrameOutcome,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reason_paused_of_earlier_versions_reads_as_frozen() {
        let read = |text| serde_json::from_str::<Decided>(text).unwrap();
        let old = read(r#"{"frame":3,"refused":{"reason":"paused","detail":"why"}}"#);
        let new = Decided { frame: 3, outcome: FrameOutcome::of(&Refusal::new(3, Reason::Frozen, "why")) };
        assert_eq!(old, new);
        let text = serde_json::to_string(&new).unwrap();
        assert!(text.contains("\"frozen\"") && read(&text) == new, "{text}");
        let other = read(r#"{"frame":3,"refused":{"reason":"repeated","detail":""}}"#);
        assert_eq!(other.outcome.words(), "refused (repeated)");
    }
}
