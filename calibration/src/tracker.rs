//! How good a tracker is where it stands: the noise of a sensor that lies still, and the places where metal bends the field.
//!
//! - [`noise`]: a sensor that does not move says how much of what it tells is noise.
//! - [`distortion`]: two sensors on one rigid piece, moved through the room, have one constant transform between them. Where it seems to be another one, the field is bent.
//! - [`zones`]: these places, kept, and whether a sensor is in one.
//!
//! The first two take poses as rigid maps to the tracker's frame in mm, in the order of their times, and know nothing of where these come from.

pub mod distortion;
pub mod noise;
pub mod zones;
