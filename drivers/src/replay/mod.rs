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

use sonoweave_core::Device;

use crate::{Driver, Error, Listing, OpenSettings};

/// Opens sequence files.
#[derive(Debug)]
pub struct SequenceDriver;

impl Driver for SequenceDriver {
    fn name(&self) -> &'static str {
        "sequence"
    }

    fn list(&self) -> Vec<Listing> {
        Vec::new()
    }

    fn open(&self, settings: &OpenSettings) -> Result<Box<dyn Device>, Error> {
        let OpenSettings::Sequence(settings) = settings else {
            return Err(Error::OtherDriver(self.name()));
        };
        Ok(Box::new(Replay::open(settings)?))
    }
}

/// Opens sessions.
#[derive(Debug)]
pub struct SessionDriver;

impl Driver for SessionDriver {
    fn name(&self) -> &'static str {
        "session"
    }

    fn list(&self) -> Vec<Listing> {
        Vec::new()
    }

    fn open(&self, settings: &OpenSettings) -> Result<Box<dyn Device>, Error> {
        let OpenSettings::Session(settings) = settings else {
            return Err(Error::OtherDriver(self.name()));
        };
        Ok(Box::new(SessionReplay::open(settings)?))
    }
}
