//! Times of recorded items.

use calibration::latency::stamps::Stamps;
use sonoweave_core::reading::Stamp;

/// Converts ns to s.
pub(crate) fn seconds(ns: i64) -> f64 {
    ns as f64 * 1e-9
}

/// Returns the measurement times, if the source gives them.
pub(crate) fn stamps(stamp: &Stamp, number: Option<u64>) -> Option<Stamps> {
    let given_s = stamp.host_ns.map(seconds).or(stamp.source_s)?;
    Some(Stamps { given_s, raw_s: stamp.unfiltered_s, number })
}
