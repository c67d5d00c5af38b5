//! Polhemus electromagnetic trackers.
//!
//! One file or folder a wire format, without transport and without clock:
//!
//! - [`fastrak`]: FASTRAK, and the text of ISOTRAK and ISOTRAK II.
//! - [`isotrak`]: the binary records of 3SPACE, ISOTRAK and ISOTRAK II.
//! - [`liberty`]: LIBERTY, PATRIOT and Latus, over serial and USB alike.
//! - [`viper`]: VIPER, over USB and RS-422 alike.
//! - [`ladder`]: what is common to setting any of them up, and [`Line`], what they are connected by.

mod driver;
pub mod fastrak;
pub mod isotrak;
pub mod ladder;
pub mod liberty;
mod settings;
pub mod viper;

pub use driver::{Model, Port, TrackerDriver, TrackerSettings, VENDOR};
pub use ladder::Line;
pub use settings::Settings;
