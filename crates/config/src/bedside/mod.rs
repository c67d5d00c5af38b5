//! The session configuration: devices, their calibration, and the use of their data.
//!
//! The file is TOML with `format = "sonoweave-bedside"` and `version = 1`; its sections and keys
//! are those of [`schema`], with commented examples in `docs/examples`. A PLUS device set with
//! supported devices is accepted, too ([`Bedside::read`] takes both).
//!
//! - [`schema`]: every section and key, its values, and when a change of it takes effect.
//! - [`devices`], [`volume`], [`session`], [`virtual_bedside`]: the sections as typed settings.
//! - [`change`]: changes between configurations, and the subset that a running session adopts.
//! - `recorded`: a recorded session's configuration, with the defaults of its version.
//! - [`settings_override`]: a recorded session's configuration with settings overrides.
//! - [`plus`]: the devices of a PLUS device set.
//!
//! Reading opens no device and changes nothing. Errors name the file, the line, the key, and its
//! valid values.

pub mod change;
pub mod devices;
mod file;
mod frames;
mod noise;
pub mod plus;
mod reader;
mod recorded;
mod remote;
pub mod schema;
pub mod session;
pub mod settings_override;
#[cfg(test)]
mod tests;
pub mod virtual_bedside;
pub mod volume;

use std::path::Path;

use glam::{DAffine3, DVec3};

use sync::PairingOptions;

use crate::error::Error;
use crate::kind::{Kind, MAX_BYTES, kind_of};
use crate::settings::Settings;
use crate::texts::{ByPath, Texts};

pub use change::{Change, Changes};
pub use devices::{Arm, ArmKind, Grabber, Roles, Tracker, Tracking, VIRTUAL};
pub use file::Bedside;
pub use reader::Effective;
pub use remote::Remote;
pub use schema::{FORMAT, VERSION};
pub use session::{
    Access, Igtl, MarkerEdge, MarkerInput, MarkerLine, Pairing, Process, Realtime, Record, Scanner, Status,
};
pub use settings_override::{Setting, SettingsOverride};
pub use virtual_bedside::VirtualBedside;
pub use volume::{Picture, Volume};

impl Bedside {
    /// Reads a session configuration file or a PLUS device set.
    ///
    /// # Errors
    /// [`Error`] naming file, line and key or element, of this file or of the calibration
    /// file that it names.
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::read_from(path, Texts::on_disk())
    }

    /// Reads a configuration from the texts of its files, as an earlier reading left them in
    /// [`Self::texts`].
    ///
    /// # Errors
    /// [`Error`], as for [`Self::read`]; also for a file whose text is missing.
    pub fn of_texts(path: &Path, texts: ByPath) -> Result<Self, Error> {
        Self::read_from(path, Texts::kept(texts))
    }

    fn read_from(path: &Path, texts: Texts) -> Result<Self, Error> {
        let text = texts.text(path, MAX_BYTES)?;
        let bedside = Self::parse_with(path, &text, &texts)?;
        Ok(Self { texts: texts.into_read(), ..bedside })
    }

    /// Reads a file's text; `path` is for messages, and its folder for the files that it names.
    ///
    /// # Errors
    /// [`Error`], as for [`Self::read`].
    pub fn parse(path: &Path, text: &str) -> Result<Self, Error> {
        let texts = Texts::on_disk();
        let bedside = Self::parse_with(path, text, &texts)?;
        let mut texts = texts.into_read();
        texts.insert(path.to_owned(), text.to_owned());
        Ok(Self { texts, ..bedside })
    }

    fn parse_with(path: &Path, text: &str, texts: &Texts) -> Result<Self, Error> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        match kind_of(path, text)? {
            Kind::Plus => plus::parse(path, text),
            // For another kind, the parser's error names the found and the expected format.
            Kind::Bedside | Kind::Other => Self::parse_own(path, text, texts),
            Kind::Calibration => Err(Error::Misplaced {
                path: path.to_owned(),
                what: "a calibration file, which names no devices",
                expected: format!(
                    "a session configuration is wanted here: give one with file = \"{}\" in [calibration]",
                    path.file_name().map_or("…".into(), |name| name.to_string_lossy())
                ),
            }),
        }
    }

    /// Checks that the transform from image to probe is known, which every reconstruction needs.
    /// Calibration commands run without it.
    ///
    /// # Errors
    /// [`Error::Uncalibrated`] when it is missing.
    pub fn calibrated(&self) -> Result<(), Error> {
        if self.calibration.transforms.is_empty() {
            return Err(Error::Uncalibrated { path: self.path.clone() });
        }
        Ok(())
    }

    /// Checks that the calibration file is no example. Calibration commands run with one.
    ///
    /// # Errors
    /// [`Error::Example`] when its provenance contains that word.
    pub fn no_example(&self) -> Result<(), Error> {
        let Settings { path: Some(path), provenance, .. } = &self.calibration else { return Ok(()) };
        if self.calibration.is_example() {
            return Err(Error::Example { path: path.clone(), provenance: provenance.clone() });
        }
        Ok(())
    }

    /// Returns the frames' names and the constant transforms, for the way from the image to the
    /// world.
    pub fn pairing_options(&self) -> PairingOptions {
        self.calibration.pairing_options(self.volume.world.as_deref())
    }
}

/// Returns a pixel's size by the image's calibration, mm along u and v; `None` if nothing
/// relates the image to the probe.
pub fn pixel_mm(calibration: &Settings) -> Option<[f64; 2]> {
    let probe_from_image = probe_from_image(calibration)?;
    Some([DVec3::X, DVec3::Y].map(|axis| probe_from_image.transform_vector3(axis).length()))
}

/// Returns the image's calibration: pixels to mm at the probe's sensor, or the arm's last link.
pub fn probe_from_image(calibration: &Settings) -> Option<DAffine3> {
    let image = calibration.image_frame.as_deref().unwrap_or("Image");
    let transform = calibration.transforms.iter().find(|t| t.from == image && t.to == frames::PROBE_FRAME)?;
    Some(transform.affine)
}
