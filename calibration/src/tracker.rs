//! Accuracy of a tracker in its room: noise of a static sensor, and distortion of the field by
//! metal.
//!
//! - [`noise`]: noise of the poses of a sensor that does not move.
//! - [`distortion`]: map of the field's distortion. Two sensors on one rigid piece, moved
//!   through the room, have one constant transform between them. If it appears to change, the
//!   field is distorted.
//! - [`zones`]: the distorted places, for lookup of a sensor's position.
//!
//! The first two take poses as rigid maps to the tracker's frame in mm, in the order of time,
//! from any source.

pub mod distortion;
pub mod noise;
pub mod zones;
