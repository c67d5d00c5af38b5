//! Progress of the stages that insertion depends on: each counts its turns, including idle ones.
//!
//! A waiting stage takes a turn several times a second. A count that stays constant means a
//! blocked stage: a device's system call that does not return, a lock, or an endless loop. The
//! recorder and the render thread are not included: a stalled disk or a slow picture must not
//! end a session.

use std::sync::atomic::{AtomicU64, Ordering};

use serde::Serialize;

/// Count of a stage that has ended.
const ENDED: u64 = u64::MAX;

/// A stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stage {
    /// Capture of the device at this index in the session.
    Capture(usize),
    Pairing,
    Insertion,
}

/// Progress of a stage.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Turns {
    /// Name of its thread.
    pub stage: String,
    /// Turns taken; `None` once it has ended.
    pub turns: Option<u64>,
}

/// The turns of all stages.
pub(super) struct StageTurns {
    names: Vec<String>,
    turns: Vec<AtomicU64>,
}

impl StageTurns {
    /// Returns the counters for a session with these devices.
    pub(super) fn new<'n>(devices: impl Iterator<Item = &'n str>) -> Self {
        let captures = devices.map(|device| format!("capture-{device}"));
        let names: Vec<String> = captures.chain(["pairing", "insertion"].map(String::from)).collect();
        let turns = names.iter().map(|_| AtomicU64::new(0)).collect();
        Self { names, turns }
    }

    /// Marks all captures as ended: the events come from a recording.
    pub(super) fn without_captures(&self) {
        let captures = self.turns.len() - 2;
        self.turns[..captures].iter().for_each(|turns| turns.store(ENDED, Ordering::Relaxed));
    }

    /// Begins a stage; it ends when the returned value is dropped, for whatever reason.
    pub(super) fn begin(&self, stage: Stage) -> TurnCounter<'_> {
        let others = self.turns.len() - 2;
        let at = match stage {
            Stage::Capture(device) => device.min(others),
            Stage::Pairing => others,
            Stage::Insertion => others + 1,
        };
        TurnCounter(&self.turns[at])
    }

    /// Returns the progress of all stages.
    pub(super) fn turns(&self) -> Vec<Turns> {
        let turns = self.turns.iter().map(|turns| turns.load(Ordering::Relaxed));
        let known = turns.map(|turns| (turns != ENDED).then_some(turns));
        self.names.iter().zip(known).map(|(stage, turns)| Turns { stage: stage.clone(), turns }).collect()
    }
}

/// A running stage.
pub(super) struct TurnCounter<'p>(&'p AtomicU64);

impl TurnCounter<'_> {
    /// Counts a turn.
    pub(super) fn turn(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

impl Drop for TurnCounter<'_> {
    fn drop(&mut self) {
        self.0.store(ENDED, Ordering::Relaxed);
    }
}

/// Detects blocked stages between two checks. Checks are a second or more apart; a stage's turn
/// takes a fraction of that.
#[derive(Debug, Default)]
pub struct StallDetector(Vec<Turns>);

impl StallDetector {
    /// Returns the stages that have not progressed since the last check.
    pub fn stalled(&mut self, now: &[Turns]) -> Vec<String> {
        let before = std::mem::replace(&mut self.0, now.to_vec());
        let stuck = before.iter().zip(now).filter(|(before, now)| now.turns.is_some() && before.turns == now.turns);
        stuck.map(|(_, now)| now.stage.clone()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stage_without_turns_is_stuck_unless_ended() {
        let turns = StageTurns::new(["tracking", "grabber"].into_iter());
        let mut detector = StallDetector::default();
        assert!(detector.stalled(&turns.turns()).is_empty(), "the first check has no earlier one");
        let counters =
            [Stage::Capture(0), Stage::Capture(1), Stage::Pairing, Stage::Insertion].map(|stage| turns.begin(stage));
        counters.iter().for_each(TurnCounter::turn);
        assert!(detector.stalled(&turns.turns()).is_empty());
        counters[0].turn();
        counters[2].turn();
        assert_eq!(detector.stalled(&turns.turns()), ["capture-grabber", "insertion"]);
        let [tracking, grabber, pairing, insertion] = counters;
        drop(grabber);
        for turns in [&tracking, &pairing, &insertion] {
            turns.turn();
        }
        assert!(detector.stalled(&turns.turns()).is_empty(), "a device may end by itself");
        assert_eq!(turns.turns()[1].turns, None);
        assert_eq!(detector.stalled(&turns.turns()), ["capture-tracking", "pairing", "insertion"]);
        turns.without_captures();
        assert_eq!(detector.stalled(&turns.turns()), ["pairing", "insertion"], "a recording has no captures");
    }
}
