//! Opens encoder arms: their kinds and their lines.

use std::path::PathBuf;
use std::sync::Arc;

use sonoweave_core::Device;
use sonoweave_core::clock::Clock;

use super::model::{ArmSettings, Model};
use super::{ea1, microscribe, qsb};
use crate::Error;
use crate::connection::Connection;
use crate::transport::{Opener, PortPath, SerialOpener};

/// Opens an arm with the given clock.
///
/// # Errors
/// [`Error::Setting`] for settings that no such arm has.
pub fn open(settings: &ArmSettings, clock: Arc<dyn Clock>) -> Result<Box<dyn Device>, Error> {
    open_on(settings, &clock, |port| Box::new(SerialOpener::new(port, Arc::clone(&clock))))
}

/// Opens an arm on lines that `line` opens, base first.
///
/// # Errors
/// The errors of [`open`].
pub(crate) fn open_on(
    settings: &ArmSettings,
    clock: &Arc<dyn Clock>,
    mut line: impl FnMut(PortPath) -> Box<dyn Opener>,
) -> Result<Box<dyn Device>, Error> {
    let ArmSettings { model, settings, keeps_raw } = settings;
    // Opens the line at the usual rate of its kind; set-up may change it.
    let mut line = |path: &PathBuf, usual| line(PortPath { path: path.clone(), baud: settings.baud.unwrap_or(usual) });
    let clock = Arc::clone(clock);
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

#[cfg(test)]
mod tests {
    use sonoweave_core::Next;
    use sonoweave_core::clock::Monotonic;
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
            let wrong = ArmSettings { settings: wrong, ..settings.clone() };
            let refused = open(&wrong, Arc::new(Monotonic)).err().unwrap();
            assert!(matches!(refused, Error::Setting { device: "arm", setting: "rate_hz", .. }));
            let mut device = open(&settings, Arc::new(Monotonic)).unwrap();
            device.start().unwrap();
            assert!(matches!(device.next(Monotonic.now_ns() + 30_000_000).unwrap(), Next::Pending));
            assert_eq!(device.health().state, State::Absent);
            assert!(device.health().why.contains("/dev/nothing"), "{}", device.health().why);
            device.home(7).unwrap();
            device.stop().unwrap();
        }
    }
}
