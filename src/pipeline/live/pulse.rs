//! Whether the stages without which nothing is woven still move: each counts its turns, idle ones too.
//!
//! A stage that waits takes a turn several times a second, so that one whose count stays has been held up: by a device's call into the kernel that does not return, by a lock,
//! by an endless loop. The recorder and the picture are not among them: a disk that stalls, or a picture that takes long, must not end a session.

use std::sync::atomic::{AtomicU64, Ordering};

use serde::Serialize;

/// The count of a stage that has ended.
const ENDED: u64 = u64::MAX;

/// A stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stage {
    /// Of the device at this place in the session.
    Capture(usize),
    Pairing,
    Weaving,
}

/// How far a stage is.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Turns {
    /// Its thread.
    pub stage: String,
    /// Turns that it has taken; `None` once it has ended.
    pub turns: Option<u64>,
}

/// All stages' turns.
pub(super) struct Pulse {
    names: Vec<String>,
    turns: Vec<AtomicU64>,
}

impl Pulse {
    /// Of a session with these devices.
    pub(super) fn new<'n>(devices: impl Iterator<Item = &'n str>) -> Self {
        let captures = devices.map(|device| format!("capture-{device}"));
        let names: Vec<String> = captures.chain(["pairing", "weave"].map(String::from)).collect();
        let turns = names.iter().map(|_| AtomicU64::new(0)).collect();
        Self { names, turns }
    }

    /// No device is captured from: what comes in comes from a recording.
    pub(super) fn without_captures(&self) {
        let captures = self.turns.len() - 2;
        self.turns[..captures].iter().for_each(|turns| turns.store(ENDED, Ordering::Relaxed));
    }

    /// A stage begins; it ends when what is returned is dropped, however that comes about.
    pub(super) fn of(&self, stage: Stage) -> Beat<'_> {
        let others = self.turns.len() - 2;
        let at = match stage {
            Stage::Capture(device) => device.min(others),
            Stage::Pairing => others,
            Stage::Weaving => others + 1,
        };
        Beat(&self.turns[at])
    }

    /// How far all are.
    pub(super) fn turns(&self) -> Vec<Turns> {
        let turns = self.turns.iter().map(|turns| turns.load(Ordering::Relaxed));
        let known = turns.map(|turns| (turns != ENDED).then_some(turns));
        self.names.iter().zip(known).map(|(stage, turns)| Turns { stage: stage.clone(), turns }).collect()
    }
}

/// A stage that runs.
pub(super) struct Beat<'p>(&'p AtomicU64);

impl Beat<'_> {
    /// It takes a turn.
    pub(super) fn turn(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

impl Drop for Beat<'_> {
    fn drop(&mut self) {
        self.0.store(ENDED, Ordering::Relaxed);
    }
}

/// Tells who stands still, from one look to the next. Looks lie a second apart or more: a stage's turn takes a fraction of that.
#[derive(Debug, Default)]
pub struct Movement(Vec<Turns>);

impl Movement {
    /// The stages that have not moved since the last look.
    pub fn still(&mut self, now: &[Turns]) -> Vec<String> {
        let before = std::mem::replace(&mut self.0, now.to_vec());
        let stuck = before.iter().zip(now).filter(|(before, now)| now.turns.is_some() && before.turns == now.turns);
        stuck.map(|(_, now)| now.stage.clone()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_that_takes_no_turn_stands_still_and_one_that_has_ended_does_not() {
        let pulse = Pulse::new(["tracking", "grabber"].into_iter());
        let mut movement = Movement::default();
        assert!(movement.still(&pulse.turns()).is_empty(), "the first look tells nothing");
        let beats = [Stage::Capture(0), Stage::Capture(1), Stage::Pairing, Stage::Weaving].map(|stage| pulse.of(stage));
        beats.iter().for_each(Beat::turn);
        assert!(movement.still(&pulse.turns()).is_empty());
        beats[0].turn();
        beats[2].turn();
        assert_eq!(movement.still(&pulse.turns()), ["capture-grabber", "weave"]);
        let [tracking, grabber, pairing, weaving] = beats;
        drop(grabber);
        for beat in [&tracking, &pairing, &weaving] {
            beat.turn();
        }
        assert!(movement.still(&pulse.turns()).is_empty(), "a device may end by itself");
        assert_eq!(pulse.turns()[1].turns, None);
        assert_eq!(movement.still(&pulse.turns()), ["capture-tracking", "pairing", "weave"]);
        pulse.without_captures();
        assert_eq!(movement.still(&pulse.turns()), ["pairing", "weave"], "a recording has no captures");
    }
}
