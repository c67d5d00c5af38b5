//! The application: sessions, replays, calibrations, reconstruction, rendering and conversion. It
//! neither parses flags nor prints, and does not know the command line, which calls it.
//!
//! - [`calibrate`]: guided recordings, observations and computations of calibrations.
//! - [`convert`]: recordings and volumes from one file to another.
//! - [`devices`]: a session's devices, opened; virtual devices for those that are not there.
//! - [`service`]: a session's notifications to systemd.

pub(crate) mod batch;
pub mod calibrate;
pub(crate) mod contours;
pub mod convert;
pub(crate) mod correct;
pub mod devices;
pub(crate) mod doctor;
pub(crate) mod histogram;
pub(crate) mod igtl;
pub(crate) mod init;
pub mod input;
pub(crate) mod json;
pub(crate) mod labels;
pub(crate) mod live;
pub(crate) mod part;
pub(crate) mod provenance;
pub(crate) mod pseudonym;
pub(crate) mod reconstruct;
pub(crate) mod region;
pub(crate) mod render;
pub(crate) mod replay;
pub(crate) mod reporter;
pub mod service;
pub(crate) mod sha256;
pub(crate) mod surface;
pub(crate) mod volume_input;
