//! What was decided when a recorded session was live, and where a replay of it comes to something else.

use std::collections::HashMap;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use drivers::recording::session::{SessionReplay, SessionSettings};
use drivers::{Device, Error, NO_DEADLINE, Next, Reading};
use serde::de::DeserializeOwned;

use super::decision::{DECISION, Decided, Fate, PLACED, PlacedFrame};
use super::intake::UNPAIRED;
use super::pairing::CLOCK;
use super::seal::{SEAL, Seal};

/// A frame, as it was placed and decided upon.
#[derive(Debug, Clone, Default)]
struct Was {
    placed: Option<(i64, [u64; 12])>,
    fate: Option<Fate>,
}

/// Where a replay differs from what was recorded.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Differences {
    /// How often.
    pub count: u64,
    /// The first, in words: which frame, what it was and what it is.
    pub first: Option<String>,
}

/// The decisions of a recorded session.
#[derive(Debug, Default)]
pub struct Precedent {
    frames: HashMap<u64, Was>,
    seal: Option<Seal>,
    notes: HashMap<String, Vec<String>>,
    /// Messages that are not in the file, though they were handed over to be recorded.
    missing: u64,
    unpaired: u64,
    /// Frames that were dropped are dropped again.
    drops: bool,
    differences: Mutex<Differences>,
}

impl Precedent {
    /// Reads all that was decided in a session; frames stay compressed.
    ///
    /// # Errors
    /// [`Error`] as of [`SessionReplay`], or [`Error::Session`] for a note that is none of this program's.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let mut replay = SessionReplay::open(&SessionSettings { images: false, ..SessionSettings::new(path) })?;
        let mut precedent = Self { drops: true, ..Self::default() };
        replay.start()?;
        loop {
            let note = match replay.next(NO_DEADLINE)? {
                Next::Reading(Reading::Recorded(note)) => note,
                Next::Reading(_) | Next::Pending => continue,
                Next::End => break,
            };
            match note.topic.as_str() {
                PLACED => {
                    let placed: PlacedFrame = of_json(path, &note.topic, &note.text)?;
                    precedent.frames.entry(placed.frame).or_default().placed = Some(placed.bits());
                }
                DECISION => {
                    let Decided { frame, fate } = of_json(path, &note.topic, &note.text)?;
                    precedent.frames.entry(frame).or_default().fate = Some(fate);
                }
                UNPAIRED => precedent.unpaired += 1,
                SEAL => precedent.seal = Some(of_json(path, &note.topic, &note.text)?),
                CLOCK => {}
                _ => precedent.notes.entry(note.topic).or_default().push(note.text),
            }
        }
        precedent.missing = replay.health().received.lost;
        Ok(precedent)
    }

    /// The texts of all notes of a kind that is of the whole session, as `configuration`: JSON.
    pub fn notes(&self, kind: &str) -> &[String] {
        self.notes.get(kind).map_or(&[], Vec::as_slice)
    }

    /// What the session had made when it ended in good order.
    pub fn seal(&self) -> Option<&Seal> {
        self.seal.as_ref()
    }

    /// Messages that the recording lacks: readings that were lost while it was written, so that not all can be redone.
    pub fn missing(&self) -> u64 {
        self.missing
    }

    /// Frames that were dropped for want of time, readings that were not paired included.
    pub fn dropped(&self) -> u64 {
        let dropped = self.frames.values().filter(|was| matches!(was.fate, Some(Fate::Dropped(_))));
        self.unpaired + dropped.count() as u64
    }

    /// What was dropped is to be used nevertheless.
    pub fn use_all(&mut self) {
        self.drops = false;
    }

    /// Whether what was dropped is dropped again.
    pub(super) fn drops(&self) -> bool {
        self.drops
    }

    /// The queue that a frame found full, if it is to be dropped again.
    pub(super) fn was_dropped(&self, item: u64) -> Option<crate::ledger::Queue> {
        match self.frames.get(&item)?.fate {
            Some(Fate::Dropped(queue)) if self.drops => Some(queue),
            _ => None,
        }
    }

    /// Where this replay has come to something else.
    pub fn differences(&self) -> Differences {
        self.differences.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn differs(&self, words: impl FnOnce() -> String) {
        let mut differences = self.differences.lock().unwrap_or_else(PoisonError::into_inner);
        differences.count += 1;
        differences.first.get_or_insert_with(words);
    }

    /// Holds a frame's place against the recorded one. What was not recorded, as the end of a session that was broken off, is held against nothing.
    pub(super) fn placed(&self, found: &PlacedFrame) {
        let Some((time_ns, pose)) = self.frames.get(&found.frame).and_then(|was| was.placed) else { return };
        let (now_ns, now) = found.bits();
        if now_ns != time_ns {
            self.differs(|| {
                format!("frame {}: its time is {now_ns} ns, and was {time_ns} ns when it was live", found.frame)
            });
        } else if let Some(at) = (0..12).find(|at| pose[*at] != now[*at]) {
            let (row, column) = (at / 4, at % 4);
            self.differs(|| {
                format!(
                    "frame {}: world_from_image[{row}][{column}] is {:?}, and was {:?} when it was live",
                    found.frame,
                    f64::from_bits(now[at]),
                    f64::from_bits(pose[at])
                )
            });
        }
    }

    /// Holds a frame's fate against the recorded one.
    pub(super) fn decided(&self, item: u64, fate: &Fate) {
        let Some(was) = self.frames.get(&item).and_then(|was| was.fate.as_ref()) else { return };
        if was == fate || (!self.drops && matches!(was, Fate::Dropped(_))) {
            return;
        }
        self.differs(|| {
            let now = if was.words() == fate.words() { format!("{fate:?}") } else { fate.words() };
            let before = if was.words() == fate.words() { format!("{was:?}") } else { was.words() };
            format!("frame {item}: it is {now}, and was {before} when it was live")
        });
    }

    /// Holds what was made against what was made then.
    pub(super) fn sealed(&self, seal: &Seal) {
        let Some(was) = &self.seal else { return };
        if !self.drops && self.dropped() > 0 {
            return;
        }
        if was.slices != seal.slices {
            self.differs(|| format!("the volume has {} slices, and had {} when it was live", seal.slices, was.slices));
        } else if was.volume_sha256 != seal.volume_sha256 {
            self.differs(|| "the volume's voxels are not those that it had when it was live".into());
        }
        if let (Some(was), Some(now)) = (&was.picture_sha256, &seal.picture_sha256)
            && was != now
        {
            self.differs(|| "the picture of all slices is not the one that there was when it was live".into());
        }
    }
}

pub(super) fn of_json<T: DeserializeOwned>(path: &Path, kind: &str, text: &str) -> Result<T, Error> {
    serde_json::from_str(text).map_err(|error| Error::Session {
        path: path.to_owned(),
        offset: 0,
        problem: format!(
            "a note of the kind {kind:?} is not what this version writes ({error}); use the version that wrote the session"
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ledger::Queue;

    fn placed(frame: u64, x: f64) -> PlacedFrame {
        let mut world_from_image = [0.5; 12];
        world_from_image[3] = x;
        PlacedFrame { frame, time_ns: 7, world_from_image, bound_ns: 1, gap_ns: 2, error_mm: Some(0.1) }
    }

    fn precedent() -> Precedent {
        let fates = [Fate::Used, Fate::Dropped(Queue::Weaving)];
        let frames = (0..)
            .zip(fates)
            .map(|(item, fate)| (item, Was { placed: Some(placed(item, 1.0).bits()), fate: Some(fate) }));
        Precedent { frames: frames.collect(), drops: true, ..Precedent::default() }
    }

    #[test]
    fn the_first_sample_that_differs_is_named() {
        let precedent = precedent();
        precedent.placed(&placed(0, 1.0));
        precedent.decided(0, &Fate::Used);
        precedent.placed(&placed(9, 5.0));
        precedent.decided(9, &Fate::Used);
        assert_eq!(precedent.differences(), Differences::default(), "what was not recorded is no difference");
        precedent.placed(&placed(1, 1.0 + f64::EPSILON));
        precedent.decided(0, &Fate::Refused { reason: "repeated".into(), detail: String::new() });
        let found = precedent.differences();
        assert_eq!(found.count, 2);
        assert_eq!(
            found.first.unwrap(),
            "frame 1: world_from_image[0][3] is 1.0000000000000002, and was 1.0 when it was live"
        );
    }

    #[test]
    fn what_was_dropped_is_dropped_again_unless_all_is_wanted() {
        let mut precedent = precedent();
        assert_eq!([0, 1].map(|item| precedent.was_dropped(item)), [None, Some(Queue::Weaving)]);
        assert_eq!(precedent.dropped(), 1);
        precedent.decided(1, &Fate::Used);
        assert_eq!(precedent.differences().count, 1);
        precedent.use_all();
        assert_eq!(precedent.was_dropped(1), None);
        precedent.decided(1, &Fate::Used);
        assert_eq!(precedent.differences().count, 1);
    }

    #[test]
    fn what_was_made_is_held_against_what_was_made_then() {
        let seal = |volume: &str, picture: Option<&str>| Seal {
            slices: 3,
            volume_sha256: Some(volume.into()),
            picture_sha256: picture.map(Into::into),
        };
        let precedent = Precedent { seal: Some(seal("a", Some("p"))), ..precedent() };
        precedent.sealed(&seal("a", Some("p")));
        precedent.sealed(&seal("a", None));
        assert_eq!(precedent.differences().count, 0, "nobody looks at a picture that was not asked for");
        precedent.sealed(&seal("b", Some("q")));
        precedent.sealed(&Seal { slices: 4, ..seal("a", None) });
        assert_eq!(precedent.differences().count, 3);
    }
}
