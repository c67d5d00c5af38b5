//! Errors of opening a device or a recording.

use std::path::PathBuf;

use crate::tracker::polhemus::ListError;

/// Error of opening a device or a recording.
///
/// A device that is absent is no error: the open device's health gives the reason, which is a
/// [`LineError`](crate::transport::LineError) for lines. Malformed data of hardware are counted
/// and skipped; only OpenIGTLink's decoder reports them singly
/// ([`Refused`](crate::openigtlink::Refused)), because servers answer them.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A setting has a value that the device does not support.
    #[error("{device}.{setting}: {problem}")]
    Setting {
        /// Kind of device: `arm`, `tracker`, `grabber` or `remote`.
        device: &'static str,
        /// Name of the setting.
        setting: &'static str,
        /// The problem, and valid values.
        problem: String,
    },
    /// A tracker cannot send this list of output items.
    #[error("tracker: {0}")]
    OutputList(#[from] ListError),
    /// The recording's file.
    #[error("{0}")]
    File(#[from] formats::Error),
    /// The session does not have the requested device.
    #[error("{path}: has no device {requested:?}; give one of its own: {known}", path = .path.display(), known = names(.known))]
    NoDevice {
        /// The session.
        path: PathBuf,
        /// The requested device.
        requested: String,
        /// The session's devices.
        known: Vec<String>,
    },
    /// This version cannot decode the recorded bytes of a device.
    #[error(
        "the session's {protocol} has {setting} {value:?}, which this version does not know; replay the recorded readings instead of decoding the bytes again"
    )]
    Recorded {
        /// The device's protocol.
        protocol: String,
        /// Name of the unknown setting, or `protocol`.
        setting: String,
        /// Its value.
        value: String,
    },
}

fn names(known: &[String]) -> String {
    if known.is_empty() { "none".into() } else { known.join(", ") }
}

impl Error {
    pub(crate) fn setting(device: &'static str, setting: &'static str, problem: impl ToString) -> Self {
        Self::Setting { device, setting, problem: problem.to_string() }
    }
}

/// A replay that opens decoders while it runs passes these errors on.
impl From<Error> for sonoweave_core::Error {
    fn from(error: Error) -> Self {
        match error {
            Error::File(error) => error.into(),
            error => Self::other(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_name_place_and_remedy() {
        let no_device = |known: &[String]| Error::NoDevice {
            path: "s.mcap".into(),
            requested: "arm".into(),
            known: known.to_vec(),
        };
        let recorded = Error::Recorded { protocol: "ea1".into(), setting: "speech".into(), value: "drums".into() };
        for (error, text) in [
            (Error::setting("arm", "baud", "too slow"), "arm.baud: too slow"),
            (
                ListError::PackedText(18).into(),
                "tracker: output item 18 packs numbers into 14 bits, which exists in binary only; request it in binary",
            ),
            (no_device(&[]), "s.mcap: has no device \"arm\"; give one of its own: none"),
            (
                no_device(&["tracker".into(), "grabber".into()]),
                "s.mcap: has no device \"arm\"; give one of its own: tracker, grabber",
            ),
            (
                recorded,
                "the session's ea1 has speech \"drums\", which this version does not know; replay the recorded readings instead of decoding the bytes again",
            ),
        ] {
            assert_eq!(error.to_string(), text);
        }
    }

    #[test]
    fn file_error_keeps_its_type_in_device_error() {
        let file = formats::Error::Session { path: "s.mcap".into(), problem: "is odd".into() };
        let error = sonoweave_core::Error::from(Error::from(file));
        assert!(matches!(error.cause(), Some(formats::Error::Session { .. })), "{error:?}");
        let error = sonoweave_core::Error::from(Error::setting("arm", "baud", "too slow"));
        assert!(matches!(error.cause(), Some(Error::Setting { device: "arm", .. })), "{error:?}");
    }
}
