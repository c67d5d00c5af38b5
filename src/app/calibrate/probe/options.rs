//! Flags for a probe's scan, and for its calibration.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use calibration::error::CovarianceError;
use calibration::file::Latency;
use calibration::file::origin::Origin;
use calibration::file::preset::{Preset, Ruler};
use calibration::file::record::{Quality, Record};
use calibration::probe::plane_covariance::PlaneCovariance;
use config::values;
use sonoweave_core::frames::{Image, Probe, Transform};
use sonoweave_core::region::ClipRect;

use super::super::guide::{Advisor, Gathering};
use super::super::outputs::ProbeResult;
use super::super::recorded::Recorded;
use crate::failure::Failure;

/// Longest name of a preset, characters: one line of a list.
const LONGEST_NAME: usize = 80;
/// Longest ruler, pixels or mm: larger numbers are mistakes.
const LONGEST_RULER: f64 = 1e5;
/// Relative difference of a ruler's scale from the image's pixel size that reading errors explain.
const RULER_MISREAD: f64 = 0.1;

/// Method of the probe's calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Method {
    /// By a phantom of N-wires
    Nwire,
    /// By a fixed point, e.g. where two wires cross
    Point,
    /// By a fixed plane: the floor of a water tank, or a membrane
    Plane,
    /// By the tip of a tracked stylus, held into the image
    Stylus,
}

impl Method {
    /// Returns the name on the command line.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Nwire => "nwire",
            Self::Point => "point",
            Self::Plane => "plane",
            Self::Stylus => "stylus",
        }
    }

    /// Returns the name of the target.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::Nwire => "N-wire phantom",
            Self::Point => "a point at rest",
            Self::Plane => "a plane at rest",
            Self::Stylus => "a stylus's tip",
        }
    }
}

/// The scan of a phantom or a target, and the calibration from it.
#[derive(Debug, Args)]
pub(crate) struct Options {
    /// Phantom with its wires, for --method nwire: our file (TOML) or a PLUS XML
    #[arg(long, value_name = "FILE")]
    pub(crate) phantom: Option<PathBuf>,
    /// Recording: a tracked sequence with images (.mha, .mhd, .nrrd, .nhdr)
    #[arg(long, value_name = "SEQUENCE")]
    pub(crate) sequence: Option<PathBuf>,
    /// Recording: a session that `live --record` wrote (.mcap). Its own latencies are ignored
    #[arg(long, value_name = "SESSION")]
    pub(crate) session: Option<PathBuf>,
    /// Session configuration: record its devices now, show instructions, and end when there is
    /// enough
    #[arg(long, value_name = "BEDSIDE.toml")]
    pub(crate) live: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) gathering: Gathering,
    /// Goal for --live: end when points are known to this, mm (one standard deviation at the
    /// worst corner)
    #[arg(long, value_name = "MM", default_value_t = 0.3, value_parser = values::positive)]
    pub(crate) goal: f64,
    /// Validate the result on a second recording, a sequence or a session, which has no part in
    /// it
    #[arg(long, value_name = "SEQUENCE|SESSION")]
    pub(crate) validate: Option<PathBuf>,
    /// Pose of the phantom: a calibration file (TOML) or a PLUS XML with PhantomToReference
    /// [default: the phantom's file]
    #[arg(long, value_name = "FILE")]
    pub(crate) registration: Option<PathBuf>,
    /// Method of the probe's calibration
    #[arg(long, value_enum, default_value_t = Method::Nwire)]
    pub(crate) method: Method,
    #[command(flatten)]
    pub(crate) target: TargetOptions,
    /// Search only this part of the image: X,Y,W,H in pixels [default: the phantom file's, else
    /// the session configuration's, else the whole image]
    #[arg(long, value_name = "X,Y,W,H", value_parser = values::rectangle)]
    pub(crate) clip: Option<ClipRect>,
    /// Refuse a result whose error on the second recording (mean, mm; of N-wires by PLUS's
    /// definition) is larger
    #[arg(long, value_name = "MM", default_value_t = 2.0, value_parser = values::positive)]
    pub(crate) limit: f64,
    /// Put the result into the calibration file as a preset of that name, for the scanner's
    /// present depth, beside others [default: as the file's only one]
    #[arg(long, value_name = "NAME", requires = "output", value_parser = preset_name)]
    pub(crate) preset: Option<String>,
    /// Length along the ruler beside the image, in pixels and in mm: the preset is refused later
    /// if the scanner is set to another depth
    #[arg(long, value_name = "PX,MM", value_parser = ruler, requires = "preset")]
    pub(crate) ruler: Option<Ruler>,
}

fn preset_name(text: &str) -> Result<String, String> {
    let fits = !text.trim().is_empty() && text.chars().count() <= LONGEST_NAME && !text.contains(char::is_control);
    let problem = || format!("must be a name of 1 to {LONGEST_NAME} characters in one line, such as \"40 mm\"");
    fits.then(|| text.to_owned()).ok_or_else(problem)
}

fn ruler(text: &str) -> Result<Ruler, String> {
    let numbers = text.split_once(',');
    let numbers = numbers.and_then(|(px, mm)| Some((px.trim().parse::<f64>().ok()?, mm.trim().parse::<f64>().ok()?)));
    let ruler = numbers.filter(|(px, mm)| px.max(*mm) <= LONGEST_RULER).and_then(|(px, mm)| Ruler::new(px, mm));
    ruler.ok_or_else(|| format!("must be two lengths above 0, at most {LONGEST_RULER}: pixels,mm"))
}

/// A calibration, as the file keeps it.
#[derive(Clone)]
pub(crate) struct Made {
    pub(crate) probe_from_image: Transform<Probe, Image>,
    pub(crate) provenance: String,
    pub(crate) size_px: [u32; 2],
    pub(crate) quality: Quality,
    pub(crate) covariance: Result<PlaneCovariance, CovarianceError>,
    pub(crate) origin: Origin,
    pub(crate) latency: Option<Latency>,
}

impl Options {
    /// Checks the flags before the work. Returns the file that the method needs.
    ///
    /// # Errors
    /// [`Failure`] with a flag that is missing, or that has no effect.
    pub(crate) fn checked(&self) -> Result<MethodFile<'_>, Failure> {
        let Self { method, phantom, registration, target: TargetOptions { stylus_tip, reference, .. }, .. } = self;
        let found = "which finds the target's position itself";
        let useless = match method {
            Method::Nwire => [("--stylus-tip", stylus_tip.is_some(), ""), ("--reference", reference.is_some(), "")],
            _ => [("--phantom", phantom.is_some(), found), ("--registration", registration.is_some(), found)],
        };
        let others = match method {
            Method::Stylus => ("--reference", reference.is_some(), "whose poses are in the frame that --stylus names"),
            Method::Point | Method::Plane => ("--stylus-tip", stylus_tip.is_some(), ""),
            Method::Nwire => ("", false, ""),
        };
        if let Some((flag, _, why)) = useless.into_iter().chain([others]).find(|(_, is_given, _)| *is_given) {
            let why = if why.is_empty() { String::new() } else { format!(", {why}") };
            fail!(
                "{flag}: has no effect with --method {}{why}; leave it out, or choose another --method",
                method.name()
            );
        }
        match (method, phantom, stylus_tip) {
            (Method::Nwire, Some(phantom), _) => Ok(MethodFile::Phantom(phantom)),
            (Method::Nwire, None, _) => Err(Failure::new(
                "--method nwire needs the phantom's wires: give --phantom, or choose another --method",
            )),
            (Method::Stylus, _, None) => Err(Failure::new(
                "--method stylus needs the position of the stylus's tip; give its file with --stylus-tip, or find it \
                with `calibrate pivot`",
            )),
            (_, _, tip) => Ok(MethodFile::Target(tip.as_deref())),
        }
    }

    /// Returns the calibration for the file, also as a preset if one was requested.
    ///
    /// # Errors
    /// [`Failure`] for a calibration that is too uncertain, or that contradicts the ruler.
    pub(crate) fn result(&self, made: Made) -> Result<ProbeResult, Failure> {
        let Made { probe_from_image, provenance, size_px, quality, covariance, origin, latency } = made;
        let covariance = covariance.map_err(|problem| {
            Failure::new(format!("{}: the result is too uncertain: {problem}", self.path().display()))
        })?;
        if let Some(ruler) = &self.ruler {
            let m = probe_from_image.affine().matrix3;
            let pixels_mm = [m.x_axis, m.y_axis].map(|side| side.length());
            if pixels_mm.iter().all(|mm| (ruler.pixel_mm() / mm - 1.0).abs() > RULER_MISREAD) {
                let ([u, v], Ruler { px, mm }) = (pixels_mm, ruler);
                fail!(
                    "--ruler {px},{mm}: gives {:.4} mm a pixel, but the recording's pixels have {u:.4} × {v:.4} mm; read \
                    both lengths between the same two marks again",
                    ruler.pixel_mm()
                );
            }
        }
        let record = Record { origin, picture_px: Some(size_px), quality: Some(quality), covariance: Some(covariance) };
        let preset = self.preset.as_ref().map(|name| Preset {
            name: name.clone(),
            probe_from_image,
            ruler: self.ruler,
            clip: None,
            fan: None,
            record: record.clone(),
        });
        Ok(ProbeResult { probe_from_image, provenance, record, preset, latency })
    }

    /// Returns the recording's file.
    pub(crate) fn path(&self) -> &Path {
        // The command line guarantees that one of them is present.
        let some = [&self.sequence, &self.session, &self.live].into_iter().flatten().next();
        some.map_or(Path::new(""), PathBuf::as_path)
    }

    /// Opens the second recording.
    pub(crate) fn second(&self, advisor: &dyn Advisor) -> Result<Option<Recorded>, Failure> {
        let second = self.validate.as_ref().map(|path| Recorded::of(path)).transpose()?;
        let is_session = self.sequence.is_none();
        if second.as_ref().is_some_and(|second| second.bedside().is_some() != is_session) {
            advisor.say(
                "note: one recording is a sequence and the other a session; if their lags differ, the second one's \
                errors are too large",
            );
        }
        Ok(second)
    }

    pub(crate) fn recorded(&self, made: Option<&Path>) -> Result<Recorded, Failure> {
        match made.or(self.session.as_deref()) {
            Some(path) => Recorded::session(path),
            None => Ok(Recorded::Sequence(self.path().to_owned())),
        }
    }
}

/// The file that a method needs besides the recording.
#[derive(Debug, Clone, Copy)]
pub(crate) enum MethodFile<'a> {
    /// A phantom with its wires.
    Phantom(&'a Path),
    /// None, or the stylus's tip.
    Target(Option<&'a Path>),
}

/// Flags of the methods that need no phantom file.
#[derive(Debug, Args)]
pub(crate) struct TargetOptions {
    /// Stylus tip, for --method stylus: a calibration file (TOML) or a PLUS XML with
    /// StylusTipToStylus
    #[arg(long, value_name = "FILE")]
    pub(crate) stylus_tip: Option<PathBuf>,
    /// Name of the frame of the stylus's sensor
    #[arg(long, value_name = "NAME", default_value = "Stylus")]
    pub(super) stylus: String,
    /// Error of the tip's position on the stylus along each axis, mm (one standard deviation)
    #[arg(long, value_name = "MM", default_value_t = 0.3, value_parser = values::positive)]
    pub(super) tip_error: f64,
    /// Name of the frame in which the point or the plane rests [default: Reference if the
    /// recording has one, else Tracker]
    #[arg(long, value_name = "NAME")]
    pub(super) reference: Option<String>,
}
