//! Configuration files, read as validated settings.
//!
//! A `--config` file is one of three kinds, which its content determines: our own calibration
//! TOML ([`calibration::file`]), our own session configuration ([`bedside`]), or a PLUS XML
//! ([`plus`]).
//!
//! - [`bedside`]: the session configuration: devices, and the use of their data.
//! - [`plus`]: PLUS configuration and calibration result files.
//! - [`phantom`]: phantoms for probe calibration.
//! - [`values`], [`view_settings`], [`weighing`]: settings shared by flags and files, read and
//!   checked in one place.

pub mod bedside;
mod error;
mod kind;
pub mod phantom;
pub mod plus;
mod settings;
pub mod texts;
pub mod values;
pub mod view_settings;
pub mod weighing;
mod xml_limits;

pub use error::Error;
pub use kind::{Kind, MAX_BYTES, kind_of};
pub use settings::{Settings, SourceKind};

#[cfg(test)]
mod tests;
