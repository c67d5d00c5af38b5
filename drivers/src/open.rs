//! Lists the connected devices of all kinds, and opens one by its settings.

use std::sync::Arc;

use sonoweave_core::Device;
use sonoweave_core::clock::{Clock, Monotonic};

use crate::error::Error;
use crate::listing::Listing;
use crate::open_settings::OpenSettings;
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
