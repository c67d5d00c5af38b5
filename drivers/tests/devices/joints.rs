//! Joints that move on a known way, and what arms say of them.

use std::sync::Arc;

use drivers::clock::MS;
use drivers::reading::{Counts, Reading, Status};
use drivers::simulated::Joints;

use crate::bench::BEGIN;

/// Joints that go on steadily, at other speeds each: 10 and −3 counts a ms, and one that goes to and fro by 500 counts.
pub(crate) fn moving() -> Joints {
    Arc::new(|ns| {
        let us = (ns - BEGIN) / 1000;
        let to_and_fro = (500.0 * (us as f64 * 1e-6).sin()) as i64;
        [us / 100, -3 * us / 1000, to_and_fro, us / 200, 17, -us / 400]
    })
}

/// Joints at rest.
pub(crate) fn at_rest() -> Joints {
    Arc::new(|_| [1000, -2000, 3000, 40, -50, 60])
}

/// The counts among the readings.
pub(crate) fn counts(readings: Vec<Reading>) -> Vec<Counts> {
    let counts = readings.into_iter().filter_map(|reading| match reading {
        Reading::Counts(counts) => Some(counts),
        _ => None,
    });
    counts.collect()
}

/// The same, without the number that whoever asks gives it.
pub(crate) fn unnumbered(counts: &Counts) -> Counts {
    let mut counts = counts.clone();
    counts.stamp.item = 0;
    counts
}

/// What a driver says of a reading that it does not vouch for.
pub(crate) fn said(counts: &Counts) -> &str {
    match &counts.status {
        Status::Ok => "",
        Status::Other(why) => why,
    }
}

/// Whether the counts are the true ones, less the zeros, at a time that is known to a resolution.
pub(crate) fn is_true(joints: &Joints, counts: &Counts, at_ns: i64, resolution_ns: i64, zeros: &[i64]) -> bool {
    let (from, to) = (joints(at_ns), joints(at_ns + resolution_ns));
    let first = usize::from(counts.first);
    counts.as_slice().iter().zip(zeros).enumerate().all(|(n, (count, zero))| {
        let (a, b) = (from[first + n] - zero, to[first + n] - zero);
        (a.min(b)..=a.max(b)).contains(count)
    })
}

/// The counts before the first of which this is so, and those from it on.
pub(crate) fn split(mut counts: Vec<Counts>, is_first: impl Fn(&Counts) -> bool) -> [Vec<Counts>; 2] {
    let at = counts.iter().position(is_first).unwrap_or(counts.len());
    let rest = counts.split_off(at);
    [counts, rest]
}

/// A time that a line of any kind takes at most to be set up, ns.
pub(crate) const SOON: i64 = 4000 * MS;
