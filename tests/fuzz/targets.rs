//! Functions tested with arbitrary texts: the readers of configurations, in TOML and in PLUS's
//! XML, and of messages from browsers to the console. `make fuzz` searches for texts that break
//! them; an ordinary test (`tests/fuzz_corpus.rs`) repeats those in `corpus/`.
//!
//! Besides the absence of panics, the functions check that accepted files contain only finite
//! numbers, and that our own files are unchanged after writing and reading.

#![allow(dead_code, reason = "each program of the fuzzer uses one of these functions")]

use std::path::Path;

use calibration::file::CalibrationFile;
use calibration::phantom::file::PhantomFile;
use config::Settings;
use config::bedside::Bedside;
use config::phantom::PhantomSettings;
use console::{hosts, origin, stream, token};

/// A function that tests one kind of input.
pub(crate) type Target = fn(&[u8]);

/// All functions by name.
pub(crate) const ALL: [(&str, Target); 3] = [("settings", settings), ("bedside", bedside), ("console", console)];

/// Tests a calibration or a phantom, in our format or in that of PLUS.
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

/// Tests a session configuration. The files that it names do not exist.
pub(crate) fn bedside(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let _ = Bedside::parse(Path::new("/nowhere/bedside.toml"), text);
}

/// Tests a page's message, and a request's host, origin, site, authorization and cookie, one per
/// line. Also checks who is admitted.
pub(crate) fn console(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let _ = stream::understood(text);
    let mut lines = text.lines();
    let [host, whose, site, authorization, cookie] = std::array::from_fn(|_| lines.next());
    let names = ["bedside-3.local".to_owned(), "*.ward.example".into()];
    if let Some(host) = host {
        let small = host.to_ascii_lowercase();
        if hosts::is_own(host, None, &[]) {
            assert!(small.starts_with("localhost") || small.starts_with("127.") || small.starts_with('['), "{host}");
        }
        let at = Some([192, 0, 2, 1].into());
        if hosts::is_own(host, at, &names) {
            let own = ["192.0.2.1", "[::ffff:", "bedside-3.local"].iter().any(|own| small.starts_with(own));
            assert!(own || small.contains(".ward.example"), "{host}");
        }
    }
    if origin::is_own(whose, host, site, true)
        && let (Some(whose), Some(host)) = (whose, host)
    {
        assert!(whose.eq_ignore_ascii_case(&format!("https://{host}")), "{whose} is not {host}");
    }
    let _ = origin::is_json(text);
    if let Some(shown) = authorization.and_then(token::bearer) {
        assert!(!shown.is_empty() && !shown.starts_with(' '), "{shown}");
    }
    for value in cookie.into_iter().flat_map(|cookie| token::cookies(cookie, "sonoweave-9110")) {
        assert!(!value.contains(';') && cookie.is_some_and(|cookie| cookie.contains(value)), "{value}");
    }
}
