//! Recordings: sequence files, sessions and recorded lines, and the devices that replay them at
//! any pace.

mod decode;
mod line;
mod pace;
mod sequence;
mod session;
mod settings;

pub use decode::{arm_protocol, line_protocol, tracker_protocol};
pub use line::{LineReplay, Source};
pub use pace::{Pace, Pacer};
pub use sequence::Replay;
pub use session::SessionReplay;
pub use settings::{Progress, SequenceSettings, SessionSettings};
