//! Presets: a probe's calibration at one depth of one scanner, with its record and its conditions
//! of use.
//!
//! ```toml
//! [[preset]]
//! name = "L14-5, 40 mm"
//! ruler = { px = 512.0, mm = 40.0 }         # between two marks of the depth ruler; optional
//! image_to_probe = [ 16 numbers ]
//! clip_px = { x = 192, y = 16, width = 420, height = 580 } # optional
//! # made, picture_px, quality, covariance and input, as in [image_to_probe] of the file
//! ```

use sonoweave_core::frames::{Image, Probe, Transform};
use sonoweave_core::keys::{Entry, FileError};
use sonoweave_core::region::{ClipRect, Fan};

use super::record::{self, Record};
use super::values::{clip, fan, line, matrix_text};
use crate::error::PresetError;

/// Relative tolerance of ruler scales; reading two marks to a pixel each is less exact.
const SAME_RULER: f64 = 0.01;

/// A probe's calibration at one depth.
#[derive(Debug, Clone, PartialEq)]
pub struct Preset {
    /// The name it is chosen by.
    pub name: String,
    /// Transform from pixels to mm at the probe's sensor.
    pub probe_from_image: Transform<Probe, Image>,
    /// The ruler beside its images.
    pub ruler: Option<Ruler>,
    /// Clip rectangle, if it differs from the file's.
    pub clip: Option<ClipRect>,
    /// Fan, if it differs from the file's.
    pub fan: Option<Fan>,
    /// Its day, inputs, quality and covariance.
    pub record: Record,
}

/// A length along the ruler that scanners show beside their image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ruler {
    /// Pixels between two of its marks.
    pub px: f64,
    /// Distance of these marks by their labels, mm.
    pub mm: f64,
}

impl Ruler {
    /// Returns a ruler; `None` if a length is not above 0.
    pub fn new(px: f64, mm: f64) -> Option<Self> {
        (px > 0.0 && mm > 0.0 && px.is_finite() && mm.is_finite()).then_some(Self { px, mm })
    }

    /// Returns the size of a pixel, mm.
    pub fn pixel_mm(&self) -> f64 {
        self.mm / self.px
    }

    /// Reads `{ px = …, mm = … }`.
    ///
    /// # Errors
    /// [`FileError::Key`] if a key is missing or invalid.
    pub fn read(entry: &Entry<'_>) -> Result<Self, FileError> {
        let table = entry.table(&["px", "mm"])?;
        let [px, mm] = [table.need("px")?.number()?, table.need("mm")?.number()?];
        Self::new(px, mm).ok_or_else(|| entry.error("both lengths must be above 0"))
    }
}

impl Preset {
    /// Compares the scanner's settings, as far as they are known, with those of the preset.
    ///
    /// # Errors
    /// [`PresetError`]: the preset must not be used.
    pub fn fits(&self, picture_px: Option<[u32; 2]>, ruler: Option<Ruler>) -> Result<(), PresetError> {
        if let (Some(expected), Some(found)) = (self.record.picture_px, picture_px)
            && expected != found
        {
            return Err(PresetError::Size { name: self.name.clone(), expected, found });
        }
        if let (Some(own), Some(other)) = (self.ruler, ruler) {
            let [expected, found] = [own, other].map(|ruler| ruler.pixel_mm());
            if (found / expected - 1.0).abs() > SAME_RULER {
                return Err(PresetError::Ruler { name: self.name.clone(), expected, found });
            }
        }
        Ok(())
    }

    pub(super) fn read(entry: &Entry<'_>) -> Result<Self, FileError> {
        let own = ["name", "ruler", "image_to_probe", "clip_px", "fan"];
        let table = entry.table(&[&own[..], &record::KEYS].concat())?;
        let name = table.need("name")?;
        if name.text()?.trim().is_empty() {
            return Err(name.error("must not be empty, as presets are chosen by their names"));
        }
        let matrix = table.need("image_to_probe")?;
        let probe_from_image = Transform::from_rows(&matrix.numbers()?).map_err(|e| matrix.error(e.to_string()))?;
        Ok(Self {
            name: name.text()?.to_owned(),
            probe_from_image,
            ruler: table.get("ruler").map(|entry| Ruler::read(&entry)).transpose()?,
            clip: table.get("clip_px").map(|entry| clip(&entry)).transpose()?,
            fan: table.get("fan").map(|entry| fan(&entry)).transpose()?,
            record: Record::read(&table, &probe_from_image)?,
        })
    }

    pub(super) fn write(&self, text: &mut String) {
        let Self { name, probe_from_image, ruler, clip, fan, record } = self;
        line(text, format_args!("\n[[preset]]\nname = {}", toml::Value::String(name.clone())));
        record.write_values(text);
        if let Some(Ruler { px, mm }) = ruler {
            line(text, format_args!("ruler = {{ px = {px:?}, mm = {mm:?} }}"));
        }
        line(text, format_args!("image_to_probe = {}", matrix_text(&probe_from_image.to_rows())));
        if let Some(ClipRect { x, y, width, height }) = clip {
            line(text, format_args!("clip_px = {{ x = {x}, y = {y}, width = {width}, height = {height} }}"));
        }
        if let Some(fan) = fan {
            let (origin, radii, angles) = (fan.origin_px(), fan.radii_px(), fan.angles_deg());
            line(
                text,
                format_args!("fan = {{ origin_px = {origin:?}, radii_px = {radii:?}, angles_deg = {angles:?} }}"),
            );
        }
        record.write_tables("preset", text);
    }
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DVec3};

    use super::*;
    use crate::file::record::tests::record;

    fn preset() -> Preset {
        Preset {
            name: "L14-5 \"near\"".into(),
            probe_from_image: Transform::from_affine(DAffine3::from_scale(DVec3::new(0.078, 0.079, 0.08))),
            ruler: Ruler::new(512.0, 40.0),
            clip: ClipRect::new(27, 27, 766, 562).ok(),
            fan: None,
            record: record(),
        }
    }

    #[test]
    fn other_size_or_depth_does_not_fit() {
        let own = preset();
        assert_eq!(own.fits(None, None), Ok(()));
        assert_eq!(own.fits(Some([820, 616]), Ruler::new(256.0, 20.1)), Ok(()));
        let size = own.fits(Some([640, 480]), None);
        assert!(matches!(size, Err(PresetError::Size { expected: [820, 616], found: [640, 480], .. })), "{size:?}");
        let message = own.fits(None, Ruler::new(256.0, 30.0)).unwrap_err().to_string();
        assert!(message.contains("0.0781 mm a pixel, but the scanner's has 0.1172"), "{message}");
        let of_any = Preset { ruler: None, record: Record::default(), ..own };
        assert_eq!(of_any.fits(Some([1, 1]), Ruler::new(1.0, 1.0)), Ok(()));
    }

    #[test]
    fn written_preset_is_read_back_and_errors_are_named() {
        use std::path::Path;

        use crate::file::CalibrationFile;

        let file = CalibrationFile {
            presets: vec![preset(), Preset { name: "far".into(), ..preset() }],
            ..CalibrationFile::default()
        };
        let text = file.to_text();
        let read = |text: &str| CalibrationFile::parse(Path::new("c.toml"), text);
        assert_eq!(read(&text).unwrap(), file, "{text}");
        for (from, to, message) in [
            ("2026-11-22", "2026-11-32", "must be a day"),
            ("name = \"far\"", "name = \"L14-5 \\\"near\\\"\"", "there is another preset of that name"),
            ("px = 512.0", "px = 0", "above 0"),
            ("picture_px = [820, 616]", "picture_px = [820]", "width and height"),
            ("0123456789abcdef0", "0123456789abcdeg0", "64 hexadecimal"),
            ("frames = 188", "frame = 188", "did you mean frames?"),
        ] {
            assert!(text.contains(from), "{from} in {text}");
            let error = read(&text.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(error.contains(message) && error.contains("c.toml"), "{error}");
        }
    }
}
