//! Which bricks of a volume have changed since somebody last asked, in memory that does not grow without end.

use crate::volume::brick::BrickIndex;

/// Bricks that are noted one by one; of more, all are taken to have changed. Where nobody asks, or not for long, no more memory is taken than that.
const NOTED: usize = 1 << 16;

/// Bricks that have changed since somebody last asked, on the canonical lattice.
#[derive(Debug, Default)]
pub(super) struct Changes {
    /// Each once at least; none where all may have changed.
    pub(super) bricks: Vec<BrickIndex>,
    /// Any brick may have changed.
    pub(super) all: bool,
}

impl Changes {
    /// Of a volume of which nothing is known.
    pub(super) fn unknown() -> Self {
        Self { bricks: Vec::new(), all: true }
    }

    /// Takes note of a slice's. The list is kept short: each brick once, and no list at all where that would be most of the volume.
    pub(super) fn note(&mut self, touched: &[BrickIndex], all: bool) {
        self.bricks.extend_from_slice(touched);
        if self.bricks.len() > NOTED {
            self.bricks.sort_unstable();
            self.bricks.dedup();
            self.all |= self.bricks.len() > NOTED / 2;
        }
        self.all |= all;
        if self.all {
            self.bricks.clear();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_nobody_asks_for_takes_no_memory_without_end() {
        let mut changes = Changes::default();
        changes.note(&[[1, 2, 3]], false);
        assert_eq!((changes.bricks.as_slice(), changes.all), ([[1, 2, 3]].as_slice(), false));
        let slice = |z| (0..500).map(|x| [x, 0, z]).collect::<Vec<BrickIndex>>();
        // The same slice again and again: its bricks are noted once.
        for _ in 0..1000 {
            changes.note(&slice(0), false);
            assert!(changes.bricks.len() <= NOTED && !changes.all);
        }
        // Slices of a scan that goes on and on.
        for z in 0..1000 {
            changes.note(&slice(z), false);
            assert!(changes.bricks.len() <= NOTED);
        }
        assert!(changes.all && changes.bricks.is_empty() && changes.bricks.capacity() <= 2 * NOTED + 1000);
        let mut changes = Changes::default();
        changes.note(&slice(0), true);
        assert!(changes.all);
    }
}
