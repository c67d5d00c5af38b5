//! A driver: one kind of device, and the settings that open one.

use std::path::PathBuf;

use sonoweave_core::Device;

use crate::error::Error;
use crate::listing::Listing;
use crate::{arm, grabber, openigtlink, replay, tracker};

/// One kind of device: lists the devices that can be opened and opens them.
pub trait Driver: Sync {
    /// Short, stable name, as used in configuration files and logs.
    fn name(&self) -> &'static str;

    /// Lists the devices found now, including those that cannot be opened, with the reason.
    /// File drivers list nothing: files are opened by path.
    fn list(&self) -> Vec<Listing>;

    /// Opens a device without starting it.
    ///
    /// # Errors
    /// [`Error`] when the settings are for another driver, or when the device or file cannot be
    /// opened or has the wrong format.
    fn open(&self, settings: &OpenSettings) -> Result<Box<dyn Device>, Error>;
}

/// Settings of the device to open. One variant per driver.
#[derive(Debug, Clone)]
pub enum OpenSettings {
    /// An encoder arm.
    Arm(arm::ArmSettings),
    /// An electromagnetic tracker.
    Tracker(tracker::polhemus::TrackerSettings),
    /// A sequence file.
    Sequence(replay::SequenceSettings),
    /// A recorded session, or one device in it.
    Session(replay::SessionSettings),
    /// A frame grabber.
    Grabber(grabber::GrabberSettings),
    /// An OpenIGTLink server.
    Remote(openigtlink::RemoteSettings),
}

impl OpenSettings {
    /// Settings for a whole sequence file with default limits.
    pub fn sequence(path: impl Into<PathBuf>) -> Self {
        Self::Sequence(replay::SequenceSettings::new(path))
    }
}
