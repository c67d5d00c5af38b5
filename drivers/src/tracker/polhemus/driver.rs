//! Polhemus trackers: lists the connected units and opens the selected one.

use std::sync::Arc;

use sonoweave_core::Device;
use sonoweave_core::clock::Clock;

use super::model::{Model, Port, TrackerSettings};
use super::{Line, fastrak, isotrak, liberty, viper};
use crate::connection::{Connection, Protocol};
use crate::listing::USB;
use crate::transport::{Opener, PortPath, SerialOpener, UsbId, UsbOpener, serial, usb};
use crate::{Error, Listing};

/// Usual serial rate, for opening the line before the rate is known, bits per second.
const BAUD: u32 = 115_200;
/// USB vendor number of Polhemus.
pub const VENDOR: u16 = 0x0f44;

/// Returns the model with this product number, and the fxload options if it is a loader that
/// waits for firmware.
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

/// Returns the advice for a loader. The firmware belongs to the manufacturer and must not be
/// redistributed.
fn advice(name: &str, options: &str) -> String {
    format!(
        "{name} waits for its firmware, as after every plugging-in: start the maker's software, or run fxload {options} -s a3load.hex -D and its file in /dev/bus/usb, with the maker's files; it then comes back under another number"
    )
}

/// Opens a tracker with the given clock.
///
/// # Errors
/// [`Error::Setting`] for settings that the model does not have.
pub fn open(settings: &TrackerSettings, clock: Arc<dyn Clock>) -> Result<Box<dyn Device>, Error> {
    let (opener, line): (Box<dyn Opener>, _) = match &settings.port {
        Port::Serial { path, baud } => {
            let port = PortPath { path: path.clone(), baud: baud.unwrap_or(BAUD) };
            (Box::new(SerialOpener::new(port, Arc::clone(&clock))), Line::Serial(*baud))
        }
        Port::Usb(which) => {
            let waits =
                |number: &u16| product(*number).and_then(|(name, options)| Some((*number, advice(name, options?))));
            let loaders = settings.model.loaders().iter().filter_map(waits).collect();
            let products = settings.model.products().to_vec();
            let id = UsbId { vendor: VENDOR, products, loaders, which: which.clone() };
            (Box::new(UsbOpener::new(id, Arc::clone(&clock))), Line::Usb)
        }
    };
    open_on(settings, opener, line, clock)
}

/// Opens a tracker on a given line.
///
/// # Errors
/// The errors of [`open`].
pub(crate) fn open_on(
    settings: &TrackerSettings,
    opener: Box<dyn Opener>,
    line: Line,
    clock: Arc<dyn Clock>,
) -> Result<Box<dyn Device>, Error> {
    let TrackerSettings { model, settings, keeps_raw, .. } = settings;
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

/// Lists the serial lines and the units on USB.
pub fn list() -> Vec<Listing> {
    let mut found = serial::list();
    match usb::list(VENDOR) {
        Ok(devices) => found.extend(devices.iter().map(listing)),
        Err(why) => found.push(Listing {
            id: USB.into(),
            description: "USB".into(),
            unavailable: Some(format!("USB devices cannot be listed: {why}")),
        }),
    }
    found
}

/// Describes a USB device of the manufacturer.
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
    use sonoweave_core::clock::Monotonic;

    use super::*;
    use crate::tracker::polhemus::Settings;

    #[test]
    fn loaders_differ_from_running_units() {
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
    fn invalid_settings_are_refused() {
        let refused = |settings: &TrackerSettings| open(settings, Arc::new(Monotonic)).err().unwrap();
        let port = Port::Serial { path: "/dev/nothing".into(), baud: None };
        let settings = TrackerSettings { model: Model::Fastrak, port, settings: Settings::default(), keeps_raw: false };
        let wrong = Settings { stations: vec![7], ..Settings::default() };
        let wrong = TrackerSettings { settings: wrong, ..settings.clone() };
        assert!(matches!(refused(&wrong), Error::Setting { setting: "stations", .. }));
        for rate_hz in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let wrong = Settings { rate_hz, ..Settings::default() };
            let wrong = TrackerSettings { settings: wrong, ..settings.clone() };
            assert!(matches!(refused(&wrong), Error::Setting { setting: "rate_hz", .. }));
        }
        // A missing device is not an error, because it may be connected later.
        let mut device = open(&settings, Arc::new(Monotonic)).unwrap();
        device.start().unwrap();
        let now = Monotonic.now_ns();
        assert!(matches!(device.next(now + 20_000_000).unwrap(), sonoweave_core::Next::Pending));
        assert_eq!(device.health().state, sonoweave_core::health::State::Absent);
        assert!(device.health().why.contains("/dev/nothing"), "{}", device.health().why);
    }
}
