//! Time for which recorded data have not been synced: they do not survive a power cut.

use std::path::Path;

use sonoweave_core::clock::SECOND;

/// The disk counts as slow until the data have been synced in time for so long, ns.
const CALM_NS: i64 = 10 * SECOND;

/// Age of the recorded data that a power cut would take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Unsynced {
    /// The present age of the oldest such message, ns.
    pub now_ns: i64,
    /// The largest so far, ns.
    pub most_ns: i64,
    /// When it last exceeded a second, in the last 10 s: the disk is too slow. Host time, ns.
    pub late_ns: Option<i64>,
}

impl Unsynced {
    /// Notes that everything is synced.
    pub(super) fn ended(&mut self) {
        (self.now_ns, self.late_ns) = (0, None);
    }

    /// Notes the present age. Logs when the disk begins to be too slow, and when it no longer is.
    pub(super) fn note(&mut self, age_ns: i64, now_ns: i64, path: &Path) {
        (self.now_ns, self.most_ns) = (age_ns, self.most_ns.max(age_ns));
        if age_ns > SECOND {
            if self.late_ns.is_none() {
                let seconds = age_ns as f64 * 1e-9;
                tracing::warn!(
                    "{}: the disk is slow: a power cut now would take the last {seconds:.1} s of the recording",
                    path.display()
                );
            }
            self.late_ns = Some(now_ns);
        } else if self.late_ns.is_some_and(|late_ns| now_ns - late_ns > CALM_NS) {
            tracing::warn!("{}: the disk is fast enough again: a power cut takes at most a second", path.display());
            self.late_ns = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sonoweave_core::clock::MS;

    #[test]
    fn disk_is_slow_until_synced_in_time_for_ten_seconds() {
        let mut unsynced = Unsynced::default();
        let mut is_slow = |age_ns, now_s: i64| {
            unsynced.note(age_ns, now_s * SECOND, Path::new("a.mcap"));
            (unsynced.late_ns.is_some(), unsynced.now_ns, unsynced.most_ns)
        };
        assert_eq!(is_slow(SECOND, 1), (false, SECOND, SECOND));
        assert_eq!(is_slow(3 * SECOND, 2), (true, 3 * SECOND, 3 * SECOND));
        assert_eq!(is_slow(400 * MS, 12), (true, 400 * MS, 3 * SECOND));
        assert_eq!(is_slow(2 * SECOND, 13), (true, 2 * SECOND, 3 * SECOND));
        assert_eq!(is_slow(0, 23), (true, 0, 3 * SECOND));
        assert_eq!(is_slow(0, 24), (false, 0, 3 * SECOND));
    }
}
