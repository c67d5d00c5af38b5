//! What is tried with arbitrary texts: the readers of configurations, in TOML and in PLUS's XML, and of what browsers say to the console. `make fuzz` searches for texts that break them; an ordinary test
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
use sonoweave::console::{hosts, origin, stream, token};

/// Tries one kind of input.
pub(crate) type Target = fn(&[u8]);

/// All of them by name.
pub(crate) const ALL: [(&str, Target); 3] = [("settings", settings), ("bedside", bedside), ("console", console)];

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

/// What a page says, and what a request says of itself, a line each: its host, origin, site, authorization and cookie. Who is let in is what it must be.
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
