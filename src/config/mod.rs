//! The file as written → validated settings.
//!
//! A `--config` file is our own TOML, of a calibration ([`calibration::file`]) or of a bedside ([`bedside`]), or a PLUS XML ([`plus`]); its content tells which.
//!
//! - [`bedside`]: devices and what becomes of what they deliver.
//! - [`plus`]: PLUS configuration and calibration result files.
//! - [`phantom`]: what is scanned to calibrate a probe.
//! - [`values`], [`look`], [`weighing`]: what flags and files can both say, read and checked once.

pub mod bedside;
pub mod look;
pub mod phantom;
pub mod plus;
pub mod texts;
pub mod values;
pub mod weighing;
mod xml_limits;

use std::path::{Path, PathBuf};

use calibration::arm::Arm;
use calibration::file::preset::Preset;
use calibration::file::{CalibrationFile, FileError, Latency, NoPreset};
use calibration::keys::Source;
use calibration::named::StaticTransform;
use calibration::region::{ClipRect, Fan};
use calibration::tracker::zones::Zones;
use serde::Serialize;

use crate::mask::{Clip, MaskSettings};

/// Larger files are refused unread, bytes. PLUS's calibration results hold every frame's points: about 1 MB.
pub const MAX_BYTES: u64 = 16 << 20;

/// What kind of file settings came from.
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

/// What a configuration says about the input. Everything is optional; the command line overrides it.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Settings {
    /// What kind of file it was.
    pub source: SourceKind,
    /// The file.
    pub path: Option<PathBuf>,
    /// Constant transforms; `Image` to `Probe` is the probe's calibration.
    pub transforms: Vec<StaticTransform>,
    /// Name of the picture's frame, if not `Image`.
    pub image_frame: Option<String>,
    /// Name of the frame where the volume shall live.
    pub world: Option<String>,
    /// The rectangle of the picture that is data.
    pub clip: Option<ClipRect>,
    /// The sector of the picture that is data.
    pub fan: Option<Fan>,
    /// Distance between voxels along x, y, z, mm.
    pub spacing_mm: Option<[f64; 3]>,
    /// Half width at half maximum along u, v and the plane's normal, mm.
    pub hwhm_mm: Option<[f64; 3]>,
    /// What the devices' times lie behind their measurements.
    pub latency: Option<Latency>,
    /// The arm that carries the probe; whoever writes settings out has its own words for it.
    #[serde(skip)]
    pub arm: Option<Arm>,
    /// What that arm's fit left of its touches, mm, root mean square.
    #[serde(skip)]
    pub arm_fit_rms_mm: Option<f64>,
    /// Where metal bends the tracker's field; whoever writes settings out has its own words for it.
    #[serde(skip)]
    pub distortion: Option<Zones>,
    /// The preset that was chosen, where the file has such; whoever writes settings out names it.
    #[serde(skip)]
    pub preset: Option<Preset>,
    /// What the user should know: sentences.
    pub notes: Vec<String>,
}

impl Settings {
    /// Reads a file of either kind, and of its presets the one of that name, or the only one.
    ///
    /// # Errors
    /// [`ConfigError`] naming file, line and key or element.
    pub fn read(path: &Path, preset: Option<&str>) -> Result<Self, ConfigError> {
        Self::parse(path, &calibration::file::read_text(path, MAX_BYTES)?, preset)
    }

    /// Reads a file's text; `path` is for sentences only.
    ///
    /// # Errors
    /// [`ConfigError`] naming file, line and key or element.
    pub fn parse(path: &Path, text: &str, preset: Option<&str>) -> Result<Self, ConfigError> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        match kind_of(path, text)? {
            Kind::Plus => match preset {
                None => return plus::parse(path, text),
                Some(name) => {
                    let none = NoPreset::Unknown { name: name.to_owned(), known: Vec::new() };
                    return Err(ConfigError::Preset { path: path.to_owned(), problem: none });
                }
            },
            // Of another it is said what stands in it and should.
            Kind::Calibration | Kind::Other => {}
            Kind::Bedside => {
                return Err(ConfigError::Misplaced {
                    path: path.to_owned(),
                    what: "a bedside's configuration, for `live`",
                    wanted: "a calibration is wanted here: give the file that its [calibration] names; `sonoweave live --check --config` looks into this one".into(),
                });
            }
        }
        let mut file = CalibrationFile::parse(path, text)?;
        let no_preset = |problem| ConfigError::Preset { path: path.to_owned(), problem };
        let preset = file.choose(preset).map_err(no_preset)?;
        Ok(Self { path: Some(path.to_owned()), preset, ..Self::of_file(&file) })
    }

    /// What a calibration file of ours says.
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

    /// Puts a probe calibration given on the command line (16 numbers, row major, pixels → mm) in the place of the file's.
    ///
    /// # Errors
    /// A sentence without a beginning, for the caller to head with the option's name: not 16 numbers, or no invertible affine matrix.
    pub fn set_image_to_probe(&mut self, text: &str) -> Result<(), String> {
        let rows = numbers::<16>(text)?;
        let image = self.image_frame.as_deref().unwrap_or("Image");
        let given = StaticTransform::new(image, "Probe", &rows).map_err(|e| e.to_string())?;
        self.transforms.retain(|other| !other.relates_same_frames(&given));
        self.transforms.push(given);
        Ok(())
    }

    /// What of the picture is data, as far as the file says.
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

/// What a configuration is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Our own calibration file.
    Calibration,
    /// A bedside's configuration.
    Bedside,
    /// A PLUS configuration or calibration result.
    Plus,
    /// TOML that does not say what it is, or of something else.
    Other,
}

/// Tells what a text is by its content.
///
/// # Errors
/// [`ConfigError`] when it is neither XML nor TOML.
pub fn kind_of(path: &Path, text: &str) -> Result<Kind, ConfigError> {
    // TOML cannot begin with '<', XML can begin with nothing else.
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

/// N finite numbers separated by white space, commas or both.
///
/// # Errors
/// A sentence without a beginning: another count, or a word that is no finite number.
pub fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let words = || text.split(|c: char| c.is_whitespace() || c == ',').filter(|word| !word.is_empty());
    let mut numbers = [0.0; N];
    let mut count = 0;
    for word in words() {
        let number = word.parse::<f64>().map_err(|_| format!("\"{}\" is not a number", shortened(word)))?;
        if !number.is_finite() {
            return Err(format!("number {} is {word}, which is not finite", count + 1));
        }
        if let Some(slot) = numbers.get_mut(count) {
            *slot = number;
        }
        count += 1;
    }
    if count == N {
        Ok(numbers)
    } else {
        let (plural, count) = (if N == 1 { "" } else { "s" }, count);
        Err(format!("must hold {N} number{plural}, not {count}"))
    }
}

fn shortened(word: &str) -> String {
    let mut short: String = word.chars().take(40).collect();
    if short.len() < word.len() {
        short.push('…');
    }
    short
}

/// Why settings that are each readable cannot be used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Unfit {
    /// Which: the name of its flag without dashes, several of them separated by `, `; empty where the sentence says it.
    pub setting: &'static str,
    /// What is wrong and what it may be; goes on after the name.
    pub problem: String,
}

impl Unfit {
    /// Of one setting.
    pub(crate) fn new(setting: &'static str, problem: impl Into<String>) -> Self {
        Self { setting, problem: problem.into() }
    }

    /// A sentence that names what it is about.
    pub(crate) fn whole(problem: String) -> Self {
        Self { setting: "", problem }
    }
}

/// Why a configuration is refused. The display is a sentence that says what, where and what to do.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// Our own file, or reading either kind.
    #[error(transparent)]
    File(#[from] FileError),
    /// The text is not XML, or beyond the limits on it.
    #[error("{path}: line {line}: not readable as XML: {problem}", path = path.display())]
    Xml {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u32,
        /// What is wrong.
        problem: String,
    },
    /// An attribute is missing or holds what it should not.
    #[error("{path}: {element} {attribute} (line {line}): {problem}", path = path.display())]
    Attribute {
        /// The file.
        path: PathBuf,
        /// Line, from 1; of the element where the attribute is missing.
        line: u32,
        /// The element's name.
        element: String,
        /// The attribute's name.
        attribute: String,
        /// What is wrong.
        problem: String,
    },
    /// Which of several presets, or one that is not there.
    #[error("{path}: {problem}", path = path.display())]
    Preset {
        /// The file.
        path: PathBuf,
        /// What to choose.
        problem: NoPreset,
    },
    /// A file of one kind in the place of another.
    #[error("{path}: is {what}; {wanted}", path = path.display())]
    Misplaced {
        /// The file.
        path: PathBuf,
        /// What it is.
        what: &'static str,
        /// What should be there, and what to do.
        wanted: String,
    },
    /// A device set of which no session can be made.
    #[error("{path}: {problem}", path = path.display())]
    DeviceSet {
        /// The file.
        path: PathBuf,
        /// What is lacking, and what to do.
        problem: String,
    },
    /// XML, but of something else.
    #[error(
        "{path}: holds no CoordinateDefinitions, CalibrationResults or VolumeReconstruction element; a PLUS configuration or \
         calibration result, or a sonoweave calibration file, is expected",
        path = path.display()
    )]
    NothingInside {
        /// The file.
        path: PathBuf,
    },
}

#[cfg(test)]
mod tests;
