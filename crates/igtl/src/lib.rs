//! Sends a session's data to other programs over OpenIGTLink, such as 3D Slicer.
//!
//! | content | message | time |
//! |---|---|---|
//! | each slice with its pose | IMAGE `Image_World`, TRANSFORM `ImageToWorld` | on arrival, replacing an unsent one; or by GET_IMAGE |
//! | each sensor | TRANSFORM `ProbeToTracker`, …; also POSITION; all as TDATA | on arrival, at most [`POSES_HZ`]; POSITION after STT_POSITION, TDATA after STT_TDATA, at the requested rate |
//! | the volume | IMAGE `Volume_World` | by GET_IMAGE, and after changes, at most every [`VOLUME_EVERY`] |
//! | the session status | STATUS | every [`STATUS_EVERY`], and by GET_STATUS |
//! | the message types understood | CAPABILITY | by GET_CAPABIL |
//!
//! `World` stands for the coordinate system's name in the session, as PLUS names its images.
//! STP_IMAGE, STP_TRANS and STP_TDATA stop the sending, STT_… resumes it. COMMAND takes
//! `start`, `stop`, `save`, `freeze`, `unfreeze` and `clear` ([`commands`]). Programs of protocol
//! versions 1 and 2 send a STRING of the device `CMD_…` instead, as in PLUS.
//!
//! **Coordinates.** World mm are sent unchanged and declared as RAS, as in PLUS. TRANSFORMs
//! cannot name their coordinate system, and 3D Slicer assumes RAS for them. Only thus do
//! slices, volume and sensors coincide. The world is not anatomical, and metadata say so
//! (protocol version 3: `Frame`). A volume's *file* declares the same numbers as ITK's (LPS). A
//! program that loads both shows the file turned about z by 180°.
//!
//! **Versions.** Header version 1 until a client sends version 2; then that, with metadata.
//!
//! **Access.** The server listens on this machine only, unless networks are allowed. It then closes
//! connections from addresses outside them at once. Commands come from this machine only. The
//! number of clients, of those of one address, and of a client's messages per second are limited.
//!
//! Stages of the session store changes in [`Hub`] and go on; they never wait. One thread,
//! unknown to the stages, serves all clients. For each client, at most one unsent message of
//! each name is kept, the newest. A client that receives too little is disconnected, and
//! counted.

mod admission;
mod answer;
mod client;
pub mod commands;
mod connection;
mod counts;
mod encode;
mod error;
mod hub;
mod outbox;
mod publish;
mod server;
mod state;
#[cfg(test)]
mod tests;

use std::time::Duration;

pub use commands::Commands;
pub use counts::Counts;
pub use error::IgtlError;
pub use hub::Hub;
pub use server::Server;

/// Shortest interval of volumes sent without request.
pub const VOLUME_EVERY: Duration = Duration::from_secs(2);
/// Interval of STATUS messages sent without request.
pub const STATUS_EVERY: Duration = Duration::from_secs(2);
/// Highest rate of transforms of one name, per second.
pub const POSES_HZ: u32 = 60;
/// The default port.
pub const PORT: u16 = drivers::openigtlink::driver::PORT;
