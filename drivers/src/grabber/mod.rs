//! Frame grabbers: video in, pictures of 8 bits out.
//!
//! - [`pixels`]: formats of video to pictures, without a device.

pub mod pixels;
