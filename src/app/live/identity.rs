//! Identity of a session for programs that watch many: hashes, which name neither people nor
//! folders.

use std::time::{SystemTime, UNIX_EPOCH};

use config::bedside::Bedside;
use console::Identity;

use crate::app::sha256;

/// Returns the hash that identifies a session: of the name of its recording, or one of its own.
pub(super) fn of_session(recording: Option<&str>) -> String {
    let own = || {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos());
        format!("{} {now}", std::process::id())
    };
    hash(&recording.map_or_else(own, str::to_owned))
}

/// Returns the identity of a session with this hash, by the files that it began with.
pub(super) fn identity(bedside: &Bedside, session: &str) -> Identity {
    let of = |path| bedside.texts.get(path).map(|text| hash(text)).unwrap_or_default();
    Identity {
        session: session.to_owned(),
        configuration: of(&bedside.path),
        calibration: bedside.calibration.path.as_ref().map(of).unwrap_or_default(),
    }
}

/// Returns the beginning of a text's hash.
fn hash(text: &str) -> String {
    sha256::short(&sha256::of(text)).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_those_of_files_and_recording() {
        let folder = tempfile::tempdir().unwrap();
        let [configuration, calibration] = ["b.toml", "doe-jane.toml"].map(|name| folder.path().join(name));
        let examples = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/examples");
        std::fs::copy(format!("{examples}/probe.toml"), &calibration).unwrap();
        let text = include_str!("../../../docs/examples/fastrak.toml").replace("\"probe.toml\"", "\"doe-jane.toml\"");
        std::fs::write(&configuration, &text).unwrap();
        let bedside = Bedside::read(&configuration).unwrap();
        let session = of_session(Some("SESSION-20261121-213000.mcap"));
        let identity = identity(&bedside, &session);
        let of_file = |path: &std::path::Path| hash(&std::fs::read_to_string(path).unwrap());
        assert_eq!(identity.configuration, of_file(&configuration));
        assert_eq!(identity.calibration, of_file(&calibration));
        assert_eq!(identity.session, "3ceb97df0b04");
        assert_ne!(of_session(None), of_session(None), "sessions without a recording differ, too");
        // The virtual bedside's calibration is in no file.
        let own = Bedside::parse(&configuration, include_str!("../../../docs/examples/virtual.toml")).unwrap();
        assert_eq!(super::identity(&own, &session).calibration, "");
    }
}
