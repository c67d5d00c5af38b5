//! Lists the connected devices of all kinds, and opens one by its settings.

use std::sync::{Arc, Mutex};

use sonoweave_core::Device;
use sonoweave_core::clock::{Clock, Monotonic};

use crate::error::Error;
use crate::listing::Listing;
use crate::open_settings::OpenSettings;
use crate::transport::{MemoryOpener, Opener, Peer, SerialOpener};
use crate::{arm, grabber, openigtlink, replay, tracker, transport};

/// Lists the devices found now, including those that cannot be opened, with the reason, by the
/// names of the drivers that could open them. Files are not listed, but opened by path.
pub fn list() -> [(&'static str, Vec<Listing>); 4] {
    [
        ("arm", transport::serial::list()),
        ("tracker", tracker::polhemus::list()),
        ("grabber", grabber::list()),
        ("openigtlink", openigtlink::list()),
    ]
}

/// Opens a device without starting it.
///
/// # Errors
/// [`Error`] when the device or file cannot be opened or has the wrong format.
pub fn open(settings: &OpenSettings) -> Result<Box<dyn Device>, Error> {
    let clock: Arc<dyn Clock> = Arc::new(Monotonic);
    Ok(match settings {
        OpenSettings::Arm(settings) => arm::open(settings, clock)?,
        OpenSettings::Tracker(settings) => tracker::polhemus::open(settings, clock)?,
        OpenSettings::Sequence(settings) => Box::new(replay::Replay::open(settings)?),
        OpenSettings::Session(settings) => Box::new(replay::SessionReplay::open(settings)?),
        OpenSettings::Grabber(settings) => Box::new(grabber::Grabber::new(settings.clone(), clock)?),
        OpenSettings::Remote(settings) => openigtlink::open(settings, clock)?,
    })
}

/// Opens a tracker or an arm without starting it, on lines within the process to simulated
/// devices, base first. Readings have the times at which their bytes arrive on the simulated
/// lines, however late the machine reads them. Lines without a simulated device are serial ones,
/// and other devices are opened by [`open`].
///
/// # Errors
/// The errors of [`open`].
pub fn open_simulated(settings: &OpenSettings, devices: &[Arc<Mutex<dyn Peer>>]) -> Result<Box<dyn Device>, Error> {
    let clock: Arc<dyn Clock> = Arc::new(Monotonic);
    let line =
        |device: &Arc<Mutex<dyn Peer>>| -> Box<dyn Opener> { Box::new(MemoryOpener::in_real_time(Arc::clone(device))) };
    match (settings, devices) {
        (OpenSettings::Tracker(settings), [device]) => {
            tracker::polhemus::open_on(settings, line(device), tracker::polhemus::Line::Serial(None), clock)
        }
        (OpenSettings::Arm(settings), _) => {
            let mut devices = devices.iter();
            arm::open_on(settings, &clock, |port| {
                devices.next().map_or_else(|| Box::new(SerialOpener::new(port, Arc::clone(&clock))) as _, line)
            })
        }
        _ => open(settings),
    }
}
