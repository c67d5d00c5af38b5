//! The error of all devices.

use std::error::Error as StdError;

/// Error of a [`Device`](crate::Device).
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The device was started twice.
    #[error("{0} is running already; stop it first")]
    Running(String),
    /// The device was read before its start.
    #[error("{0} is stopped; start it first")]
    Stopped(String),
    /// The device was read after an error.
    #[error("{0} has failed; start it again to read from the beginning")]
    Failed(String),
    /// The device has no axes.
    #[error("{0} has no axes to home; choose an arm with index marks")]
    NoAxes(String),
    /// An error of the device's own crate: its settings, or a recording's file. This crate knows
    /// neither drivers nor files; [`Self::cause`] returns the error with its type.
    #[error("{0}")]
    Other(#[source] Box<dyn StdError + Send + Sync>),
}

impl Error {
    /// Wraps an error of another crate.
    pub fn other(error: impl Into<Box<dyn StdError + Send + Sync>>) -> Self {
        Self::Other(error.into())
    }

    /// Returns the wrapped error, if it has this type.
    pub fn cause<E: StdError + 'static>(&self) -> Option<&E> {
        if let Self::Other(error) = self { error.downcast_ref() } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_name_device_and_remedy() {
        let device = || "/dev/ttyUSB0".to_owned();
        for (error, text) in [
            (Error::Running(device()), "/dev/ttyUSB0 is running already; stop it first"),
            (Error::Stopped(device()), "/dev/ttyUSB0 is stopped; start it first"),
            (Error::Failed(device()), "/dev/ttyUSB0 has failed; start it again to read from the beginning"),
            (Error::NoAxes(device()), "/dev/ttyUSB0 has no axes to home; choose an arm with index marks"),
        ] {
            assert_eq!(error.to_string(), text);
            assert!(error.cause::<std::fmt::Error>().is_none());
        }
        let wrapped = Error::other(std::fmt::Error);
        assert_eq!((wrapped.to_string(), wrapped.cause()), (std::fmt::Error.to_string(), Some(&std::fmt::Error)));
    }
}
