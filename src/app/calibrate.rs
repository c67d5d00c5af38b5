//! Calibrations: recordings, guided while they are made, observations in them, and the
//! computation of results.

pub(crate) mod arm;
pub(crate) mod crossings;
pub mod guide;
pub(crate) mod landmarks;
pub(crate) mod latency;
pub(crate) mod outputs;
pub(crate) mod pivot;
pub mod poses;
pub(crate) mod probe;
pub(crate) mod recorded;
pub(crate) mod slices;
mod tip;
pub(crate) mod tracker;
