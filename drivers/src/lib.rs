//! Devices and recordings: bytes in, readings out.
//!
//! A [`Driver`] knows one kind of device: it lists what could be opened and opens it from typed settings. A [`Device`] is started,
//! asked for its next [`Reading`], and stopped. A recording is a device like any other, so that what works on a file works at the
//! bedside. Nothing here knows of volumes, calibration or screens: readings keep the units and names of the wire, and
//! the daemon's ingest stage is the one place where they become mm, rad and host nanoseconds.
//!
//! In the order of the data:
//!
//! - [`transport`]: bytes to and from a device.
//! - [`framing`]: from a stream of bytes, cut anywhere, to records; what every wire format is made for.
//! - [`connection`]: a device on a line, opened, set up and read, and again when it went away; [`health`] says how it is.
//! - [`polhemus`]: electromagnetic trackers.
//! - [`arm`]: encoder arms of three joints.
//! - [`reading`]: what a device can deliver.
//! - [`clock`]: the host's time, and one that tests turn by hand.
//! - [`simulated`]: virtual twins of all of them.
//! - [`recording`]: image files (MetaImage, NRRD, NIfTI), sessions (MCAP) and the devices that replay them.
//! - [`openigtlink`]: what other programs send over a network.
//! - [`grabber`]: frame grabbers over V4L2, and their video to pictures.
//! - [`error`]: what can go wrong, in sentences that say what, where and what to do.

pub mod arm;
pub mod clock;
pub mod connection;
pub mod error;
pub mod framing;
pub mod grabber;
pub mod health;
mod numerals;
pub mod openigtlink;
pub mod polhemus;
mod pool;
pub mod reading;
pub mod recording;
pub mod simulated;
pub mod transport;

use std::path::PathBuf;

pub use error::Error;
pub use health::Health;
pub use reading::Reading;

/// Every driver that this build knows.
pub static DRIVERS: &[&dyn Driver] = &[
    &arm::ArmDriver,
    &polhemus::TrackerDriver,
    &grabber::GrabberDriver,
    &openigtlink::RemoteDriver,
    &recording::SequenceDriver,
    &recording::SessionDriver,
];

/// Opens what the settings name with the driver that knows it.
///
/// # Errors
/// The driver's.
pub fn open(settings: &OpenSettings) -> Result<Box<dyn Device>, Error> {
    match settings {
        OpenSettings::Arm(_) => arm::ArmDriver.open(settings),
        OpenSettings::Tracker(_) => polhemus::TrackerDriver.open(settings),
        OpenSettings::Sequence(_) => recording::SequenceDriver.open(settings),
        OpenSettings::Session(_) => recording::SessionDriver.open(settings),
        OpenSettings::Grabber(_) => grabber::GrabberDriver.open(settings),
        OpenSettings::Remote(_) => openigtlink::RemoteDriver.open(settings),
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
    /// An encoder arm.
    Arm(arm::ArmSettings),
    /// An electromagnetic tracker.
    Tracker(polhemus::TrackerSettings),
    /// A sequence file.
    Sequence(recording::SequenceSettings),
    /// A recorded session, or a device of it.
    Session(recording::SessionSettings),
    /// A frame grabber.
    Grabber(grabber::GrabberSettings),
    /// An OpenIGTLink server.
    Remote(openigtlink::RemoteSettings),
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
    /// A device that delivers at its own pace waits until `deadline_ns` (host, CLOCK_MONOTONIC) at most; one that delivers on demand (a file) never waits.
    ///
    /// Hardware that goes away, falls silent or comes back is no error: the device tries by itself to have it working again, says [`Next::Pending`] meanwhile, and
    /// its [`Self::health`] tells what is the matter.
    ///
    /// # Errors
    /// [`Error`] when a recording's data is damaged, or the device is stopped. No reading follows an error until the device is started again.
    fn next(&mut self, deadline_ns: i64) -> Result<Next, Error>;

    /// Ends delivery. A stopped device can be started again; a file then begins anew.
    ///
    /// # Errors
    /// [`Error`] when the device does not answer; it counts as stopped all the same.
    fn stop(&mut self) -> Result<(), Error>;

    /// The axes of an arm (bit by axis) are in their home position now: their counts are 0 there, or what the device says of home.
    ///
    /// # Errors
    /// [`Error::Misuse`] when the device has no axes.
    fn home(&mut self, _axes: u8) -> Result<(), Error> {
        Err(Error::Misuse(format!("{}: has no axes to home", self.describe().name)))
    }

    /// What is known of the source before its first reading; hardware says more once it was set up.
    fn describe(&self) -> &Description;

    /// How it is, and what was received and lost.
    fn health(&self) -> &Health;
}

/// A deadline for sources that never wait, such as files.
pub const NO_DEADLINE: i64 = i64::MAX;

/// Outcome of [`Device::next`].
#[derive(Debug)]
#[allow(
    clippy::large_enum_variant,
    reason = "almost every value is a reading, moved once; a box would allocate per reading"
)]
pub enum Next {
    /// A reading.
    Reading(Reading),
    /// The deadline passed. Whether the device is well is told by its health.
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
    /// What its stamps mean.
    pub timing: Timing,
}

/// What a device's stamps mean, and what lies between the measurement and them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Timing {
    /// What [`reading::Stamp::ticks`] counts.
    pub ticks: Ticks,
    /// Ticks a second; `None` where they are no clock, or the rate is not known.
    pub tick_hz: Option<f64>,
    /// Where the ticks begin again at 0: 2³² for a counter of 32 bits.
    pub wraps_at: Option<u64>,
    /// Readings a second of each station, as set or as measured by the maker.
    pub rate_hz: Option<f64>,
    /// From the middle of the measurement to the first byte on the wire, by the maker's word, ns.
    pub sampling_ns: i64,
    /// From the first byte on the wire to the last, ns: what the line's rate makes of a record's length.
    pub wire_ns: i64,
}

/// What a device counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Ticks {
    /// Nothing: host times are all there is.
    #[default]
    None,
    /// Time, of a clock of its own.
    Time,
    /// Measurements, those that were not sent included.
    Measurements,
}
