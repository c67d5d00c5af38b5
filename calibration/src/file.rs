//! The versioned calibration file: pose of the image plane, valid part of the image,
//! resolution.
//!
//! ```toml
//! format = "sonoweave-calibration"
//! version = 1
//! provenance = "N-wire phantom, 140 frames, 2024-05-02"
//!
//! [image_to_probe]                  # image pixels in MF orientation → mm at the sensor
//! matrix = [ 16 numbers, row major, column vectors ]
//! made = "2026-11-22"               # the day; it and all below are written by `calibrate probe`
//! picture_px = [820, 616]           # size of the images
//!
//! [image_to_probe.quality]
//! frames = 188
//! error_mm = [0.41, 0.22]           # distances of the marks: mean, standard deviation
//! validation_error_mm = [0.46, 0.25] # the same of frames that were held out
//! centre_mm = 0.05                  # standard deviation of a point at the image centre
//! corner_mm = 0.11                  # and at its worst corner
//! sensor_mm = 0.12                  # noise of a sensor along each axis, by the residuals
//! sensor_deg = 0.06                 # and about each axis; optional
//!
//! [image_to_probe.covariance]       # without it the calibration error is unknown
//! pivot_px = [401.5, 300.2]         # the pixel that rotations turn about
//! parameters = ["turn about x (rad)", …]
//! rows = [[…], …]
//!
//! [[image_to_probe.input]]          # a file that it was made from
//! file = "Calibration.igs.mha"
//! sha256 = "…"
//!
//! [image]                           # valid part of the image; both optional
//! clip_px = { x = 192, y = 16, width = 420, height = 580 }
//!
//! [image.fan]                       # degrees from straight down, positive to the right
//! origin_px = [380.0, 20.0]
//! radii_px = [120.0, 360.0]
//! angles_deg = [-45.0, 45.0]
//!
//! [arm]
//! fit_rms_mm = 0.13                 # residual of `sonoweave calibrate arm`; optional
//!
//! [[arm.joint]]                     # the arm that carries the probe: three joints, base first
//! type = "revolute"
//! length_mm = 250.0                 # of the link to the next joint; the probe is at the last end
//! counts_per_turn = 40000
//! zero_counts = -120.5              # count if in line with the link before; default 0
//! sign = -1                         # default 1
//!
//! [[arm.joint]]
//! type = "prismatic"
//! direction_deg = 90.0              # against the link before; default 0
//! length_mm = 40.0
//! counts_per_mm = 100
//!
//! [resolution]
//! hwhm_mm = [0.3, 0.2, 1.1]         # half width at half maximum along u, v and the plane's normal
//!
//! [volume]
//! spacing_mm = [0.5, 0.5, 0.5]
//!
//! [latency]                         # delay of the devices' times after their measurements
//! video_ms = 40.0
//! tracker_ms = -24.8                # only the difference affects the slices' positions
//! lag_se_ms = 0.7                   # standard error of that difference; unknown if missing
//!
//! [distortion]                      # by metal; found by `sonoweave calibrate tracker`
//! measured = "2026-11-22"
//! cell_mm = 50.0                    # edge of the cells that divide the room
//! limit_mm = 1.0                    # cells with a larger error (root mean square) are zones
//!
//! [[distortion.zone]]               # any number; none in a room without metal
//! # corner with the smallest coordinates, in the tracker's frame; whole cells from its origin
//! low_mm = [350.0, 0.0, 100.0]
//! rms_mm = 3.9
//!
//! [tracker_noise]                   # of a resting sensor, along and about each axis
//! position_mm = 0.05
//! rotation_deg = 0.03
//! fast_position_mm = 0.04           # the part of it from one pose to the next; unknown if missing
//! fast_rotation_deg = 0.03
//!
//! [[transform]]                     # further constant transforms, any number
//! from = "Phantom"
//! to = "Reference"
//! matrix = [ 16 numbers ]
//! ```
//!
//! Instead of one `image_to_probe` a file may hold [presets](preset): one per scanner depth,
//! with its conditions of use. The tables `arm`, `latency`, `distortion`, `tracker_noise` and
//! `transform` may hold `made` and `input`, too: see [`origin`].
//!
//! `format` and `version` are required, everything else is optional. Keys that are not listed
//! here are refused.

use std::collections::BTreeMap;
use std::path::Path;

use formats::whole::write_whole;
use sonoweave_core::frames::{Image, Probe, Transform};

use crate::arm::Arm;
use crate::tracker::noise::RestNoise;
use crate::tracker::zones::Zones;
use origin::Origin;
use preset::Preset;
use record::Record;
pub use sonoweave_core::keys::FileError;
use sonoweave_core::keys::{Entry, Source, Table, read_text};
use sonoweave_core::named::StaticTransform;
use sonoweave_core::region::{ClipRect, Fan};
use values::{clip, fan, line, matrix_text};

mod arm;
mod distortion;
mod latency;
pub mod origin;
pub mod preset;
mod preset_choice;
pub mod record;
mod tracker_noise;
mod values;

pub use latency::Latency;

/// The value of `format`.
pub const FORMAT: &str = "sonoweave-calibration";
/// The version that is written, and the newest that is read.
pub const VERSION: u32 = 1;
/// Size limit in bytes; larger files are refused unread.
pub const MAX_BYTES: u64 = 4 << 20;

/// Contents of a calibration file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CalibrationFile {
    /// Origin of the numbers, for people.
    pub provenance: String,
    /// Transform from pixels to mm at the probe's sensor; may carry scale and skew.
    pub probe_from_image: Option<Transform<Probe, Image>>,
    /// Day, inputs, quality and covariance of that transform.
    pub record: Record,
    /// The arm that carries the probe.
    pub arm: Option<Arm>,
    /// Residual of that arm's fit to its touches, mm, root mean square; if known.
    pub arm_fit_rms_mm: Option<f64>,
    /// Clip rectangle: the part of the image that is data.
    pub clip: Option<ClipRect>,
    /// Fan: the sector of the image that is data.
    pub fan: Option<Fan>,
    /// Half width at half maximum along u, v and the plane's normal, mm.
    pub hwhm_mm: Option<[f64; 3]>,
    /// Voxel spacing along x, y, z, mm.
    pub spacing_mm: Option<[f64; 3]>,
    /// Delay of the devices' times after their measurements.
    pub latency: Option<Latency>,
    /// Zones in which metal distorts the tracker's field.
    pub distortion: Option<Zones>,
    /// Noise of a resting sensor.
    pub tracker_noise: Option<RestNoise>,
    /// Further constant transforms.
    pub transforms: Vec<StaticTransform>,
    /// Day and inputs of the other results: by the name of a transform, or of the table.
    pub origins: BTreeMap<String, Origin>,
    /// The probe's calibration at several depths.
    pub presets: Vec<Preset>,
}

impl CalibrationFile {
    /// Reads a file.
    ///
    /// # Errors [`FileError`]: unreadable, larger than [`MAX_BYTES`], not TOML, or a key that
    /// is unknown, missing or out of range.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        Self::parse(path, &read_text(path, MAX_BYTES)?)
    }

    /// Parses a file's text; `path` is for error messages only.
    ///
    /// # Errors
    /// [`FileError`]: not TOML, or a key that is unknown, missing or out of range.
    pub fn parse(path: &Path, text: &str) -> Result<Self, FileError> {
        let source = Source { path, text };
        let parsed = source.parse()?;
        let known = [
            "format",
            "version",
            "provenance",
            "image_to_probe",
            "image",
            "arm",
            "resolution",
            "volume",
            "latency",
            "distortion",
            "tracker_noise",
            "transform",
            "preset",
        ];
        // The format first: in a file of another kind, all keys are unknown.
        check_version(&Table::bare(source, &parsed))?;
        let root = Table::root(source, &parsed, &known)?;

        let mut file = Self::default();
        if let Some(entry) = root.get("provenance") {
            file.provenance = entry.text()?.to_owned();
        }
        if let Some(entry) = root.get("image_to_probe") {
            let table = entry.table(&[&["matrix"], &record::KEYS[..]].concat())?;
            let matrix = table.need("matrix")?;
            let transform = Transform::from_rows(&matrix.numbers()?).map_err(|e| matrix.error(e.to_string()))?;
            file.record = Record::read(&table, &transform)?;
            file.probe_from_image = Some(transform);
        }
        if let Some(entry) = root.get("image") {
            let image = entry.table(&["clip_px", "fan"])?;
            file.clip = image.get("clip_px").map(|entry| clip(&entry)).transpose()?;
            file.fan = image.get("fan").map(|entry| fan(&entry)).transpose()?;
        }
        if let Some(entry) = root.get("arm") {
            let (arm, fit_rms_mm, origin) = arm::read(&entry)?;
            (file.arm, file.arm_fit_rms_mm) = (Some(arm), fit_rms_mm);
            file.originates("arm", origin);
        }
        if let Some(entry) = root.get("resolution") {
            file.hwhm_mm = Some(entry.table(&["hwhm_mm"])?.need("hwhm_mm")?.positive()?);
        }
        if let Some(entry) = root.get("volume") {
            file.spacing_mm = Some(entry.table(&["spacing_mm"])?.need("spacing_mm")?.positive()?);
        }
        if let Some(entry) = root.get("latency") {
            let (latency, origin) = latency::read(&entry)?;
            file.latency = Some(latency);
            file.originates("latency", origin);
        }
        if let Some(entry) = root.get("distortion") {
            let (zones, origin) = distortion::read(&entry)?;
            file.distortion = Some(zones);
            file.originates("distortion", origin);
        }
        if let Some(entry) = root.get("tracker_noise") {
            let (noise, origin) = tracker_noise::of_rest(&entry)?;
            file.tracker_noise = Some(noise);
            file.originates("tracker_noise", origin);
        }
        if let Some(entry) = root.get("transform") {
            for item in entry.items("a list of tables, each headed [[transform]]")? {
                let (transform, origin) = static_transform(&item)?;
                let calibration = file.probe_from_image.as_ref().map(StaticTransform::image_to_probe);
                if file.transforms.iter().chain(&calibration).any(|other| other.relates_same_frames(&transform)) {
                    return Err(item.error(format!(
                        "{} and {} are already related by an earlier transform; keep one of the two",
                        transform.from, transform.to
                    )));
                }
                file.originates(&transform.name(), origin);
                file.transforms.push(transform);
            }
        }
        if let Some(entry) = root.get("preset") {
            for item in entry.items("a list of tables, each headed [[preset]]")? {
                let preset = Preset::read(&item)?;
                if file.presets.iter().any(|other| other.name == preset.name) {
                    return Err(item.error(format!("there is another preset of that name, \"{}\"", preset.name)));
                }
                file.presets.push(preset);
            }
        }
        Ok(file)
    }

    /// Returns the file's text. The digits of the numbers restore them bit for bit.
    pub fn to_text(&self) -> String {
        let mut text = format!("format = \"{FORMAT}\"\nversion = {VERSION}\n");
        if !self.provenance.is_empty() {
            line(&mut text, format_args!("provenance = {}", toml::Value::String(self.provenance.clone())));
        }
        if let Some(transform) = &self.probe_from_image {
            line(&mut text, format_args!("\n[image_to_probe]\nmatrix = {}", matrix_text(&transform.to_rows())));
            self.record.write_values(&mut text);
            self.record.write_tables("image_to_probe", &mut text);
        }
        if let Some(ClipRect { x, y, width, height }) = self.clip {
            line(
                &mut text,
                format_args!("\n[image]\nclip_px = {{ x = {x}, y = {y}, width = {width}, height = {height} }}"),
            );
        }
        if let Some(fan) = &self.fan {
            line(
                &mut text,
                format_args!(
                    "\n[image.fan]\norigin_px = {:?}\nradii_px = {:?}\nangles_deg = {:?}",
                    fan.origin_px(),
                    fan.radii_px(),
                    fan.angles_deg()
                ),
            );
        }
        if let Some(arm) = &self.arm {
            arm::write(arm, self.arm_fit_rms_mm, self.origin("arm"), &mut text);
        }
        if let Some(hwhm) = &self.hwhm_mm {
            line(&mut text, format_args!("\n[resolution]\nhwhm_mm = {hwhm:?}"));
        }
        if let Some(spacing) = &self.spacing_mm {
            line(&mut text, format_args!("\n[volume]\nspacing_mm = {spacing:?}"));
        }
        if let Some(latency) = &self.latency {
            latency::write(latency, self.origin("latency"), &mut text);
        }
        if let Some(zones) = &self.distortion {
            distortion::write(zones, self.origin("distortion"), &mut text);
        }
        if let Some(noise) = self.tracker_noise {
            tracker_noise::write_rest(noise, self.origin("tracker_noise"), &mut text);
        }
        for transform in &self.transforms {
            let [from, to] = [&transform.from, &transform.to].map(|name| toml::Value::String(name.clone()));
            let matrix = matrix_text(&transform.rows());
            line(&mut text, format_args!("\n[[transform]]\nfrom = {from}\nto = {to}\nmatrix = {matrix}"));
            let origin = self.origin(&transform.name());
            origin.write_day(&mut text);
            origin.write_inputs("transform", &mut text);
        }
        self.presets.iter().for_each(|preset| preset.write(&mut text));
        text
    }

    /// Writes the file, whole or not at all.
    ///
    /// # Errors
    /// [`FileError::Io`]; an earlier file is then unharmed.
    pub fn write(&self, path: &Path) -> Result<(), FileError> {
        let io = |source| FileError::Io { path: path.to_owned(), doing: "writing", source };
        write_whole(path, |to| to.write_all(self.to_text().as_bytes())).map_err(io)
    }

    /// Sets day and inputs of a result: by the name of a transform, or of the table.
    pub fn originates(&mut self, name: &str, origin: Origin) {
        if origin == Origin::default() {
            self.origins.remove(name);
        } else {
            self.origins.insert(name.to_owned(), origin);
        }
    }

    fn origin(&self, name: &str) -> &Origin {
        self.origins.get(name).unwrap_or(&origin::UNKNOWN)
    }

    /// Returns all constant transforms, the probe's calibration first, under the names that
    /// sequences use.
    pub fn named_transforms(&self) -> Vec<StaticTransform> {
        let calibration = self.probe_from_image.as_ref().map(StaticTransform::image_to_probe);
        calibration.into_iter().chain(self.transforms.iter().cloned()).collect()
    }
}

fn check_version(root: &Table<'_>) -> Result<(), FileError> {
    let format = root.need("format")?;
    if format.text()? != FORMAT {
        return Err(format.error(format!(
            "must be \"{FORMAT}\" for a calibration file; give another file (a session configuration names its own in \
            [calibration])"
        )));
    }
    let version = root.need("version")?;
    match version.whole()? {
        VERSION => Ok(()),
        newer if newer > VERSION => Err(version.error(format!(
            "version {newer} is newer than this program reads ({VERSION}); use the program that wrote it"
        ))),
        _ => Err(version.error(format!("the first version is {VERSION}"))),
    }
}

fn static_transform(entry: &Entry<'_>) -> Result<(StaticTransform, Origin), FileError> {
    let table = entry.table(&[&["from", "to", "matrix"], &origin::KEYS[..]].concat())?;
    let (from, to) = (table.need("from")?.text()?, table.need("to")?.text()?);
    let matrix = table.need("matrix")?;
    let transform = StaticTransform::new(from, to, &matrix.numbers()?).map_err(|e| matrix.error(e.to_string()))?;
    Ok((transform, Origin::read(&table)?))
}

#[cfg(test)]
mod tests;
