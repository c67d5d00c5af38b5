//! The bricks that a page does not have as they are, and their order of urgency.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use volume::brick::BrickIndex;

/// A brick whose last change is no older is in work: slices go on to change it.
const IN_WORK: Duration = Duration::from_millis(200);
/// Shortest time between two messages with the same brick.
const AGAIN: Duration = Duration::from_millis(200);

/// A page's bricks.
#[derive(Debug, Default)]
pub(super) struct DirtySet {
    /// Bricks to be sent, with the time of their last change.
    dirty: BTreeMap<BrickIndex, Instant>,
    /// Bricks that the page has; it has no others.
    held: BTreeSet<BrickIndex>,
    /// Bricks sent a short while ago.
    recent: BTreeMap<BrickIndex, Instant>,
}

impl DirtySet {
    /// Notes changed bricks.
    pub(super) fn note(&mut self, bricks: impl IntoIterator<Item = BrickIndex>, now: Instant) {
        self.dirty.extend(bricks.into_iter().map(|brick| (brick, now)));
    }

    /// Notes that any brick may have changed; these are all that the volume has now.
    pub(super) fn note_all(&mut self, bricks: impl IntoIterator<Item = BrickIndex>, now: Instant) {
        self.dirty = self.held.iter().copied().chain(bricks).map(|brick| (brick, now)).collect();
    }

    /// Notes that the page keeps only bricks of these.
    pub(super) fn keep(&mut self, is_kept: impl Fn(BrickIndex) -> bool, now: Instant) {
        let Self { dirty, held, .. } = self;
        held.retain(|brick| {
            let keeps = is_kept(*brick);
            if !keeps {
                dirty.insert(*brick, now);
            }
            keeps
        });
    }

    /// Takes the most urgent bricks, `most` at most: first those in the view, of these the
    /// finished ones, of these those that have waited longest. Bricks outside of `is_told` wait,
    /// and so do those sent a short while ago.
    pub(super) fn take(
        &mut self,
        most: usize,
        now: Instant,
        is_told: impl Fn(BrickIndex) -> bool,
        is_in_view: impl Fn(BrickIndex) -> bool,
    ) -> Vec<BrickIndex> {
        self.recent.retain(|_, sent| now.saturating_duration_since(*sent) < AGAIN);
        let mut due: Vec<_> = self
            .dirty
            .iter()
            .filter(|(brick, _)| !self.recent.contains_key(*brick) && is_told(**brick))
            .map(|(brick, changed)| {
                let is_in_work = now.saturating_duration_since(*changed) < IN_WORK;
                (!is_in_view(*brick), is_in_work, *changed, *brick)
            })
            .collect();
        if due.len() > most {
            due.select_nth_unstable(most);
            due.truncate(most);
        }
        due.sort_unstable();
        let taken: Vec<_> = due.into_iter().map(|(.., brick)| brick).collect();
        for brick in &taken {
            self.dirty.remove(brick);
            self.recent.insert(*brick, now);
        }
        taken
    }

    /// Returns whether the page has a brick.
    pub(super) fn holds(&self, brick: BrickIndex) -> bool {
        self.held.contains(&brick)
    }

    /// Notes that a brick was sent. The page has it from then on, unless nothing of it was seen.
    pub(super) fn sent(&mut self, brick: BrickIndex, is_empty: bool) {
        if is_empty {
            self.held.remove(&brick);
        } else {
            self.held.insert(brick);
        }
    }

    /// Returns how many bricks the page is to get that it never had, without those outside of
    /// `is_told`.
    pub(super) fn missing(&self, is_told: impl Fn(BrickIndex) -> bool) -> usize {
        self.dirty.keys().filter(|brick| !self.holds(**brick) && is_told(**brick)).count()
    }
}
