//! Bricks of a volume that have changed since the last query, in bounded memory.

use volume::brick::BrickIndex;

/// Bricks that are listed individually. Beyond that, all bricks count as changed, which bounds
/// the memory if nobody queries for long.
const NOTED: usize = 1 << 16;

/// Bricks that have changed since the last query, on the canonical lattice.
#[derive(Debug, Default)]
pub(super) struct Changes {
    /// Each at least once; empty if any brick may have changed.
    pub(super) bricks: Vec<BrickIndex>,
    /// Whether any brick may have changed.
    pub(super) all: bool,
}

impl Changes {
    /// Returns the changes of an unknown volume: any brick may have changed.
    pub(super) fn unknown() -> Self {
        Self { bricks: Vec::new(), all: true }
    }

    /// Adds the bricks of a slice. The list stays short: each brick occurs once, and a list that
    /// would cover most of the volume is replaced by `all`.
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
    fn changes_without_query_stay_bounded() {
        let mut changes = Changes::default();
        changes.note(&[[1, 2, 3]], false);
        assert_eq!((changes.bricks.as_slice(), changes.all), ([[1, 2, 3]].as_slice(), false));
        let slice = |z| (0..500).map(|x| [x, 0, z]).collect::<Vec<BrickIndex>>();
        // The same slice repeated: its bricks are listed once.
        for _ in 0..1000 {
            changes.note(&slice(0), false);
            assert!(changes.bricks.len() <= NOTED && !changes.all);
        }
        // Slices of an endless scan.
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
