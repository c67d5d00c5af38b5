//! Record of a probe's calibration: its day, its input files, its quality and its covariance. It
//! stands beside the file's own `image_to_probe`, and in each preset.

use std::fmt::Write as _;

use sonoweave_core::date::Date;
use sonoweave_core::frames::{Image, Probe, Transform};
use sonoweave_core::keys::{Entry, FileError, Table};

use super::origin::{self, Origin};
use super::tracker_noise;
use super::values::line;
use crate::error::CovarianceError;
use crate::probe::plane::ImagePlane;
use crate::probe::plane_covariance::PlaneCovariance;
use crate::tracker::noise::TrackerNoise;

/// Keys of a record, within the table of its calibration.
pub(super) const KEYS: [&str; 5] = [origin::KEYS[0], origin::KEYS[1], "picture_px", "quality", "covariance"];
/// Relative difference of standard deviations that is no contradiction.
const SAME: f64 = 0.01;
/// The same for tiny ones, mm.
const SAME_MM: f64 = 1e-6;

/// Record of a probe's calibration. Calibrations of other programs, and earlier ones, lack it in
/// part or whole.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Record {
    /// Its day and its input files.
    pub origin: Origin,
    /// Width and height of its images, pixels.
    pub picture_px: Option<[u32; 2]>,
    /// Its quality.
    pub quality: Option<Quality>,
    /// Covariance of the plane's numbers; without it the calibration error is unknown.
    pub covariance: Option<PlaneCovariance>,
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
    /// Noise of the sensors' poses by the residuals, if they tell it.
    pub sensors: Option<TrackerNoise>,
}

impl Record {
    /// Returns a warning if the calibration, by its name as a subject, is older than `days`, or was
    /// made after today.
    pub fn age_warning(&self, name: &str, today: Date, days: i64) -> Option<String> {
        let made = self.origin.made?;
        let age = today.days_since(made);
        if age > days {
            return Some(format!(
                "{name} was made {age} days ago ({made}), and sensors shift with time; check the probe, or calibrate it anew"
            ));
        }
        (age < -1).then(|| {
            format!("{name} was made on {made}, but this machine's clock says {today}; correct the one that is wrong")
        })
    }

    /// Reads a record from the table of its calibration, whose transform is known.
    pub(super) fn read(table: &Table<'_>, probe_from_image: &Transform<Probe, Image>) -> Result<Self, FileError> {
        let record = Self {
            origin: Origin::read(table)?,
            picture_px: table.get("picture_px").map(|entry| size(&entry)).transpose()?,
            quality: table.get("quality").map(|entry| quality(&entry)).transpose()?,
            covariance: table.get("covariance").map(|entry| covariance(&entry)).transpose()?,
        };
        if let (Some(size_px), Some(quality), Some(covariance), Some(entry)) =
            (record.picture_px, record.quality, &record.covariance, table.get("quality"))
        {
            let found = covariance.ends_mm(&ImagePlane::of(&probe_from_image.affine()), size_px);
            let table = entry.table(&QUALITY)?;
            for ((key, stated_mm), found_mm) in
                [("centre_mm", quality.centre_mm), ("corner_mm", quality.corner_mm)].into_iter().zip(found)
            {
                if (stated_mm - found_mm).abs() > SAME * found_mm + SAME_MM {
                    let problem = CovarianceError::Quality { stated_mm, found_mm };
                    return Err(table.need(key)?.error(problem.to_string()));
                }
            }
        }
        Ok(record)
    }

    /// Writes the values, among those of the calibration.
    pub(super) fn write_values(&self, text: &mut String) {
        self.origin.write_day(text);
        if let Some([width, height]) = self.picture_px {
            line(text, format_args!("picture_px = [{width}, {height}]"));
        }
    }

    /// Writes the tables within the table `of`, after all values.
    pub(super) fn write_tables(&self, of: &str, text: &mut String) {
        if let Some(quality) = &self.quality {
            let Quality { frames, error_mm, validation_error_mm, centre_mm, corner_mm, sensors } = quality;
            line(text, format_args!("\n[{of}.quality]\nframes = {frames}\nerror_mm = {error_mm:?}"));
            if let Some(error_mm) = validation_error_mm {
                line(text, format_args!("validation_error_mm = {error_mm:?}"));
            }
            line(text, format_args!("centre_mm = {centre_mm:?}\ncorner_mm = {corner_mm:?}"));
            if let Some(TrackerNoise { position_mm, rotation_deg }) = sensors {
                line(text, format_args!("sensor_mm = {position_mm:?}\nsensor_deg = {rotation_deg:?}"));
            }
        }
        if let Some(covariance) = &self.covariance {
            let (parameters, rows) = covariance.listed();
            let pivot_px = covariance.pivot_px().to_array();
            line(
                text,
                format_args!("\n[{of}.covariance]\npivot_px = {pivot_px:?}\nparameters = {parameters:?}\nrows = ["),
            );
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
        self.origin.write_inputs(of, text);
    }
}

fn size(entry: &Entry<'_>) -> Result<[u32; 2], FileError> {
    let sides = entry.items("width and height in pixels")?;
    let [width, height] = &sides[..] else { return Err(entry.error("must hold width and height")) };
    let size = [width.whole()?, height.whole()?];
    if size.contains(&0) { Err(entry.error("must be 1 or more pixels along each side")) } else { Ok(size) }
}

/// Keys of the quality.
const QUALITY: [&str; 7] =
    ["frames", "error_mm", "validation_error_mm", "centre_mm", "corner_mm", "sensor_mm", "sensor_deg"];

fn quality(entry: &Entry<'_>) -> Result<Quality, FileError> {
    let table = entry.table(&QUALITY)?;
    let sensors = match table.get("sensor_mm").is_some() || table.get("sensor_deg").is_some() {
        true => Some(tracker_noise::read(&table, ["sensor_mm", "sensor_deg"])?),
        false => None,
    };
    Ok(Quality {
        frames: table.need("frames")?.whole()?,
        error_mm: table.need("error_mm")?.numbers()?,
        validation_error_mm: table.get("validation_error_mm").map(|entry| entry.numbers()).transpose()?,
        centre_mm: table.need("centre_mm")?.number()?,
        corner_mm: table.need("corner_mm")?.number()?,
        sensors,
    })
}

fn covariance(entry: &Entry<'_>) -> Result<PlaneCovariance, FileError> {
    let table = entry.table(&["pivot_px", "parameters", "rows"])?;
    let Some(pivot) = table.get("pivot_px") else {
        return Err(entry.error(
            "lacks pivot_px, the pixel about which its rotations turn; calibrate anew, or delete this covariance: the \
            calibration error is then unknown",
        ));
    };
    let named = table.need("parameters")?;
    let parameters: Result<Vec<String>, _> =
        named.items("names")?.iter().map(|name| Ok(name.text()?.to_owned())).collect();
    let rows = table.need("rows")?;
    let all: Result<Vec<Vec<f64>>, FileError> = rows
        .items("a row a parameter")?
        .iter()
        .map(|row| row.items("numbers")?.iter().map(Entry::number).collect())
        .collect();
    PlaneCovariance::new(pivot.numbers()?, &parameters?, &all?).map_err(|problem| match problem {
        CovarianceError::Unknown { .. } | CovarianceError::Repeated { .. } | CovarianceError::Missing { .. } => {
            named.error(problem.to_string())
        }
        other => rows.error(other.to_string()),
    })
}

#[cfg(test)]
pub(super) mod tests {
    use std::path::Path;

    use glam::{DAffine3, DVec2, DVec3};

    use super::super::origin::Input;
    use super::*;
    use crate::file::CalibrationFile;
    use crate::probe::plane::NUMBERS;

    fn plane() -> Transform<Probe, Image> {
        Transform::from_affine(DAffine3::from_scale(DVec3::new(0.078, 0.079, 0.08)))
    }

    /// Returns a whole record of [`plane`].
    pub(in crate::file) fn record() -> Record {
        let mut entries = [[0.0; NUMBERS]; NUMBERS];
        for (i, sd) in [0.001, 0.002, 0.001, 0.05, 0.04, 0.06, 0.002, 0.003].into_iter().enumerate() {
            entries[i][i] = sd * sd;
        }
        (entries[0][3], entries[3][0]) = (-2.5e-5, -2.5e-5);
        let covariance = PlaneCovariance::of_fit(DVec2::new(401.5, 300.25), entries).unwrap();
        let [centre_mm, corner_mm] = covariance.ends_mm(&ImagePlane::of(&plane().affine()), [820, 616]);
        Record {
            origin: Origin {
                made: Date::parse("2026-11-22"),
                inputs: vec![Input { file: "a b.igs.mha".into(), sha256: "0123456789abcdef".repeat(4) }],
            },
            picture_px: Some([820, 616]),
            quality: Some(Quality {
                frames: 188,
                error_mm: [0.4, 0.2],
                validation_error_mm: Some([0.5, 0.25]),
                centre_mm,
                corner_mm,
                sensors: Some(TrackerNoise { position_mm: 0.11, rotation_deg: 0.05 }),
            }),
            covariance: Some(covariance),
        }
    }

    #[test]
    fn record_of_only_calibration_is_read_back() {
        let file = CalibrationFile { probe_from_image: Some(plane()), record: record(), ..CalibrationFile::default() };
        let text = file.to_text();
        assert_eq!(CalibrationFile::parse(Path::new("c.toml"), &text).unwrap(), file, "{text}");
    }

    #[test]
    fn invalid_covariance_is_refused_by_file_key_and_remedy() {
        let file = CalibrationFile { probe_from_image: Some(plane()), record: record(), ..CalibrationFile::default() };
        let text = file.to_text();
        for (from, to, key, problem) in [
            ("pivot_px = [401.5, 300.25]\n", "", "covariance", "lacks pivot_px"),
            ("pivot_px = [401.5, ", "pivot_px = [", "covariance.pivot_px", "must hold 2 numbers"),
            ("\"place z (mm)\", ", "", "covariance.parameters", "\"place z (mm)\" is not listed"),
            ("place z (mm)", "place w (mm)", "covariance.parameters", "is no number of an image plane"),
            ("place z (mm)", "place y (mm)", "covariance.parameters", "is listed twice"),
            ("[1e-6, 0e0, ", "[1e-6, ", "covariance.rows", "8 rows of 8 numbers"),
            ("[1e-6, 0e0, ", "[1e-6, 1e-6, ", "covariance.rows", "differ from one another"),
            ("[1e-6, 0e0, ", "[nan, 0e0, ", "covariance.rows[0][0]", "not a finite number"),
            ("[1e-6, 0e0, ", "[-1e-6, 0e0, ", "covariance.rows", "negative variance"),
            ("[1e-6, 0e0, ", "[1e-8, 0e0, ", "covariance.rows", "negative variance"),
            ("[1e-6, 0e0, ", "[4, 0e0, ", "covariance.rows", "is 2.000, more than 0.3"),
            ("centre_mm = 0.", "centre_mm = 1.", "quality.centre_mm", "but the covariance gives 0."),
            ("sensor_deg = 0.05\n", "", "quality.sensor_deg", "is missing"),
            ("sensor_mm = 0.11", "sensor_mm = -1", "quality.sensor_mm", "between 0 and 10"),
        ] {
            assert!(text.contains(from), "{from} in {text}");
            let error = CalibrationFile::parse(Path::new("c.toml"), &text.replacen(from, to, 1)).unwrap_err();
            let FileError::Key { path, key: at, problem: said, .. } = &error else { panic!("{error}") };
            assert_eq!((path.as_path(), at.as_str()), (Path::new("c.toml"), &*format!("image_to_probe.{key}")));
            assert!(said.contains(problem), "{from}: {error}");
        }
    }

    #[test]
    fn old_or_future_calibration_is_warned_of() {
        let day = |text| Date::parse(text).unwrap();
        let warning = |today, days| record().age_warning("the preset", day(today), days);
        assert_eq!(warning("2027-05-20", 180), None);
        assert!(warning("2027-05-22", 180).unwrap().contains("181 days ago (2026-11-22)"));
        assert!(warning("2026-11-01", 180).unwrap().contains("clock says 2026-11-01"));
        assert_eq!(warning("2026-11-21", 180), None, "east of here it is tomorrow already");
        assert_eq!(Record::default().age_warning("the preset", day("2090-01-01"), 1), None);
    }
}
