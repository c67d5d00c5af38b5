//! The result: compressions of slices, and evidence for them.

use serde::Serialize;

use super::compression::Compression;
use crate::crossings::Directions;

/// Compressions of slices against a light sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct Pressure {
    /// Sweeps of the scan.
    pub directions: Directions,
    /// The compression of each slice, in the order of [`push`](crate::slices::Slices::push); none
    /// of light slices, and of those without a light one nearby.
    pub compressions: Vec<Option<Compression>>,
    /// Evidence.
    pub evidence: Evidence,
}

/// Evidence for compressions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Evidence {
    /// Slices of the sweeps beside the light one, and corrected ones of these.
    pub pressed: usize,
    /// Slices with a compression.
    pub corrected: usize,
    /// Displacement at the image's first row with data, root mean square over slices, mm.
    pub skin_rms_mm: f64,
    /// The largest amount of it, mm.
    pub skin_max_mm: f64,
    /// The median of it, mm: below 0 if the light sweep presses more.
    pub skin_median_mm: f64,
    /// Correlation of windows with the light sweep, median.
    pub correlation: f64,
    /// Share of windows whose correlation is too low to tell a displacement.
    pub unrelated: f64,
    /// Displacement of the image's deepest third, root mean square over slices, mm.
    pub deep_mm: f64,
}
