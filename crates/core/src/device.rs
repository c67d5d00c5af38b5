//! The trait of all sources of readings, and their description.

use crate::{Error, Health, Reading, reading};

/// An opened source of readings.
///
/// Life cycle: opened → `start` → `next` any number of times → `stop`. `Send`, so that the
/// pipeline may give each device a thread.
pub trait Device: Send {
    /// Begins delivery.
    ///
    /// # Errors
    /// [`Error`] when the device refuses; it stays stopped and may be started again.
    fn start(&mut self) -> Result<(), Error>;

    /// Returns the next reading, or why there is none.
    ///
    /// A device that delivers at its own pace waits until `deadline_ns` (host, CLOCK_MONOTONIC)
    /// at most. A device that delivers on demand (a file) never waits.
    ///
    /// Hardware that disconnects, falls silent or returns causes no error. The device
    /// reconnects by itself and returns [`Next::Pending`] meanwhile; [`Self::health`] gives the
    /// reason.
    ///
    /// # Errors
    /// [`Error`] when a recording's data is damaged, or the device is stopped. No reading
    /// follows an error until the device is started again.
    fn next(&mut self, deadline_ns: i64) -> Result<Next, Error>;

    /// Ends delivery. A stopped device can be started again; a file then restarts from its
    /// beginning.
    ///
    /// # Errors
    /// [`Error`] when the device does not answer; it counts as stopped all the same.
    fn stop(&mut self) -> Result<(), Error>;

    /// Marks the given axes of an arm (one bit per axis) as being in their home position now.
    /// Their counts become 0 there, or the value that the device gives for home.
    ///
    /// # Errors
    /// [`Error::NoAxes`].
    fn home(&mut self, _axes: u8) -> Result<(), Error> {
        Err(Error::NoAxes(self.describe().name.clone()))
    }

    /// Returns the memory of a virtual device's tables, and of frames that it rendered beforehand,
    /// bytes.
    fn prepared_bytes(&self) -> u64 {
        0
    }

    /// Returns the facts known before the first reading; hardware adds more after its set-up.
    fn describe(&self) -> &Description;

    /// Returns the device's state and its counts of received and lost data.
    fn health(&self) -> &Health;
}

/// Deadline for sources that never wait, such as files.
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
    /// The deadline passed. The device's health says whether the device is well.
    Pending,
    /// No more readings will follow.
    End,
}

/// A device's description of itself. Unknown values are `None`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Description {
    /// Name of the device or file.
    pub name: String,
    /// Number of items (frames or tracker samples) it will deliver.
    pub items: Option<u64>,
    /// Size of its images, pixels as stored: first axis, second axis.
    pub image_size: Option<[u32; 2]>,
    /// Pixel type and channels.
    pub pixel: Option<(reading::PixelType, u32)>,
    /// Fields that belong to the whole recording, in file order, with the file's names.
    pub fields: Vec<(String, String)>,
    /// Meaning of its stamps.
    pub timing: Timing,
}

/// Meaning of a device's stamps, and the delay between a measurement and its stamp.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Timing {
    /// Quantity that [`reading::Stamp::ticks`] counts.
    pub ticks: Ticks,
    /// Ticks per second; `None` if the ticks are no clock, or their rate is unknown.
    pub tick_hz: Option<f64>,
    /// Value at which the ticks wrap to 0: 2³² for a 32-bit counter.
    pub wraps_at: Option<u64>,
    /// Readings per second of each station, as set or as measured by the manufacturer.
    pub rate_hz: Option<f64>,
    /// Time from the middle of the measurement to the first byte on the wire, as stated by the
    /// manufacturer, ns.
    pub sampling_ns: i64,
    /// Time from the first byte on the wire to the last, ns: the record length at the line's
    /// rate.
    pub wire_ns: i64,
}

/// Quantity that a device's ticks count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Ticks {
    /// Nothing: only host times exist.
    #[default]
    None,
    /// Time of the device's own clock.
    Time,
    /// Measurements, including those that were not sent.
    Measurements,
}
