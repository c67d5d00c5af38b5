//! Device drivers and recordings: they read bytes and deliver readings.
//!
//! [`list`] finds the devices that can be opened, and [`open()`] opens one by its typed settings.
//! A [`Device`](sonoweave_core::Device) is started, asked for its next reading, and stopped.
//! Recordings implement the same trait, so code that works on a file also works on live
//! hardware. This crate knows nothing of volumes, calibration or display. Readings keep
//! the units and names of the wire; only the daemon's ingest stage converts them to mm, rad and
//! host nanoseconds.
//!
//! Modules, in the order of the data flow:
//!
//! - [`transport`]: bytes to and from a device.
//! - [`framing`]: splits a byte stream, received in arbitrary pieces, into records; used by
//!   every wire format.
//! - [`connection`]: opens, sets up and reads a device on a line, and reopens it after a loss.
//! - [`tracker`]: electromagnetic trackers, by maker.
//! - [`arm`]: encoder arms of three joints.
//! - [`simulated`]: virtual twins of all devices.
//! - [`replay`]: recorded sequences and sessions as devices.
//! - [`openigtlink`]: readings sent by other programs over a network.
//! - [`grabber`]: frame grabbers over V4L2, and the decoding of their video.
//!
//! Opening fails with an [`Error`]; an open device has [`sonoweave_core::Error`], as any device.

pub mod arm;
pub mod connection;
mod error;
pub mod framing;
pub mod grabber;
mod listing;
mod numerals;
mod open;
mod open_settings;
pub mod openigtlink;
pub mod replay;
pub mod simulated;
pub mod tracker;
pub mod transport;

pub use error::Error;
pub use listing::Listing;
pub use open::{list, open, open_simulated};
pub use open_settings::OpenSettings;
