//! Devices and recordings: bytes in, readings out.
//!
//! A [`Driver`] knows one kind of device: it lists what could be opened and opens it from typed settings. A [`Device`] is started,
//! asked for its next [`Reading`], and stopped. A recording is a device like any other, so that what works on a file works at the
//! bedside. Nothing here knows of volumes, calibration or screens: readings keep the units and names of the wire, and
//! the daemon's ingest stage is the one place where they become mm, rad and host nanoseconds.
//!
//! In the order of the data:
//!
//! - [`reading`]: what a device can deliver.
//! - [`recording`]: sequence files (MetaImage) and the device that replays them.
//! - [`error`]: what can go wrong, in sentences that say what, where and what to do.

pub mod error;
pub mod reading;
pub mod recording;

use std::path::PathBuf;
use std::time::Instant;

pub use error::Error;
pub use reading::Reading;

/// Every driver that this build knows.
pub static DRIVERS: &[&dyn Driver] = &[&recording::SequenceDriver];

/// Opens what the settings name with the driver that knows it.
///
/// # Errors
/// The driver's.
pub fn open(settings: &OpenSettings) -> Result<Box<dyn Device>, Error> {
    match settings {
        OpenSettings::Sequence(_) => recording::SequenceDriver.open(settings),
    }
}

/// One kind of device: lists what it could open and opens it.
pub trait Driver: Sync {
    /// Short, stable name, as used in configuration files and logs.
    fn name(&self) -> &'static str;

    /// What this driver sees now, including devices that cannot be opened and the reason. A driver of files lists nothing: files are
    /// opened by path.
    fn list(&self) -> Vec<Listing>;

    /// Opens a device without starting it.
    ///
    /// # Errors
    /// [`Error`] when the settings are not for this driver, or the device or file cannot be opened or is not what it should be.
    fn open(&self, settings: &OpenSettings) -> Result<Box<dyn Device>, Error>;
}

/// A device found by [`Driver::list`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Listing {
    /// What to call it in settings.
    pub id: String,
    /// A sentence for people.
    pub description: String,
    /// Why it cannot be opened, if it cannot.
    pub unavailable: Option<String>,
}

/// What to open. One variant per driver.
#[derive(Debug, Clone)]
pub enum OpenSettings {
    /// A sequence file.
    Sequence(recording::SequenceSettings),
}

impl OpenSettings {
    /// A whole sequence file with default limits.
    pub fn sequence(path: impl Into<PathBuf>) -> Self {
        Self::Sequence(recording::SequenceSettings::new(path))
    }
}

/// An opened source of readings.
///
/// Life: opened → `start` → `next` any number of times → `stop`. `Send`, so that the pipeline may give each device a thread.
pub trait Device: Send {
    /// Begins delivery.
    ///
    /// # Errors
    /// [`Error`] when the device refuses; it stays stopped and may be started again.
    fn start(&mut self) -> Result<(), Error>;

    /// The next reading, or why there is none.
    ///
    /// A device that delivers at its own pace waits until `deadline` at most; one that delivers on demand (a file) never waits.
    ///
    /// # Errors
    /// [`Error`] when the data is damaged or the device is gone. No reading follows an error until the device is started again.
    fn next(&mut self, deadline: Instant) -> Result<Next, Error>;

    /// Ends delivery. A stopped device can be started again; a file then begins anew.
    ///
    /// # Errors
    /// [`Error`] when the device does not answer; it counts as stopped all the same.
    fn stop(&mut self) -> Result<(), Error>;

    /// What is known of the source before its first reading.
    fn describe(&self) -> &Description;
}

/// Outcome of [`Device::next`].
#[derive(Debug)]
#[allow(
    clippy::large_enum_variant,
    reason = "almost every value is a reading, moved once; a box would allocate per reading"
)]
pub enum Next {
    /// A reading.
    Reading(Reading),
    /// The deadline passed; the device is well as far as is known.
    Pending,
    /// There will be no more readings.
    End,
}

/// What a device says of itself. Unknown figures are `None`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Description {
    /// The device or file by name.
    pub name: String,
    /// Number of items (frames or tracker samples) it will deliver.
    pub items: Option<u64>,
    /// Size of its images, pixels as stored: first axis, second axis.
    pub image_size: Option<[u32; 2]>,
    /// Pixel type and channels.
    pub pixel: Option<(reading::PixelType, u32)>,
    /// Fields that belong to the whole recording, in file order, names as in the file.
    pub fields: Vec<(String, String)>,
}
