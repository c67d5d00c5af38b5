//! Types that all stages share: frames of reference, times, readings, slices and the frame ledger.
//!
//! - [`frames`]: transforms that carry the names of the frames they map between; mismatched
//!   frames do not compile. [`named`]: constant transforms between frames known by name.
//! - [`clock`]: the host's time, and a clock that tests advance by hand. [`date`]: the calendar.
//! - [`reading`]: the data that a device delivers. [`device`]: the trait of all devices, their
//!   description and timing. [`health`]: a device's state. [`pool`]: reusable pixel buffers.
//! - [`slice`](mod@slice): an image with its time and pose, as the stages pass it on.
//!   [`region`]: the rectangle and fan of the image that are data. [`rotation`]: turns with equal
//!   bits on every machine.
//! - [`refusal`], [`ledger`]: the outcome of every frame, and the reasons.
//! - [`keys`]: TOML files read key by key, for every file of ours. [`page_faults`]: how often
//!   threads wait for fresh memory.
//! - [`error`]: the error of all devices.
//!
//! The modules have no error in common, because their callers handle every case. A
//! [`frames::BadMatrix`] becomes one of the ledger's reasons; a [`keys::FileError`] becomes an
//! error at a line of a file. A merged error would make these matches incomplete.

pub mod clock;
pub mod date;
pub mod device;
pub mod error;
pub mod frames;
pub mod health;
pub mod keys;
pub mod ledger;
pub mod named;
pub mod page_faults;
pub mod pool;
pub mod reading;
pub mod refusal;
pub mod region;
pub mod rotation;
pub mod slice;

/// Purpose of the program, for help texts, pages, reports and DICOM files.
pub const NOTICE: &str = "For research. Not a medical device. Not for diagnosis or treatment.";

pub use device::{Description, Device, NO_DEADLINE, Next, Ticks, Timing};
pub use error::Error;
pub use health::Health;
pub use reading::Reading;
