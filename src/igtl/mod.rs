//! What a session shows to other programs over OpenIGTLink, such as 3D Slicer.
//!
//! | what | as | when |
//! |---|---|---|
//! | each slice, where it lies | IMAGE `Image_World`, TRANSFORM `ImageToWorld` | as they come, the newest first to go; or asked for by GET_IMAGE |
//! | each sensor | TRANSFORM `ProbeToTracker`, …; the same as POSITION; all of them as TDATA | as they come, at most [`POSES_HZ`]; POSITION to who has asked by STT_POSITION, TDATA by STT_TDATA, as often as that says |
//! | the volume | IMAGE `Volume_World` | asked for by GET_IMAGE, and when it has changed, at most every [`VOLUME_EVERY`] |
//! | how it goes | STATUS | every [`STATUS_EVERY`], and asked for by GET_STATUS |
//! | what is understood | CAPABILITY | asked for by GET_CAPABIL |
//!
//! `World` stands for the frame's name in the session, as PLUS names its images. STP_IMAGE, STP_TRANS and STP_TDATA end the sending, STT_… begin it again. COMMAND takes `start`, `stop`
//! and `save` ([`commands`]); so does, for programs of protocol versions 1 and 2, a STRING of the device `CMD_…`, as PLUS has it.
//!
//! **Places.** The world's mm are written unchanged and called RAS, as PLUS writes them: TRANSFORMs cannot say what they are in, and 3D Slicer takes them for RAS, so that only so
//! slices, volume and sensors are at one place. The world is not anatomical, and metadata say so (protocol version 3: `Frame`). A volume's *file* calls the same
//! numbers ITK's (LPS): who loads both sees the file turned about z by 180°.
//!
//! **Versions.** Header version 1 until a client sends version 2; then that, with metadata.
//!
//! Stages of the session put what is new into [`Hub`] and go on: they wait for nobody. All clients are served by one thread that no stage knows of. A client holds at most one
//! message of each name that was not sent yet, the newest; one that takes too little is cut off, and counted.

mod answer;
mod client;
pub mod commands;
mod encode;
mod hub;
mod outbox;
mod publish;
mod server;
#[cfg(test)]
mod tests;

use std::time::Duration;

pub use commands::{Commands, Deed};
pub use hub::Hub;
pub use server::{Counts, Server, ServerError};

/// Between two volumes that are sent unasked, at least.
pub const VOLUME_EVERY: Duration = Duration::from_secs(2);
/// Between two STATUS that are sent unasked.
pub const STATUS_EVERY: Duration = Duration::from_secs(2);
/// Transforms of a name that are sent a second, at most.
pub const POSES_HZ: u32 = 60;
/// The usual port.
pub const PORT: u16 = drivers::openigtlink::driver::PORT;
