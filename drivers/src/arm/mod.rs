//! Encoder arms of three joints.
//!
//! One file or folder a wire format, without transport and without clock. Counts leave as they are; kinematics live in calibration:
//!
//! - [`ea1`]: EA1, a protocol for arms built around a microcontroller; `docs/ea1.md` describes it for those who build one.
//! - [`qsb`]: US Digital QSB, an encoder each.
//! - [`microscribe`]: MicroScribe-3D and the Immersion boxes.
//!
//! Beside each format stands its unit: how such an arm is set up and read. [`homing`] follows the counters of all of them, and [`settings`] is what is asked of them.

mod driver;
pub mod ea1;
pub mod homing;
pub mod microscribe;
pub mod qsb;
pub mod settings;

pub use driver::{ArmDriver, ArmSettings, Model};
pub use settings::Settings;
