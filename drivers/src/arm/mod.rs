//! Encoder arms of three joints.
//!
//! One file or folder per wire format, independent of transport and clock. The drivers deliver
//! raw counts; calibration computes the kinematics:
//!
//! - [`ea1`]: EA1, a protocol for arms built around a microcontroller; `docs/ea1.md` describes it
//!   for arm builders.
//! - [`qsb`]: US Digital QSB, one per encoder.
//! - [`microscribe`]: MicroScribe-3D and the Immersion boxes.
//!
//! Each format has a unit that sets up and reads such an arm. [`homing`] follows the counters of
//! all kinds, and [`settings`] holds their common settings.

mod driver;
pub mod ea1;
pub mod homing;
pub mod microscribe;
mod model;
pub mod qsb;
pub mod settings;

pub use driver::open;
pub(crate) use driver::open_on;
pub use model::{ArmSettings, Model};
pub use settings::Settings;
