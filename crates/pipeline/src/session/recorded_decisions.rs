//! Recorded decisions of a live session, and the differences found by its replay.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use serde::de::DeserializeOwned;

use drivers::replay::{SessionReplay, SessionSettings};
use sonoweave_core::frames::{Image, Transform, World};
use sonoweave_core::refusal::Refusal;
use sonoweave_core::slice;
use sonoweave_core::{Device, Error, NO_DEADLINE, Next, Reading};

use super::corrected::CorrectedFrames;
use super::decision::{DECISION, Decided, FrameOutcome, PLACED, PlacedFrame};
use super::digest::{DIGEST, ResultDigest};
use super::event::{CLOCK, UNPAIRED};
use crate::command::Marker;

/// Kind of note: an automatic choice of the insertion path depends on the poses that the devices
/// can reach. Earlier versions did not write it, and chose the general path.
const PATH_BY_REACH: &str = "path_by_reach";

/// Kind of note: the automatic mask knows borders with noise. Earlier versions did not write it,
/// and knew only borders that are exactly zero.
const MASK_BY_EDGES: &str = "mask_by_edges";

/// Note of a marked moment.
pub(super) const MARKER: &str = "marker";
/// Kinds of note with which every new recording begins.
pub(super) const RULES: [&str; 2] = [PATH_BY_REACH, MASK_BY_EDGES];

/// A frame's recorded pose and outcome.
#[derive(Debug, Clone, Default)]
struct Was {
    placed: Option<(i64, [u64; 12])>,
    outcome: Option<FrameOutcome>,
}

/// Differences between a replay and its recording.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Differences {
    /// Number of differences.
    pub count: u64,
    /// Description of the first: the frame, the recorded value and the new one.
    pub first: Option<String>,
}

/// The decisions of a recorded session.
#[derive(Debug, Default)]
pub struct RecordedDecisions {
    frames: HashMap<u64, Was>,
    digest: Option<ResultDigest>,
    notes: HashMap<String, Vec<String>>,
    /// Messages missing from the file, though they were handed over to be recorded.
    missing: u64,
    unpaired: u64,
    /// Whether frames that were dropped are dropped again.
    drops: bool,
    /// Corrections, applied by the replay.
    corrected: Option<CorrectedFrames>,
    differences: Mutex<Differences>,
}

impl RecordedDecisions {
    /// Reads all decisions of a session; frames stay compressed.
    ///
    /// # Errors
    /// [`Error`] same as [`SessionReplay`], or [`formats::Error::Session`] for a note that this
    /// program did not write.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let mut replay = SessionReplay::open(&SessionSettings { images: false, ..SessionSettings::new(path) })?;
        let mut decisions = Self { drops: true, ..Self::default() };
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
                    decisions.frames.entry(placed.frame).or_default().placed = Some(placed.bits());
                }
                DECISION => {
                    let Decided { frame, outcome } = of_json(path, &note.topic, &note.text)?;
                    decisions.frames.entry(frame).or_default().outcome = Some(outcome);
                }
                UNPAIRED => decisions.unpaired += 1,
                DIGEST => decisions.digest = Some(of_json(path, &note.topic, &note.text)?),
                CLOCK => {}
                _ => decisions.notes.entry(note.topic).or_default().push(note.text),
            }
        }
        decisions.missing = replay.health().received.lost;
        Ok(decisions)
    }

    /// Returns the texts (JSON) of all notes of a kind that concerns the whole session, such as
    /// `configuration`.
    pub fn notes(&self, kind: &str) -> &[String] {
        self.notes.get(kind).map_or(&[], Vec::as_slice)
    }

    /// Returns whether an automatic choice of the insertion path depends on the poses that the
    /// devices can reach.
    pub(super) fn is_path_by_reach(&self) -> bool {
        !self.notes(PATH_BY_REACH).is_empty()
    }

    /// Returns whether the automatic mask knew only borders that are exactly zero.
    pub(super) fn is_mask_of_zero_borders(&self) -> bool {
        self.notes(MASK_BY_EDGES).is_empty()
    }

    /// Returns the digest of the session's result, if it ended properly.
    pub fn digest(&self) -> Option<&ResultDigest> {
        self.digest.as_ref()
    }

    /// Returns the number of messages missing from the recording: readings lost while it was
    /// written, so that not everything can be repeated.
    pub fn missing(&self) -> u64 {
        self.missing
    }

    /// Returns the number of frames dropped for want of time, including readings that were not
    /// paired.
    pub fn dropped(&self) -> u64 {
        let dropped = self.frames.values().filter(|was| matches!(was.outcome, Some(FrameOutcome::Dropped(_))));
        self.unpaired + dropped.count() as u64
    }

    /// Uses the dropped frames nevertheless.
    pub fn use_all(&mut self) {
        self.drops = false;
    }

    /// Returns the recorded poses of all frames that got one: pixels to world mm, three rows of
    /// four.
    pub fn placed_poses(&self) -> BTreeMap<u64, [f64; 12]> {
        let placed = |(frame, was): (&u64, &Was)| Some((*frame, was.placed?.1.map(f64::from_bits)));
        self.frames.iter().filter_map(placed).collect()
    }

    /// Returns the recorded times of all frames that got a pose, host ns.
    pub fn placed_times_ns(&self) -> BTreeMap<u64, i64> {
        self.frames.iter().filter_map(|(frame, was)| Some((*frame, was.placed?.0))).collect()
    }

    /// Returns the marked moments of a recording, host ns, ascending.
    ///
    /// # Errors
    /// The text of a marker that cannot be read.
    pub fn markers_ns(&self) -> Result<Vec<i64>, serde_json::Error> {
        let marked = |text: &String| serde_json::from_str::<Marker>(text).map(|marker| marker.at_ns);
        let mut times: Vec<i64> = self.notes(MARKER).iter().map(marked).collect::<Result<_, _>>()?;
        times.sort_unstable();
        Ok(times)
    }

    /// Lets the replay use corrected poses. Its outcome then is another one than the recorded, and
    /// is not compared; the poses that it pairs still are.
    pub fn correct(&mut self, corrected: CorrectedFrames) {
        self.corrected = Some(corrected);
    }

    /// Returns the corrections that the replay applies.
    pub fn corrections(&self) -> Option<&CorrectedFrames> {
        self.corrected.as_ref()
    }

    /// Returns the pose of a frame that was paired with one.
    ///
    /// # Errors
    /// The refusal of a frame that the corrections leave out, or for which they have no pose.
    pub(super) fn corrected(
        &self,
        frame: u64,
        paired: Transform<World, Image>,
    ) -> Result<Transform<World, Image>, Refusal> {
        self.corrected.as_ref().map_or(Ok(paired), |corrected| corrected.pose(frame, paired))
    }

    /// Returns a frame's image, as the corrections change it.
    pub(super) fn corrected_image(
        &self,
        frame: u64,
        image: slice::Image,
        pose: &Transform<World, Image>,
    ) -> slice::Image {
        match &self.corrected {
            Some(corrected) => corrected.image(frame, image, pose),
            None => image,
        }
    }

    /// Returns whether dropped frames are dropped again.
    pub(super) fn drops(&self) -> bool {
        self.drops
    }

    /// Returns the queue that a frame found full, if it is to be dropped again.
    pub(super) fn was_dropped(&self, item: u64) -> Option<sonoweave_core::ledger::Queue> {
        match self.frames.get(&item)?.outcome {
            Some(FrameOutcome::Dropped(queue)) if self.drops => Some(queue),
            _ => None,
        }
    }

    /// Returns the differences found so far.
    pub fn differences(&self) -> Differences {
        self.differences.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn differs(&self, words: impl FnOnce() -> String) {
        let mut differences = self.differences.lock().unwrap_or_else(PoisonError::into_inner);
        differences.count += 1;
        differences.first.get_or_insert_with(words);
    }

    /// Compares a frame's pose with the recorded one. Frames without a recorded pose, such as
    /// those at the end of an interrupted session, are not compared.
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

    /// Compares a frame's outcome with the recorded one.
    pub(super) fn decided(&self, item: u64, outcome: &FrameOutcome) {
        if self.corrected.is_some() {
            return;
        }
        let Some(was) = self.frames.get(&item).and_then(|was| was.outcome.as_ref()) else { return };
        let (now, before) = (outcome.words(), was.words());
        if now == before || (!self.drops && matches!(was, FrameOutcome::Dropped(_))) {
            return;
        }
        self.differs(|| format!("frame {item}: it is {now}, and was {before} when it was live"));
    }

    /// Compares the result with the recorded one.
    pub(super) fn compare_digest(&self, digest: &ResultDigest) {
        let Some(was) = self.digest.as_ref().filter(|_| self.corrected.is_none()) else { return };
        if !self.drops && self.dropped() > 0 {
            return;
        }
        if was.slices != digest.slices {
            self.differs(|| {
                format!("the volume has {} slices, and had {} when it was live", digest.slices, was.slices)
            });
        } else if was.volume_sha256 != digest.volume_sha256 {
            self.differs(|| "the volume's voxels are not those that it had when it was live".into());
        }
        if let (Some(was), Some(now)) = (&was.picture_sha256, &digest.picture_sha256)
            && was != now
        {
            self.differs(|| "the picture of all slices is not the one that there was when it was live".into());
        }
    }
}

pub(super) fn of_json<T: DeserializeOwned>(path: &Path, kind: &str, text: &str) -> Result<T, Error> {
    let problem =
        |error| format!("cannot read a note of kind {kind:?} ({error}); use the version that wrote the session");
    let refused = |error| formats::Error::Session { path: path.to_owned(), problem: problem(error) };
    serde_json::from_str(text).map_err(|error: serde_json::Error| refused(error).into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use sonoweave_core::ledger::Queue;

    fn placed(frame: u64, x: f64) -> PlacedFrame {
        let mut world_from_image = [0.5; 12];
        world_from_image[3] = x;
        PlacedFrame {
            frame,
            time_ns: 7,
            world_from_image,
            bound_ns: 1,
            gap_ns: 2,
            error_mm: Some(0.1),
            unsmoothed: None,
        }
    }

    fn decisions() -> RecordedDecisions {
        let outcomes = [FrameOutcome::Used, FrameOutcome::Dropped(Queue::Insertion)];
        let frames = (0..)
            .zip(outcomes)
            .map(|(item, outcome)| (item, Was { placed: Some(placed(item, 1.0).bits()), outcome: Some(outcome) }));
        RecordedDecisions { frames: frames.collect(), drops: true, ..RecordedDecisions::default() }
    }

    #[test]
    fn first_differing_frame_is_named() {
        let decisions = decisions();
        decisions.placed(&placed(0, 1.0));
        decisions.decided(0, &FrameOutcome::Used);
        decisions.placed(&placed(9, 5.0));
        decisions.decided(9, &FrameOutcome::Used);
        assert_eq!(decisions.differences(), Differences::default(), "what was not recorded is no difference");
        decisions.placed(&placed(1, 1.0 + f64::EPSILON));
        decisions.decided(0, &FrameOutcome::Refused { reason: "repeated".into(), detail: String::new() });
        let found = decisions.differences();
        assert_eq!(found.count, 2);
        assert_eq!(
            found.first.unwrap(),
            "frame 1: world_from_image[0][3] is 1.0000000000000002, and was 1.0 when it was live"
        );
    }

    #[test]
    fn dropped_frames_drop_again_unless_use_all() {
        let mut decisions = decisions();
        assert_eq!([0, 1].map(|item| decisions.was_dropped(item)), [None, Some(Queue::Insertion)]);
        assert_eq!(decisions.dropped(), 1);
        decisions.decided(1, &FrameOutcome::Used);
        assert_eq!(decisions.differences().count, 1);
        decisions.use_all();
        assert_eq!(decisions.was_dropped(1), None);
        decisions.decided(1, &FrameOutcome::Used);
        assert_eq!(decisions.differences().count, 1);
    }

    #[test]
    fn result_digest_is_compared_with_recorded() {
        let digest = |volume: &str, picture: Option<&str>| ResultDigest {
            slices: 3,
            volume_sha256: Some(volume.into()),
            picture_sha256: picture.map(Into::into),
        };
        let decisions = RecordedDecisions { digest: Some(digest("a", Some("p"))), ..decisions() };
        decisions.compare_digest(&digest("a", Some("p")));
        decisions.compare_digest(&digest("a", None));
        assert_eq!(decisions.differences().count, 0, "a picture that is not rendered is not compared");
        decisions.compare_digest(&digest("b", Some("q")));
        decisions.compare_digest(&ResultDigest { slices: 4, ..digest("a", None) });
        assert_eq!(decisions.differences().count, 3);
    }
}
