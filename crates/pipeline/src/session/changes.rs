//! Bricks of a volume that have changed since the last query, in bounded memory.

use volume::Prism;
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
    /// The changes so far by slice: one slice's slab is known, of several no slab is.
    slices: Slices,
}

/// Slices that a picture has not shown yet.
#[derive(Debug, Default)]
enum Slices {
    #[default]
    None,
    /// One, with the slab that holds its changes.
    One(Prism),
    Several,
}

impl Changes {
    /// Returns the changes of an unknown volume: any brick may have changed.
    pub(super) fn unknown() -> Self {
        Self { bricks: Vec::new(), all: true, slices: Slices::Several }
    }

    /// Adds the bricks of a slice, and the slab that holds its changes, if it is known. The list
    /// stays short: each brick occurs once, and a list that would cover most of the volume is
    /// replaced by `all`.
    pub(super) fn note(&mut self, touched: &[BrickIndex], slab: Option<Prism>, all: bool) {
        self.slices = match (&self.slices, slab) {
            (Slices::None, Some(slab)) if !all => Slices::One(slab),
            _ => Slices::Several,
        };
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

    /// Notes that a picture shows all changes. Returns the slab that holds them, if they are those
    /// of one slice.
    pub(super) fn shown(&mut self) -> Option<Prism> {
        self.bricks.clear();
        match std::mem::take(&mut self.slices) {
            Slices::One(slab) => Some(slab),
            Slices::None | Slices::Several => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_without_query_stay_bounded() {
        let mut changes = Changes::default();
        changes.note(&[[1, 2, 3]], None, false);
        assert_eq!((changes.bricks.as_slice(), changes.all), ([[1, 2, 3]].as_slice(), false));
        let slice = |z| (0..500).map(|x| [x, 0, z]).collect::<Vec<BrickIndex>>();
        // The same slice repeated: its bricks are listed once.
        for _ in 0..1000 {
            changes.note(&slice(0), None, false);
            assert!(changes.bricks.len() <= NOTED && !changes.all);
        }
        // Slices of an endless scan.
        for z in 0..1000 {
            changes.note(&slice(z), None, false);
            assert!(changes.bricks.len() <= NOTED);
        }
        assert!(changes.all && changes.bricks.is_empty() && changes.bricks.capacity() <= 2 * NOTED + 1000);
        let mut changes = Changes::default();
        changes.note(&slice(0), None, true);
        assert!(changes.all);
    }
    #[test]
    fn slab_is_known_for_exactly_one_slice() {
        let axes = [glam::DVec3::X, glam::DVec3::Y, glam::DVec3::Z];
        let slab = Prism::between(axes.map(|axis| (0.0, axis)), [[0.0, 7.0]; 3]);
        assert!(slab.is_some());
        let shown = |slices: &[(Option<Prism>, bool)]| {
            let mut changes = Changes::default();
            slices.iter().for_each(|(slab, all)| changes.note(&[[0; 3]], *slab, *all));
            // A part of the bricks has been read meanwhile.
            changes.bricks.clear();
            let first = changes.shown();
            assert_eq!(changes.shown(), None);
            changes.note(&[[1; 3]], slab, false);
            assert_eq!(changes.shown(), slab, "the next picture begins anew");
            first
        };
        assert_eq!(shown(&[(slab, false)]), slab);
        assert_eq!([&[][..], &[(None, false)], &[(slab, true)]].map(shown), [None; 3]);
        assert_eq!([&[(slab, false), (slab, false)], &[(None, false), (slab, false)]].map(|two| shown(two)), [None; 2]);
    }
}
