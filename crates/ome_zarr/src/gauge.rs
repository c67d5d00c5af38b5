//! Counts the shards in memory, so that tests and reports know the most.

use std::sync::atomic::{AtomicUsize, Ordering};

/// Number of shards in memory, and the most there were.
#[derive(Debug, Default)]
pub(crate) struct Gauge {
    now: AtomicUsize,
    most: AtomicUsize,
}

/// Some shards in memory, until this is dropped.
pub(crate) struct Counted<'a> {
    gauge: &'a Gauge,
    shards: usize,
}

impl Gauge {
    /// Counts shards of which memory is about to be taken.
    pub(crate) fn take(&self, shards: usize) -> Counted<'_> {
        let now = self.now.fetch_add(shards, Ordering::Relaxed) + shards;
        self.most.fetch_max(now, Ordering::Relaxed);
        Counted { gauge: self, shards }
    }

    /// Returns the most shards that were in memory at once.
    pub(crate) fn most(&self) -> usize {
        self.most.load(Ordering::Relaxed)
    }
}

impl Drop for Counted<'_> {
    fn drop(&mut self) {
        self.gauge.now.fetch_sub(self.shards, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn most_is_of_one_moment() {
        let gauge = Gauge::default();
        let two = gauge.take(2);
        drop(gauge.take(3));
        drop(two);
        drop(gauge.take(4));
        assert_eq!(gauge.most(), 5);
    }
}
