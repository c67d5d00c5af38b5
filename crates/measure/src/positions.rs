//! Positions of a session's slices, the newest [`MOST`], in parts that never move.
//!
//! A part is allocated as it is filled. Growing a single array would copy all positions, and hold
//! twice their memory meanwhile.

use std::collections::VecDeque;

use sonoweave_core::frames::{Image, Transform, World};

/// Largest number of stored positions: nearly two hours at 60 a second, some 50 MB.
const MOST: usize = 400_000;

/// Positions in a part.
const PART: usize = 4096;

/// Position of a slice.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placed {
    pub(crate) item: u64,
    pub(crate) time_ns: i64,
    pub(crate) world_from_image: Transform<World, Image>,
    pub(crate) size: [u32; 2],
}

/// Positions in the order of the slices.
#[derive(Debug, Default)]
pub(crate) struct Positions {
    parts: VecDeque<Vec<Placed>>,
    /// Number of slices whose positions were dropped.
    forgotten: u64,
}

impl Positions {
    /// Appends a position. If there is no room, the oldest part is dropped.
    pub(crate) fn push(&mut self, placed: Placed) {
        if self.parts.back().is_none_or(|part| part.len() == PART) {
            if self.len() + PART > MOST {
                self.forgotten += self.parts.pop_front().map_or(0, |part| part.len()) as u64;
            }
            self.parts.push_back(Vec::with_capacity(PART));
        }
        if let Some(part) = self.parts.back_mut() {
            part.push(placed);
        }
    }

    /// The positions, the oldest first.
    pub(crate) fn iter(&self) -> impl DoubleEndedIterator<Item = &Placed> {
        self.parts.iter().flatten()
    }

    /// The number of stored positions.
    pub(crate) fn len(&self) -> usize {
        // All parts but the last are full.
        self.parts.back().map_or(0, |last| (self.parts.len() - 1) * PART + last.len())
    }

    /// Number of slices whose positions were dropped.
    pub(crate) fn forgotten(&self) -> u64 {
        self.forgotten
    }

    /// Memory in use, bytes.
    pub(crate) fn bytes(&self) -> u64 {
        (self.parts.len() * PART * size_of::<Placed>()) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn oldest_positions_are_dropped_a_part_at_a_time() {
        let mut positions = Positions::default();
        let placed = |item| Placed { item, time_ns: 0, world_from_image: Transform::IDENTITY, size: [1, 1] };
        let full = MOST / PART * PART;
        (0..full as u64).for_each(|item| positions.push(placed(item)));
        assert_eq!((positions.len(), positions.forgotten()), (full, 0));
        let bytes = positions.bytes();
        positions.push(placed(full as u64));
        assert_eq!((positions.len(), positions.forgotten()), (full - PART + 1, PART as u64));
        assert_eq!(positions.bytes(), bytes, "memory does not grow");
        assert!(positions.iter().map(|placed| placed.item).eq(PART as u64..=full as u64));
    }
}
