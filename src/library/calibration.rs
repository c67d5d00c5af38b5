//! A calibration, as files have it.

use std::path::Path;

use calibration::file::CalibrationFile;
use config::{Kind, MAX_BYTES, Settings, kind_of};
use sonoweave_core::keys::read_text;

use super::{Keyword, LibraryError};
use crate::cli::calibrate::keywords::by_keywords;

/// A calibration file of ours, or a PLUS configuration.
#[derive(Debug, Clone)]
pub struct LibraryCalibration {
    /// Constant transforms: names of source and target, and the matrix, row major.
    pub transforms: Vec<(String, String, [f64; 16])>,
    /// Name of the image's frame of reference.
    pub image: String,
    /// Latencies of video and tracker, ms.
    pub latency_ms: Option<[f64; 2]>,
    /// Distance between voxels, mm.
    pub spacing_mm: Option<[f64; 3]>,
    /// Origin of the numbers, for people.
    pub provenance: String,
    /// Names of the presets.
    pub presets: Vec<String>,
}

impl LibraryCalibration {
    /// Carries out a command of `calibrate`, such as `probe`, by its flags as keywords, and writes
    /// the requested files. A session may be given as the sequence. Returns the command's report,
    /// as JSON.
    ///
    /// # Errors
    /// [`LibraryError`] when a keyword does not fit, or the recording does not determine the
    /// result; nothing is written then.
    pub fn measure(quantity: &str, keywords: Vec<Keyword>) -> Result<String, LibraryError> {
        // A sentence on a file begins with it.
        let paths: Vec<String> = keywords.iter().filter_map(|(_, value)| value.clone()).collect();
        by_keywords(quantity, keywords).map_err(|failure| {
            let named = paths.iter().find(|path| failure.0.sentence.starts_with(&format!("{path}: ")));
            LibraryError::of_failure(Path::new(named.map_or("", String::as_str)), failure)
        })
    }

    /// Reads a file; `preset` chooses one of its presets.
    ///
    /// # Errors
    /// [`LibraryError`] when it cannot be read, or has no such preset.
    pub fn read(path: &Path, preset: Option<&str>) -> Result<Self, LibraryError> {
        let text = read_text(path, MAX_BYTES).map_err(|error| LibraryError::at(path, error))?;
        let settings = Settings::parse(path, &text, preset).map_err(|error| LibraryError::at(path, error))?;
        let presets = match kind_of(path, &text) {
            Ok(Kind::Plus) => Vec::new(),
            _ => CalibrationFile::parse(path, &text).map_err(|error| LibraryError::at(path, error))?.presets,
        };
        let rows = |affine| sonoweave_core::frames::Transform::<Anything, Anything>::from_affine(affine).to_rows();
        Ok(Self {
            transforms: settings.transforms.into_iter().map(|t| (t.from, t.to, rows(t.affine))).collect(),
            image: settings.image_frame.unwrap_or_else(|| "Image".into()),
            latency_ms: settings.latency.map(|latency| [latency.video_ms, latency.tracker_ms]),
            spacing_mm: settings.spacing_mm,
            provenance: settings.provenance,
            presets: presets.into_iter().map(|preset| preset.name).collect(),
        })
    }
}

/// A frame of reference whose name is text.
type Anything = sonoweave_core::frames::World;
