//! The file as written → validated settings.
//!
//! A `--config` file is one of three kinds, which its content determines: our own calibration
//! TOML ([`calibration::file`]), our own session configuration ([`bedside`]), or a PLUS XML
//! ([`plus`]).
//!
//! - [`bedside`]: the session configuration: devices, and the use of their data.
//! - [`plus`]: PLUS configuration and calibration result files.
//! - [`phantom`]: phantoms for probe calibration.
//! - [`values`], [`look`], [`weighing`]: settings shared by flags and files, read and checked in
//!   one place.

pub mod bedside;
mod error;
pub mod look;
pub mod phantom;
pub mod plus;
pub mod texts;
pub mod values;
pub mod weighing;
mod xml_limits;

pub use error::Error;

use std::path::{Path, PathBuf};

use serde::Serialize;

use calibration::arm::Arm;
use calibration::error::PresetError;
use calibration::file::preset::Preset;
use calibration::file::{CalibrationFile, Latency};
use calibration::tracker::zones::Zones;
use mask::{Clip, MaskSettings};
use sonoweave_core::keys::{Source, numbers};
use sonoweave_core::named::StaticTransform;
use sonoweave_core::region::{ClipRect, Fan};
use sync::PairingOptions;

/// Size above which files are refused unread, bytes. PLUS's calibration results hold every
/// frame's points: about 1 MB.
pub const MAX_BYTES: u64 = 16 << 20;

/// Kind of the file that settings came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SourceKind {
    /// No file: defaults.
    #[default]
    Defaults,
    /// Our own calibration file.
    Sonoweave,
    /// A PLUS configuration or calibration result.
    Plus,
}

/// Input settings from a configuration. All are optional; the command line overrides them.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Settings {
    /// Kind of the file.
    pub source: SourceKind,
    /// The file.
    pub path: Option<PathBuf>,
    /// Constant transforms; `Image` to `Probe` is the probe's calibration.
    pub transforms: Vec<StaticTransform>,
    /// Name of the image's frame, if not `Image`.
    pub image_frame: Option<String>,
    /// Name of the volume's frame.
    pub world: Option<String>,
    /// The rectangle of the image that is data.
    pub clip: Option<ClipRect>,
    /// The sector of the image that is data.
    pub fan: Option<Fan>,
    /// Distance between voxels along x, y, z, mm.
    pub spacing_mm: Option<[f64; 3]>,
    /// Half width at half maximum along u, v and the plane's normal, mm.
    pub hwhm_mm: Option<[f64; 3]>,
    /// Latencies of the devices' times behind their measurements.
    pub latency: Option<Latency>,
    /// The arm that carries the probe. It is not serialised: other reports have their own form.
    #[serde(skip)]
    pub arm: Option<Arm>,
    /// Residual of that arm's fit at its touches, mm, root mean square.
    #[serde(skip)]
    pub arm_fit_rms_mm: Option<f64>,
    /// Zones where metal distorts the tracker's field. They are not serialised: other reports
    /// have their own form.
    #[serde(skip)]
    pub distortion: Option<Zones>,
    /// The chosen preset, if the file has presets. It is not serialised: other reports name it.
    #[serde(skip)]
    pub preset: Option<Preset>,
    /// Sentences for the user.
    pub notes: Vec<String>,
}

impl Settings {
    /// Returns the pairing options; `world`, from the command line, has precedence.
    pub fn pairing_options(&self, world: Option<&str>) -> PairingOptions {
        PairingOptions {
            image: self.image_frame.clone().unwrap_or_else(|| "Image".into()),
            world: world.or(self.world.as_deref()).map(str::to_owned),
            statics: self.transforms.clone(),
        }
    }

    /// Reads a file of either kind, and its preset of that name, or the only one.
    ///
    /// # Errors
    /// [`Error`] naming file, line and key or element.
    pub fn read(path: &Path, preset: Option<&str>) -> Result<Self, Error> {
        Self::parse(path, &sonoweave_core::keys::read_text(path, MAX_BYTES)?, preset)
    }

    /// Reads a file's text; `path` is for messages only.
    ///
    /// # Errors
    /// [`Error`] naming file, line and key or element.
    pub fn parse(path: &Path, text: &str, preset: Option<&str>) -> Result<Self, Error> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        match kind_of(path, text)? {
            Kind::Plus => match preset {
                None => return plus::parse(path, text),
                Some(name) => {
                    let none = PresetError::Unknown { name: name.to_owned(), known: Vec::new() };
                    return Err(Error::Preset { path: path.to_owned(), problem: none });
                }
            },
            // For another kind, the parser's error names the found and the expected format.
            Kind::Calibration | Kind::Other => {}
            Kind::Bedside => {
                return Err(Error::Misplaced {
                    path: path.to_owned(),
                    what: "a session configuration, for `live`",
                    wanted: "a calibration is wanted here: give the file named in its section [calibration]".into(),
                });
            }
        }
        let mut file = CalibrationFile::parse(path, text)?;
        let no_preset = |problem| Error::Preset { path: path.to_owned(), problem };
        let preset = file.choose(preset).map_err(no_preset)?;
        Ok(Self { path: Some(path.to_owned()), preset, ..Self::of_file(&file) })
    }

    /// Returns the settings of our calibration file.
    pub fn of_file(file: &CalibrationFile) -> Self {
        Self {
            source: SourceKind::Sonoweave,
            transforms: file.named_transforms(),
            clip: file.clip,
            fan: file.fan,
            spacing_mm: file.spacing_mm,
            hwhm_mm: file.hwhm_mm,
            latency: file.latency,
            arm: file.arm,
            arm_fit_rms_mm: file.arm_fit_rms_mm,
            distortion: file.distortion.clone(),
            ..Self::default()
        }
    }

    /// Replaces the file's probe calibration by one from the command line (16 numbers, row
    /// major, pixels → mm).
    ///
    /// # Errors
    /// [`Error::Value`]: not 16 numbers, or no invertible affine matrix.
    pub fn set_image_to_probe(&mut self, text: &str) -> Result<(), Error> {
        let rows = numbers::<16>(text)?;
        let image = self.image_frame.as_deref().unwrap_or("Image");
        let given = StaticTransform::new(image, "Probe", &rows).map_err(|e| Error::Value(e.to_string()))?;
        self.transforms.retain(|other| !other.relates_same_frames(&given));
        self.transforms.push(given);
        Ok(())
    }

    /// Returns the image mask, as far as the file defines it.
    pub fn mask(&self) -> MaskSettings {
        let clip = match (self.clip, self.source) {
            (None, _) => Clip::Auto,
            (Some(rect), SourceKind::Plus) => Clip::RectOrAuto(rect),
            (Some(rect), _) => Clip::Rect(rect),
        };
        let picture_px = self.preset.as_ref().and_then(|preset| preset.picture_px);
        MaskSettings { clip, fan: self.fan, picture_px }
    }
}

/// Kind of a configuration file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Our own calibration file.
    Calibration,
    /// A session configuration.
    Bedside,
    /// A PLUS configuration or calibration result.
    Plus,
    /// Other TOML, or TOML without a format.
    Other,
}

/// Determines a text's kind by its content.
///
/// # Errors
/// [`Error`] when it is neither XML nor TOML.
pub fn kind_of(path: &Path, text: &str) -> Result<Kind, Error> {
    // TOML cannot begin with '<', and XML always does.
    if text.trim_start().starts_with('<') {
        return Ok(Kind::Plus);
    }
    let parsed = Source { path, text }.parse()?;
    let format = parsed.get_ref().get("format").and_then(|value| value.get_ref().as_str());
    Ok(match format {
        Some(bedside::FORMAT) => Kind::Bedside,
        Some(calibration::file::FORMAT) => Kind::Calibration,
        _ => Kind::Other,
    })
}

#[cfg(test)]
mod tests;
