//! Report on a calibration or configuration file.

use std::path::Path;

use glam::DVec3;
use serde::Serialize;

use calibration::arm::{JOINTS, Joint};
use calibration::error::PresetError;
use calibration::file::CalibrationFile;
use calibration::file::preset::Preset;
use calibration::file::record::Record;
use config::{Error, Settings, SourceKind};
use sonoweave_core::named::StaticTransform;

use super::super::Failure;
use super::text::{Text, point, short, times};

/// A configuration's content.
#[derive(Debug, Serialize)]
pub(super) struct ConfigurationReport {
    #[serde(flatten)]
    settings: Settings,
    /// Provenance of the numbers; only in our own files.
    provenance: Option<String>,
    /// Pixel size along u and v by the probe's calibration, mm.
    pixel_mm: Option<[f64; 2]>,
    /// The joints of the arm that carries the probe, base first.
    arm: Option<[Joint; JOINTS]>,
    /// Its presets, a line each.
    presets: Vec<String>,
    /// The preset that pixel and clip belong to, if there are several.
    shown: Option<String>,
}

/// Formats a preset in a line.
fn about(preset: &Preset) -> String {
    let mut text = format!("\"{}\"", preset.name);
    text += &conditions(&preset.record);
    if let Some(ruler) = preset.ruler {
        text += &format!(" with {} mm a pixel by the ruler", short(ruler.pixel_mm()));
    }
    text + "; " + &accuracy(&preset.record)
}

/// Formats a calibration's day and the size of its pictures, each after a comma.
fn conditions(record: &Record) -> String {
    let made = record.origin.made.map(|made| format!(", made {made}"));
    let size = record.picture_px.map(|[width, height]| format!(", for pictures of {width}×{height}"));
    made.into_iter().chain(size).collect()
}

/// Formats a calibration's accuracy.
fn accuracy(record: &Record) -> String {
    let quality = record.quality.map(|quality| {
        let [centre, corner] = [quality.centre_mm, quality.corner_mm].map(short);
        format!("{} frames, {centre} mm at the centre, {corner} at the worst corner", quality.frames)
    });
    let unknown = record.covariance.is_none().then(|| "calibration error unknown".to_owned());
    quality.into_iter().chain(unknown).collect::<Vec<_>>().join("; ")
}

impl ConfigurationReport {
    pub(super) fn read(path: &Path) -> Result<Self, Failure> {
        // If there are several presets, the first one is shown in full.
        let (settings, first) = match Settings::read(path, None) {
            Err(Error::Preset { problem: PresetError::Unnamed { known }, .. }) => {
                let first = known.into_iter().next();
                (Settings::read(path, first.as_deref())?, first)
            }
            other => (other?, None),
        };
        let own = match settings.source {
            SourceKind::Sonoweave => CalibrationFile::read(path)?,
            SourceKind::Plus | SourceKind::Defaults => CalibrationFile::default(),
        };
        let provenance = Some(own.provenance).filter(|text| !text.is_empty());
        let arm = own.arm.map(|arm| *arm.joints());
        let image = settings.image_frame.as_deref().unwrap_or("Image");
        let pixel_mm = settings.transforms.iter().find(|t| t.from == image && t.to == "Probe").map(|t| {
            let [u, v] = [DVec3::X, DVec3::Y].map(|axis| t.affine.transform_vector3(axis).length());
            [u, v]
        });
        let presets = own.presets.iter().map(about).collect();
        Ok(Self { settings, provenance, pixel_mm, arm, presets, shown: first })
    }

    pub(super) fn write(&self, text: &mut Text) {
        let settings = &self.settings;
        let path = settings.path.as_deref().unwrap_or(Path::new(""));
        let kind = match settings.source {
            SourceKind::Plus => "PLUS configuration",
            SourceKind::Sonoweave | SourceKind::Defaults => "sonoweave calibration file",
        };
        text.heading(&format!("{}: {kind}", path.display()));
        if let Some(provenance) = &self.provenance {
            text.row("provenance", provenance);
        }
        text.rows("presets", &self.presets);
        if let Some(name) = &self.shown {
            text.row("of preset", format!("\"{name}\", what follows"));
        }
        if let Some(name) = &settings.image_frame {
            text.row("image frame", name);
        }
        if let Some(name) = &settings.world {
            text.row("world", name);
        }
        if let Some(pixel) = self.pixel_mm {
            text.row("pixel", format!("{} mm", times(pixel.map(short))));
            if settings.preset.is_none() && settings.source == SourceKind::Sonoweave {
                text.row("accuracy", accuracy(&settings.record) + &conditions(&settings.record));
            }
        }
        if let Some(clip) = settings.clip {
            let (x, y, width, height) = (clip.x, clip.y, clip.width, clip.height);
            text.row("clip", format!("{width}×{height} pixels from column {x}, row {y}"));
        }
        if let Some(fan) = settings.fan {
            let ([u, v], [near, far], [first, last]) = (fan.origin_px(), fan.radii_px(), fan.angles_deg());
            text.row("fan", format!("apex {u}, {v}; radii {near} to {far} pixels; {first}° to {last}°"));
        }
        if let Some(spacing) = settings.spacing_mm {
            text.row("spacing", format!("{} mm", times(spacing)));
        }
        if let Some(hwhm) = settings.hwhm_mm {
            text.row("resolution", format!("{} mm half width at half maximum along u, v, n", point(hwhm)));
        }
        if let Some(latency) = settings.latency {
            let (video, tracker) = (short(latency.video_ms), short(latency.tracker_ms));
            let sure = latency.lag_se_ms.map_or(String::new(), |ms| format!("; the lag is known to {} ms", short(ms)));
            text.row("latency", format!("video {video} ms, tracker {tracker} ms{sure}"));
        }
        if let Some(zones) = &settings.distortion {
            text.row("distortion", zones.to_string());
        }
        text.rows("arm", self.arm.iter().flatten().map(ToString::to_string));
        text.rows("notes", &settings.notes);
        for transform in &settings.transforms {
            text.heading(&transform.name());
            text.rows("", matrix(transform));
        }
    }
}

/// Formats the rows of a transform's matrix, the columns aligned; the JSON form has all digits.
fn matrix(transform: &StaticTransform) -> Vec<String> {
    let cells = transform.rows().map(|v| if v.fract() == 0.0 { v.to_string() } else { format!("{v:.8}") });
    let width = |column: usize| (0..4).map(|row| cells[4 * row + column].len()).max().unwrap_or(0);
    let widths = [0, 1, 2, 3].map(width);
    let row =
        |row: usize| (0..4).map(|c| format!("{:>1$}", cells[4 * row + c], widths[c])).collect::<Vec<_>>().join("  ");
    (0..4).map(row).collect()
}
