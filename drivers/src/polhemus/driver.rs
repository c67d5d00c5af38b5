//! Trackers as a driver: what is plugged in, and which of them is meant.

use std::sync::Arc;

use super::settings::Settings;
use super::{Line, fastrak, isotrak, liberty, viper};
use crate::clock::{Clock, Monotonic};
use crate::connection::{Connection, Protocol};
use crate::transport::{Opener, PortPath, SerialOpener, UsbId, UsbOpener, serial, usb};
use crate::{Device, Driver, Error, Listing, OpenSettings};

/// Rate of a serial line until one is looked for, bits a second: the usual one.
const BAUD: u32 = 115_200;
/// The maker's number on USB.
pub const VENDOR: u16 = 0x0f44;

/// A make of tracker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Model {
    /// ISOTRAK, ISOTRAK II and 3SPACE.
    Isotrak,
    /// FASTRAK, and 3SPACE FASTRAK.
    Fastrak,
    /// LIBERTY, and Latus.
    Liberty,
    /// PATRIOT.
    Patriot,
    /// VIPER.
    Viper,
}

impl Model {
    /// All that can be opened.
    pub const ALL: [Self; 5] = [Self::Isotrak, Self::Fastrak, Self::Liberty, Self::Patriot, Self::Viper];

    /// The name in settings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Isotrak => "isotrak",
            Self::Fastrak => "fastrak",
            Self::Liberty => "liberty",
            Self::Patriot => "patriot",
            Self::Viper => "viper",
        }
    }

    /// The product numbers of units that wait for their firmware, by USB.
    fn loaders(self) -> &'static [u16] {
        match self {
            Self::Isotrak | Self::Viper => &[],
            Self::Fastrak => &[0x0001],
            Self::Liberty => &[0xff11, 0xff21],
            Self::Patriot => &[0xef11, 0xef21],
        }
    }

    /// The product numbers of units that run, by USB.
    fn products(self) -> &'static [u16] {
        match self {
            // Serial alone.
            Self::Isotrak => &[],
            Self::Fastrak => &[0x0002, 0x0003],
            Self::Liberty => &[0xff12, 0xff20],
            Self::Patriot => &[0xef12, 0xef20],
            Self::Viper => &[0xbf01],
        }
    }
}

/// What a product number of the maker's is; for a loader, what to tell fxload of the firmware that it waits for.
fn product(number: u16) -> Option<(&'static str, Option<&'static str>)> {
    Some(match number {
        0x0001 => ("FASTRAK", Some("-t fx -I FastrakUSB.hex")),
        0x0002 | 0x0003 => ("FASTRAK", None),
        0xff11 => ("LIBERTY", Some("-t fx -I LbtyUsb.hex")),
        0xff21 => ("LIBERTY", Some("-t fx2 -I LbtyUsbHS.hex")),
        0xff12 | 0xff20 => ("LIBERTY", None),
        0xef11 => ("PATRIOT", Some("-t fx -I PatriotUSB.hex")),
        0xef21 => ("PATRIOT", Some("-t fx2 -I PatriotUSB2.hex")),
        0xef12 | 0xef20 => ("PATRIOT", None),
        0xbf01 => ("VIPER", None),
        0xcf01 => ("G4", None),
        _ => return None,
    })
}

/// What to do about a loader. The firmware is the maker's and may not be passed on.
fn advice(name: &str, options: &str) -> String {
    format!(
        "{name} waits for its firmware, as after every plugging-in: start the maker's software, or run fxload {options} -s a3load.hex -D and its file in /dev/bus/usb, with the maker's files; it then comes back under another number"
    )
}

/// How a tracker is reached.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Port {
    /// A serial line; without a rate it is looked for at all that such units have.
    Serial {
        /// Its file.
        path: std::path::PathBuf,
        /// Bits a second.
        baud: Option<u32>,
    },
    /// USB; `None` where there is only one.
    Usb(Option<String>),
}

/// A tracker to open.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackerSettings {
    /// Which make.
    pub model: Model,
    /// Where.
    pub port: Port,
    /// How it is to be set up.
    pub settings: Settings,
    /// Whether the bytes that come are readings, too.
    pub keeps_raw: bool,
}

/// Polhemus trackers.
pub struct TrackerDriver;

impl TrackerDriver {
    /// Opens a tracker by a clock of one's own.
    ///
    /// # Errors
    /// [`Error::Misuse`] for settings that the model does not have.
    pub fn open_with(settings: &TrackerSettings, clock: Arc<dyn Clock>) -> Result<Box<dyn Device>, Error> {
        let TrackerSettings { model, port, settings, keeps_raw } = settings;
        let (opener, line): (Box<dyn Opener>, _) = match port {
            Port::Serial { path, baud } => {
                let port = PortPath { path: path.clone(), baud: baud.unwrap_or(BAUD) };
                (Box::new(SerialOpener::new(port, Arc::clone(&clock))), Line::Serial(*baud))
            }
            Port::Usb(which) => {
                let waits =
                    |number: &u16| product(*number).and_then(|(name, options)| Some((*number, advice(name, options?))));
                let loaders = model.loaders().iter().filter_map(waits).collect();
                let products = model.products().to_vec();
                let id = UsbId { vendor: VENDOR, products, loaders, which: which.clone() };
                (Box::new(UsbOpener::new(id, Arc::clone(&clock))), Line::Usb)
            }
        };
        let name = opener.name().to_owned();
        fn connect<P: Protocol + 'static>(
            opener: Box<dyn Opener>,
            clock: Arc<dyn Clock>,
            protocol: P,
            keeps_raw: bool,
        ) -> Box<dyn Device> {
            Box::new(Connection::new(opener, clock, protocol, keeps_raw))
        }
        let settings = settings.clone();
        Ok(match model {
            Model::Isotrak => connect(opener, clock, isotrak::Unit::new(&name, settings, line)?, *keeps_raw),
            Model::Fastrak => connect(opener, clock, fastrak::Unit::new(&name, settings, line)?, *keeps_raw),
            Model::Liberty | Model::Patriot => {
                connect(opener, clock, liberty::Unit::new(&name, settings, line)?, *keeps_raw)
            }
            Model::Viper => connect(opener, clock, viper::Unit::new(&name, settings, line)?, *keeps_raw),
        })
    }
}

impl Driver for TrackerDriver {
    fn name(&self) -> &'static str {
        "tracker"
    }

    fn list(&self) -> Vec<Listing> {
        let mut found = serial::list();
        match usb::list(VENDOR) {
            Ok(devices) => found.extend(devices.iter().map(listing)),
            Err(why) => found.push(Listing {
                id: "usb".into(),
                description: "USB".into(),
                unavailable: Some(format!("USB cannot be looked at: {why}")),
            }),
        }
        found
    }

    fn open(&self, settings: &OpenSettings) -> Result<Box<dyn Device>, Error> {
        match settings {
            OpenSettings::Tracker(settings) => Self::open_with(settings, Arc::new(Monotonic)),
            _ => Err(Error::Misuse("these settings are not a tracker's".into())),
        }
    }
}

/// A device of the maker's on USB, in words.
fn listing(device: &nusb::DeviceInfo) -> Listing {
    let place = usb::place(device);
    let id = format!("usb:{}", device.serial_number().unwrap_or(&place));
    let number = device.product_id();
    let (name, unavailable) = match product(number) {
        None => ("unknown product".to_owned(), Some("not known to this version".to_owned())),
        Some((name, Some(options))) => (format!("{name} that waits for its firmware"), Some(advice(name, options))),
        Some(("G4", _)) => ("G4".into(), Some("its protocol is not public".into())),
        Some((name, None)) => (name.to_owned(), usb::unavailable(device)),
    };
    Listing { id, description: format!("Polhemus {name} ({VENDOR:04x}:{number:04x}) on USB {place}"), unavailable }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loaders_are_told_from_units_that_run() {
        for model in Model::ALL {
            for number in model.products() {
                assert!(matches!(product(*number), Some((_, None))), "{model:?} {number:04x}");
            }
            for number in model.loaders() {
                let (name, options) = product(*number).unwrap();
                assert!(name.eq_ignore_ascii_case(model.name()) && options.is_some(), "{model:?} {number:04x}");
            }
        }
        assert_eq!(product(0x1234), None);
    }

    #[test]
    fn settings_of_another_kind_are_refused_and_those_of_this_kind_checked() {
        let other = TrackerDriver.open(&OpenSettings::sequence("x.mha")).err().unwrap().to_string();
        assert!(other.contains("not a tracker's"), "{other}");
        let port = Port::Serial { path: "/dev/nothing".into(), baud: None };
        let settings = TrackerSettings { model: Model::Fastrak, port, settings: Settings::default(), keeps_raw: false };
        let wrong = Settings { stations: vec![7], ..Settings::default() };
        let wrong = OpenSettings::Tracker(TrackerSettings { settings: wrong, ..settings.clone() });
        assert!(TrackerDriver.open(&wrong).err().unwrap().to_string().contains("tracker.stations"));
        for rate_hz in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let wrong = Settings { rate_hz, ..Settings::default() };
            let wrong = OpenSettings::Tracker(TrackerSettings { settings: wrong, ..settings.clone() });
            assert!(TrackerDriver.open(&wrong).err().unwrap().to_string().contains("tracker.rate_hz"));
        }
        // What is not there is no error: it may come.
        let mut device = TrackerDriver.open(&OpenSettings::Tracker(settings)).unwrap();
        device.start().unwrap();
        let now = Monotonic.now_ns();
        assert!(matches!(device.next(now + 20_000_000).unwrap(), crate::Next::Pending));
        assert_eq!(device.health().state, crate::health::State::Absent);
        assert!(device.health().why.contains("/dev/nothing"), "{}", device.health().why);
    }
}
