//! Settings of the input, from a calibration file or a PLUS configuration.

mod read;

use std::path::PathBuf;

use serde::Serialize;

use calibration::arm::Arm;
use calibration::file::preset::Preset;
use calibration::file::record::Record;
use calibration::file::{CalibrationFile, Latency};
use calibration::tracker::noise::{RestNoise, TrackerNoise};
use calibration::tracker::zones::Zones;
use mask::{Clip, MaskSettings};
use sonoweave_core::keys::numbers;
use sonoweave_core::named::StaticTransform;
use sonoweave_core::region::{ClipRect, Fan};
use sync::PairingOptions;

use crate::error::Error;

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
    /// Origin of the numbers in our own file, for people. It is not serialised: the file has it.
    #[serde(skip)]
    pub provenance: String,
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
    /// Day, inputs, quality and covariance of the probe's calibration. Neither it nor the noise is
    /// serialised: other reports have their own form.
    #[serde(skip)]
    pub record: Record,
    /// Noise of the tracker's sensors at rest.
    #[serde(skip)]
    pub tracker_noise: Option<RestNoise>,
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

    /// Returns the noise of a sensor's pose: at rest, or by the residuals of the probe's
    /// calibration. `None` if the file states neither.
    pub fn sensor_noise(&self) -> Option<TrackerNoise> {
        let fitted = || self.record.quality.and_then(|quality| quality.sensors);
        self.tracker_noise.map(|noise| noise.whole).or_else(fitted)
    }

    /// Returns the settings of our calibration file.
    pub fn of_file(file: &CalibrationFile) -> Self {
        Self {
            source: SourceKind::Sonoweave,
            provenance: file.provenance.clone(),
            transforms: file.named_transforms(),
            clip: file.clip,
            fan: file.fan,
            spacing_mm: file.spacing_mm,
            hwhm_mm: file.hwhm_mm,
            latency: file.latency,
            arm: file.arm,
            arm_fit_rms_mm: file.arm_fit_rms_mm,
            distortion: file.distortion.clone(),
            record: file.record.clone(),
            tracker_noise: file.tracker_noise,
            ..Self::default()
        }
    }

    /// Whether the file calls itself an example, so that its numbers are no probe's.
    pub fn is_example(&self) -> bool {
        let mut words = self.provenance.split(|c: char| !c.is_alphanumeric());
        words.any(|word| word.eq_ignore_ascii_case("example"))
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
        self.record = Record::default();
        Ok(())
    }

    /// Returns the image mask, as far as the file defines it.
    pub fn mask(&self) -> MaskSettings {
        let clip = match (self.clip, self.source) {
            (None, _) => Clip::Auto,
            (Some(rect), SourceKind::Plus) => Clip::RectOrAuto(rect),
            (Some(rect), _) => Clip::Rect(rect),
        };
        MaskSettings { clip, fan: self.fan, picture_px: self.record.picture_px }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn example_is_recognised_by_its_provenance() {
        let is_example =
            |provenance: &str| Settings { provenance: provenance.into(), ..Settings::default() }.is_example();
        for provenance in ["an example: replace it by your probe's", "Example", "N-wires; (EXAMPLE)", "the example's"] {
            assert!(is_example(provenance), "{provenance}");
        }
        for provenance in ["", "N-wire phantom, 140 frames", "exemplary", "examples of the ward"] {
            assert!(!is_example(provenance), "{provenance}");
        }
    }
}
