//! Geometry and least squares. Knows nothing of devices or volumes.
//!
//! - [`frames`]: transforms that carry the names of the frames they map between; mismatched frames do not compile.

pub mod frames;
