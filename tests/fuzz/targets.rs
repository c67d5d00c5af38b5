//! What is tried with arbitrary texts: the readers of configurations, in TOML and in PLUS's XML. `make fuzz` searches for texts that break them; an ordinary test
//! (`tests/fuzz_corpus.rs`) tries those in `corpus/` again.
//!
//! Besides not panicking: what is accepted holds finite numbers only, and of our own files what is written of it is read as the same.

#![allow(dead_code, reason = "each program of the fuzzer uses one of these functions")]

use std::path::Path;

use calibration::file::CalibrationFile;
use calibration::phantom::file::PhantomFile;
use sonoweave::config::Settings;
use sonoweave::config::bedside::Bedside;
use sonoweave::config::phantom::PhantomSettings;

/// Tries one kind of input.
pub(crate) type Target = fn(&[u8]);

/// All of them by name.
pub(crate) const ALL: [(&str, Target); 2] = [("settings", settings), ("bedside", bedside)];

/// A calibration or a phantom, of ours or of PLUS.
pub(crate) fn settings(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let path = Path::new("settings");
    if let Ok(settings) = Settings::parse(path, text, None) {
        assert!(settings.transforms.iter().all(|transform| transform.affine.is_finite()), "a transform is not finite");
    }
    if let Ok(phantom) = PhantomSettings::parse(path, text) {
        let ends = phantom.geometry.wires().iter().flat_map(|wire| wire.ends_mm);
        let places = ends.chain(phantom.geometry.landmarks().iter().map(|landmark| landmark.position_mm));
        assert!(places.into_iter().all(|place| place.is_finite()), "a place is not finite");
    }
    if let Ok(file) = CalibrationFile::parse(path, text) {
        assert_eq!(CalibrationFile::parse(path, &file.to_text()).ok(), Some(file));
    }
    if let Ok(file) = PhantomFile::parse(path, text) {
        assert_eq!(PhantomFile::parse(path, &file.to_text()).ok(), Some(file));
    }
}

/// A bedside. Files that it names are not there.
pub(crate) fn bedside(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let _ = Bedside::parse(Path::new("/nowhere/bedside.toml"), text);
}
