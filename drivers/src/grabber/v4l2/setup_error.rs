//! Reasons why a grabber cannot be set up.

use std::io;

use super::super::pixels::Refusal;

/// Reason why a device cannot be opened; it follows the device's name.
#[derive(Debug, thiserror::Error)]
pub(crate) enum SetupError {
    /// The kernel refused a call, with its purpose.
    #[error("cannot be set up: {doing} failed: {source}")]
    Refused { doing: &'static str, source: io::Error },
    /// The device does not offer the settings.
    #[error("cannot be set up: {0}")]
    Unfit(String),
    /// The device cannot be opened or used at all.
    #[error("{0}")]
    Unusable(String),
    /// The video cannot be converted.
    #[error(transparent)]
    Layout(#[from] Refusal),
}
