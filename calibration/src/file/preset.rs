//! Presets: a probe's calibration at one depth of one scanner, with its date, inputs, quality
//! and conditions of use.
//!
//! ```toml
//! [[preset]]
//! name = "L14-5, 40 mm"
//! made = "2026-11-22"                       # optional, as all but name and image_to_probe
//! picture_px = [820, 616]                   # size of the images
//! ruler = { px = 512.0, mm = 40.0 }         # pixels and mm between two marks of the depth
//! ruler
//! image_to_probe = [ 16 numbers ]
//! clip_px = { x = 192, y = 16, width = 420, height = 580 }
//!
//! [preset.quality]
//! frames = 188
//! error_mm = [0.41, 0.22]                   # distances of the marks: mean, standard deviation
//! validation_error_mm = [0.46, 0.25]        # the same of frames that were held out
//! centre_mm = 0.05                          # standard deviation of a point at the image
//! centre
//! corner_mm = 0.11                          # and at its worst corner
//!
//! [preset.covariance]                       # of the fitted parameters
//! parameters = ["turn about x (rad)", …]
//! rows = [[…], …]
//!
//! [[preset.input]]
//! file = "Calibration.igs.mha"
//! sha256 = "…"
//! ```

use std::fmt::Write as _;

use sonoweave_core::date::Date;
use sonoweave_core::frames::{Image, Probe, Transform};
use sonoweave_core::keys::{Entry, FileError, Table};
use sonoweave_core::region::{ClipRect, Fan};

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
    /// The day it was made.
    pub made: Option<Date>,
    /// Width and height of its images, pixels.
    pub picture_px: Option<[u32; 2]>,
    /// The ruler beside these images.
    pub ruler: Option<Ruler>,
    /// Clip rectangle, if it differs from the file's.
    pub clip: Option<ClipRect>,
    /// Fan, if it differs from the file's.
    pub fan: Option<Fan>,
    /// Its quality.
    pub quality: Option<Quality>,
    /// Covariance of the fitted parameters.
    pub covariance: Option<Covariance>,
    /// The files it was made from.
    pub inputs: Vec<Input>,
}

/// Quality of a calibration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quality {
    /// Number of frames used.
    pub frames: u32,
    /// Mean and standard deviation of the marks' distances from their expected places, mm.
    pub error_mm: [f64; 2],
    /// The same for frames that the fit did not use.
    pub validation_error_mm: Option<[f64; 2]>,
    /// Standard deviation of a point's place at the image centre, mm.
    pub centre_mm: f64,
    /// The same at the worst corner.
    pub corner_mm: f64,
}

/// Covariance of the fitted numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Covariance {
    /// Their names and units.
    pub parameters: Vec<String>,
    /// One row per parameter.
    pub rows: Vec<Vec<f64>>,
}

/// A file that a calibration was made from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Input {
    /// Its name, without its folder.
    pub file: String,
    /// Its SHA-256, as `sha256sum` prints it.
    pub sha256: String,
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
        if let (Some(expected), Some(found)) = (self.picture_px, picture_px)
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

    /// Returns a warning if the preset is older than `days`, or was made after today.
    pub fn age_warning(&self, today: Date, days: i64) -> Option<String> {
        let Self { name, made, .. } = self;
        let made = (*made)?;
        let age = today.days_since(made);
        if age > days {
            return Some(format!(
                "the preset \"{name}\" was made {age} days ago ({made}), and sensors shift with time; check the probe, or calibrate it anew"
            ));
        }
        (age < -1).then(|| format!("the preset \"{name}\" was made on {made}, but this machine's clock says {today}; correct the one that is wrong"))
    }

    pub(super) fn read(entry: &Entry<'_>) -> Result<Self, FileError> {
        let table = entry.table(&[
            "name",
            "made",
            "picture_px",
            "ruler",
            "image_to_probe",
            "clip_px",
            "fan",
            "quality",
            "covariance",
            "input",
        ])?;
        let name = table.need("name")?;
        if name.text()?.trim().is_empty() {
            return Err(name.error("must not be empty, as presets are chosen by their names"));
        }
        let matrix = table.need("image_to_probe")?;
        let probe_from_image = Transform::from_rows(&matrix.numbers()?).map_err(|e| matrix.error(e.to_string()))?;
        let made = table
            .get("made")
            .map(|entry| Date::parse(entry.text()?).ok_or_else(|| entry.error("must be a day, as in \"2026-11-22\"")));
        let inputs = table.get("input").map(|entry| inputs(&entry)).transpose()?.unwrap_or_default();
        Ok(Self {
            name: name.text()?.to_owned(),
            probe_from_image,
            made: made.transpose()?,
            picture_px: table.get("picture_px").map(|entry| size(&entry)).transpose()?,
            ruler: table.get("ruler").map(|entry| Ruler::read(&entry)).transpose()?,
            clip: table.get("clip_px").map(|entry| clip(&entry)).transpose()?,
            fan: table.get("fan").map(|entry| fan(&entry)).transpose()?,
            quality: table.get("quality").map(|entry| quality(&entry)).transpose()?,
            covariance: table.get("covariance").map(|entry| covariance(&entry)).transpose()?,
            inputs,
        })
    }

    pub(super) fn write(&self, text: &mut String) {
        let Self { name, probe_from_image, made, picture_px, ruler, clip, fan, quality, covariance, inputs } = self;
        line(text, format_args!("\n[[preset]]\nname = {}", toml::Value::String(name.clone())));
        if let Some(made) = made {
            line(text, format_args!("made = \"{made}\""));
        }
        if let Some([width, height]) = picture_px {
            line(text, format_args!("picture_px = [{width}, {height}]"));
        }
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
        if let Some(Quality { frames, error_mm, validation_error_mm, centre_mm, corner_mm }) = quality {
            line(text, format_args!("\n[preset.quality]\nframes = {frames}\nerror_mm = {error_mm:?}"));
            if let Some(error_mm) = validation_error_mm {
                line(text, format_args!("validation_error_mm = {error_mm:?}"));
            }
            line(text, format_args!("centre_mm = {centre_mm:?}\ncorner_mm = {corner_mm:?}"));
        }
        if let Some(Covariance { parameters, rows }) = covariance {
            line(text, format_args!("\n[preset.covariance]\nparameters = {parameters:?}\nrows = ["));
            for row in rows {
                let mut numbers = String::new();
                for number in row {
                    // Writing to a string does not fail.
                    let _ = write!(numbers, "{number:e}, ");
                }
                line(text, format_args!("    [{}],", numbers.trim_end_matches(", ")));
            }
            line(text, format_args!("]"));
        }
        for Input { file, sha256 } in inputs {
            let file = toml::Value::String(file.clone());
            line(text, format_args!("\n[[preset.input]]\nfile = {file}\nsha256 = \"{sha256}\""));
        }
    }
}

fn size(entry: &Entry<'_>) -> Result<[u32; 2], FileError> {
    let sides = entry.items("width and height in pixels")?;
    let [width, height] = &sides[..] else { return Err(entry.error("must hold width and height")) };
    let size = [width.whole()?, height.whole()?];
    if size.contains(&0) { Err(entry.error("must be 1 or more pixels along each side")) } else { Ok(size) }
}

fn quality(entry: &Entry<'_>) -> Result<Quality, FileError> {
    let table = entry.table(&["frames", "error_mm", "validation_error_mm", "centre_mm", "corner_mm"])?;
    Ok(Quality {
        frames: table.need("frames")?.whole()?,
        error_mm: table.need("error_mm")?.numbers()?,
        validation_error_mm: table.get("validation_error_mm").map(|entry| entry.numbers()).transpose()?,
        centre_mm: table.need("centre_mm")?.number()?,
        corner_mm: table.need("corner_mm")?.number()?,
    })
}

fn covariance(entry: &Entry<'_>) -> Result<Covariance, FileError> {
    let table = entry.table(&["parameters", "rows"])?;
    let named = table.need("parameters")?;
    let parameters: Result<Vec<String>, _> =
        named.items("names")?.iter().map(|name| Ok(name.text()?.to_owned())).collect();
    let parameters = parameters?;
    let entry = table.need("rows")?;
    let rows: Result<Vec<Vec<f64>>, FileError> = entry
        .items("a row a parameter")?
        .iter()
        .map(|row| row.items("numbers")?.iter().map(Entry::number).collect())
        .collect();
    let rows = rows?;
    if rows.len() != parameters.len() || rows.iter().any(|row| row.len() != parameters.len()) {
        return Err(entry.error(format!("must hold {0} rows of {0} numbers, one a parameter", parameters.len())));
    }
    Ok(Covariance { parameters, rows })
}

fn inputs(entry: &Entry<'_>) -> Result<Vec<Input>, FileError> {
    let items = entry.items("a list of tables, each headed [[preset.input]]")?;
    let input = |item: &Entry<'_>| -> Result<Input, FileError> {
        let table: Table<'_> = item.table(&["file", "sha256"])?;
        let hash = table.need("sha256")?;
        let sha256 = hash.text()?.to_owned();
        if sha256.len() != 64 || !sha256.bytes().all(|b| b.is_ascii_hexdigit()) {
            return Err(hash.error("must be 64 hexadecimal digits, as `sha256sum` prints them"));
        }
        Ok(Input { file: table.need("file")?.text()?.to_owned(), sha256 })
    };
    items.iter().map(input).collect()
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DVec3};

    use super::*;

    fn preset() -> Preset {
        Preset {
            name: "L14-5 \"near\"".into(),
            probe_from_image: Transform::from_affine(DAffine3::from_scale(DVec3::new(0.078, 0.079, 0.08))),
            made: Date::parse("2026-11-22"),
            picture_px: Some([820, 616]),
            ruler: Ruler::new(512.0, 40.0),
            clip: ClipRect::new(27, 27, 766, 562).ok(),
            fan: None,
            quality: Some(Quality {
                frames: 188,
                error_mm: [0.4, 0.2],
                validation_error_mm: Some([0.5, 0.25]),
                centre_mm: 0.05,
                corner_mm: 0.1,
            }),
            covariance: Some(Covariance {
                parameters: vec!["turn about x (rad)".into(), "place x (mm)".into()],
                rows: vec![vec![1e-6, -2.5e-7], vec![-2.5e-7, 3.25e-3]],
            }),
            inputs: vec![Input { file: "a b.igs.mha".into(), sha256: "0123456789abcdef".repeat(4) }],
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
        let of_any = Preset { picture_px: None, ruler: None, ..own };
        assert_eq!(of_any.fits(Some([1, 1]), Ruler::new(1.0, 1.0)), Ok(()));
    }

    #[test]
    fn old_or_future_preset_is_warned_of() {
        let day = |text| Date::parse(text).unwrap();
        let own = preset();
        assert_eq!(own.age_warning(day("2027-05-20"), 180), None);
        assert!(own.age_warning(day("2027-05-22"), 180).unwrap().contains("181 days ago (2026-11-22)"));
        assert!(own.age_warning(day("2026-11-01"), 180).unwrap().contains("clock says 2026-11-01"));
        assert_eq!(own.age_warning(day("2026-11-21"), 180), None, "east of here it is tomorrow already");
        assert_eq!(Preset { made: None, ..own }.age_warning(day("2090-01-01"), 1), None);
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
            ("1e-6, ", "", "2 rows of 2 numbers"),
        ] {
            assert!(text.contains(from), "{from} in {text}");
            let error = read(&text.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(error.contains(message) && error.contains("c.toml"), "{error}");
        }
    }
}
