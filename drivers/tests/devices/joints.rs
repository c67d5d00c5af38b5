//! Joints that move on a known path, and helpers for arm readings.

use std::sync::Arc;

use drivers::simulated::Joints;
use sonoweave_core::clock::MS;
use sonoweave_core::reading::{Counts, Reading, Status};

use crate::bench::BEGIN;

/// Returns joints that move steadily at different speeds: 10 and −3 counts per ms, and one that
/// oscillates by 500 counts.
pub(crate) fn moving() -> Joints {
    Arc::new(|ns| {
        let us = (ns - BEGIN) / 1000;
        let to_and_fro = (500.0 * (us as f64 * 1e-6).sin()) as i64;
        [us / 100, -3 * us / 1000, to_and_fro, us / 200, 17, -us / 400]
    })
}

/// Returns joints at rest.
pub(crate) fn at_rest() -> Joints {
    Arc::new(|_| [1000, -2000, 3000, 40, -50, 60])
}

/// Returns the counts among the readings.
pub(crate) fn counts(readings: Vec<Reading>) -> Vec<Counts> {
    let counts = readings.into_iter().filter_map(|reading| match reading {
        Reading::Counts(counts) => Some(counts),
        _ => None,
    });
    counts.collect()
}

/// Returns the counts without the item number, which the caller of the protocol assigns.
pub(crate) fn unnumbered(counts: &Counts) -> Counts {
    let mut counts = counts.clone();
    counts.stamp.item = 0;
    counts
}

/// Returns the driver's reason for an invalid reading.
pub(crate) fn text(counts: &Counts) -> &str {
    match &counts.status {
        Status::Ok => "",
        Status::Other(why) => why,
    }
}

/// Returns whether the counts, less the zeros, are true within `resolution_ns` after `at_ns`.
pub(crate) fn is_true(joints: &Joints, counts: &Counts, at_ns: i64, resolution_ns: i64, zeros: &[i64]) -> bool {
    let (from, to) = (joints(at_ns), joints(at_ns + resolution_ns));
    let first = usize::from(counts.first);
    counts.as_slice().iter().zip(zeros).enumerate().all(|(n, (count, zero))| {
        let (a, b) = (from[first + n] - zero, to[first + n] - zero);
        (a.min(b)..=a.max(b)).contains(count)
    })
}

/// Splits the counts before the first one for which `is_first` is true.
pub(crate) fn split(mut counts: Vec<Counts>, is_first: impl Fn(&Counts) -> bool) -> [Vec<Counts>; 2] {
    let at = counts.iter().position(is_first).unwrap_or(counts.len());
    let rest = counts.split_off(at);
    [counts, rest]
}

/// Upper limit of any line's set-up time, ns.
pub(crate) const SOON: i64 = 4000 * MS;
