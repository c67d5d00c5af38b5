//! Recordings: sequence files and sessions, and the devices that replay them at any pace.

mod decode;
mod pace;
mod sequence;
mod session;
mod settings;

pub use decode::{arm_protocol, line_protocol, tracker_protocol};
pub use pace::{Pace, Pacer};
pub use sequence::Replay;
pub use session::SessionReplay;
pub use settings::{Progress, SequenceSettings, SessionSettings};
