//! Waits for fresh memory in the threads that must be fast.

use serde::Serialize;

use sonoweave_core::page_faults::of_threads;

/// Slices after which page faults are counted: the first ones make the tables.
pub(super) const SLICES_BEFORE: u64 = 10;

/// Page faults of the threads that insert slices and render their picture.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct PageFaults {
    /// Those of insertion.
    pub insertion: u64,
    /// Those of rendering.
    pub rendering: u64,
}

impl PageFaults {
    /// Returns those of the present threads since their start.
    pub(super) fn now() -> Self {
        Self { insertion: of_threads(inserts), rendering: of_threads(renders) }
    }

    /// Returns those since an earlier time, and at least those counted before: a thread that has
    /// ended is no longer among the present ones.
    pub(super) fn since(self, earlier: Self, counted: Option<Self>) -> Self {
        let counted = counted.unwrap_or_default();
        Self {
            insertion: self.insertion.saturating_sub(earlier.insertion).max(counted.insertion),
            rendering: self.rendering.saturating_sub(earlier.rendering).max(counted.rendering),
        }
    }
}

fn inserts(thread: &str) -> bool {
    thread == "insertion" || is_of_pool(thread, "insert-")
}

fn renders(thread: &str) -> bool {
    thread == "picture" || thread == "draw" || is_of_pool(thread, "render-")
}

fn is_of_pool(thread: &str, pool: &str) -> bool {
    thread.strip_prefix(pool).is_some_and(|number| number.parse::<u32>().is_ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_that_prepare_memory_are_not_counted() {
        let named = |name: &str| [inserts(name), renders(name)];
        for (name, expected) in [
            ("insertion", [true, false]),
            ("insert-11", [true, false]),
            ("picture", [false, true]),
            ("draw", [false, true]),
            ("render-0", [false, true]),
            ("render-memory", [false, false]),
            ("volume-memory", [false, false]),
        ] {
            assert_eq!(named(name), expected, "{name}");
        }
    }

    #[test]
    fn counts_never_fall() {
        let faults = |insertion, rendering| PageFaults { insertion, rendering };
        assert_eq!(faults(9, 2).since(faults(4, 2), Some(faults(3, 1))), faults(5, 1));
        assert_eq!(faults(9, 1).since(faults(4, 2), None), faults(5, 0));
    }
}
