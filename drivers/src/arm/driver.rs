//! Driver of encoder arms: their kinds and their lines.

use std::path::PathBuf;
use std::sync::Arc;

use sonoweave_core::Device;
use sonoweave_core::clock::{Clock, Monotonic};

use super::model::{ArmSettings, Model};
use super::{ea1, microscribe, qsb};
use crate::Error;
use crate::connection::Connection;
use crate::transport::{Opener, PortPath, SerialOpener, serial};
use crate::{Driver, Listing, OpenSettings};

/// Encoder arms.
pub struct ArmDriver;

impl ArmDriver {
    /// Opens an arm with the given clock.
    ///
    /// # Errors
    /// [`Error::Setting`] for settings that no such arm has.
    pub fn open_with(settings: &ArmSettings, clock: Arc<dyn Clock>) -> Result<Box<dyn Device>, Error> {
        let ArmSettings { model, settings, keeps_raw } = settings;
        // Opens the line at the usual rate of its kind; set-up may change it.
        let line = |path: &PathBuf, usual: u32| -> Box<dyn Opener> {
            let port = PortPath { path: path.clone(), baud: settings.baud.unwrap_or(usual) };
            Box::new(SerialOpener::new(port, Arc::clone(&clock)))
        };
        Ok(match model {
            Model::Ea1 { path, format } => {
                let opener = line(path, ea1::unit::BAUD);
                let unit = ea1::Unit::new(opener.name(), settings.clone(), *format)?;
                Box::new(Connection::new(opener, clock, unit, *keeps_raw))
            }
            Model::Qsb { paths } => {
                let openers = paths.each_ref().map(|path| line(path, qsb::unit::BAUD));
                Box::new(qsb::Arm::new(openers, clock, settings, *keeps_raw)?)
            }
            Model::MicroScribe { path, family, encoders } => {
                let opener = line(path, microscribe::unit::BAUDS[0]);
                let unit = microscribe::Unit::new(opener.name(), settings.clone(), *family, *encoders)?;
                Box::new(Connection::new(opener, clock, unit, *keeps_raw))
            }
        })
    }
}

impl Driver for ArmDriver {
    fn name(&self) -> &'static str {
        "arm"
    }

    fn list(&self) -> Vec<Listing> {
        serial::list()
    }

    fn open(&self, settings: &OpenSettings) -> Result<Box<dyn Device>, Error> {
        match settings {
            OpenSettings::Arm(settings) => Self::open_with(settings, Arc::new(Monotonic)),
            _ => Err(Error::OtherDriver(self.name())),
        }
    }
}

#[cfg(test)]
mod tests {
    use sonoweave_core::Next;
    use sonoweave_core::health::State;

    use super::*;
    use crate::arm::Settings;
    use crate::arm::ea1::SampleFormat;
    use crate::arm::microscribe::Family;

    #[test]
    fn each_kind_opens_and_missing_arm_is_awaited() {
        let path = || PathBuf::from("/dev/nothing");
        let kinds = [
            Model::Ea1 { path: path(), format: SampleFormat::Lines },
            Model::Qsb { paths: [path(), path(), path()] },
            Model::MicroScribe { path: path(), family: Family::MicroScribe, encoders: 5 },
        ];
        for model in kinds {
            let wrong = Settings { rate_hz: 0, ..Settings::default() };
            let settings = ArmSettings { model, settings: Settings::default(), keeps_raw: false };
            let wrong = OpenSettings::Arm(ArmSettings { settings: wrong, ..settings.clone() });
            let refused = ArmDriver.open(&wrong).err().unwrap();
            assert!(matches!(refused, Error::Setting { device: "arm", setting: "rate_hz", .. }));
            let mut device = ArmDriver.open(&OpenSettings::Arm(settings)).unwrap();
            device.start().unwrap();
            assert!(matches!(device.next(Monotonic.now_ns() + 30_000_000).unwrap(), Next::Pending));
            assert_eq!(device.health().state, State::Absent);
            assert!(device.health().why.contains("/dev/nothing"), "{}", device.health().why);
            device.home(7).unwrap();
            device.stop().unwrap();
        }
        let other = ArmDriver.open(&OpenSettings::sequence("x.mha")).err().unwrap();
        assert!(matches!(other, Error::OtherDriver("arm")));
        assert_eq!(ArmDriver.name(), "arm");
    }
}
