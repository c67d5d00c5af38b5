//! Flags of `calibrate probe`.

use std::path::{Path, PathBuf};

use clap::{ArgGroup, Args, ValueEnum};

use calibration::error::CovarianceError;
use calibration::file::Latency;
use calibration::file::origin::Origin;
use calibration::file::preset::{Preset, Ruler};
use calibration::file::record::{Quality, Record};
use calibration::probe::plane_covariance::PlaneCovariance;
use sonoweave_core::frames::{Image, Probe, Transform};
use sonoweave_core::region::ClipRect;

use super::super::guide::Gathering;
use super::super::outputs::{Outputs, ProbeResult};
use super::super::recorded::Recorded;
use super::lag::Lag;
use super::target::Flags;
use crate::cli::live::outputs::say;
use crate::cli::{Failure, values};

/// Method of the probe's calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Method {
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
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Nwire => "nwire",
            Self::Point => "point",
            Self::Plane => "plane",
            Self::Stylus => "stylus",
        }
    }

    /// Returns the name of the target.
    pub(super) fn title(self) -> &'static str {
        match self {
            Self::Nwire => "N-wire phantom",
            Self::Point => "a point at rest",
            Self::Plane => "a plane at rest",
            Self::Stylus => "a stylus's tip",
        }
    }
}

/// Flags of `calibrate probe`.
#[derive(Debug, Args)]
#[command(
    group(ArgGroup::new("from").required(true).args(["sequence", "session", "live"])),
    after_help = "\
The result is the transform ImageToProbe, and the lag of the tracker's poses behind the frames. A second scan \
validates the result; without one, the last third of the first scan does. Move slowly, for half a minute.

nwire: scan the phantom's wires along and back, and tilt and turn the probe on the way.
point: keep the point (wires that cross in water, a bead) in the picture. Bring it to all parts of the picture, left \
and right, near and far. Tilt the probe fore and aft and from side to side, and turn it about its long axis, each by \
20° or more.
stylus: hold the tip of a tracked stylus into the image plane as a dot, and move it to all parts of the image. \
`calibrate pivot` measures the position of the tip.
plane: hold the probe above the floor of a water tank so that it shows as a line. Raise and lower it, tilt it fore \
and aft and from side to side, by 15° or more. A line gives less information than a point.

Only an N-wire phantom detects mirrored frames; the other methods do not notice them.

Examples: sonoweave calibrate probe --phantom phantom.toml --live bedside.toml -o calibration.toml
          sonoweave calibrate probe --phantom phantom.toml --session SESSION-20261121-213000.mcap -o \
calibration.toml --report probe.html
          sonoweave calibrate probe --phantom phantom.toml --sequence scan.igs.mha --validate second.igs.mha -o \
calibration.toml
          sonoweave calibrate probe --method point --sequence crossing.igs.mha -o calibration.toml --report probe.json
          sonoweave calibrate probe --method stylus --stylus-tip calibration.toml --sequence tip.igs.mha -o \
calibration.toml"
)]
pub struct Arguments {
    /// Phantom with its wires, for --method nwire: our file (TOML) or a PLUS XML
    #[arg(long, value_name = "FILE")]
    pub(super) phantom: Option<PathBuf>,
    /// Recording: a tracked sequence with images (.mha, .mhd, .nrrd, .nhdr)
    #[arg(long, value_name = "SEQUENCE")]
    pub(super) sequence: Option<PathBuf>,
    /// Recording: a session that `live --record` wrote (.mcap). Its own latencies are ignored
    #[arg(long, value_name = "SESSION")]
    pub(super) session: Option<PathBuf>,
    /// Session configuration: record its devices now, show instructions, and end when there is
    /// enough
    #[arg(long, value_name = "BEDSIDE.toml")]
    pub(super) live: Option<PathBuf>,
    #[command(flatten)]
    pub(super) gathering: Gathering,
    /// Goal for --live: end when points are known to this, mm (one standard deviation at the
    /// worst corner)
    #[arg(long, value_name = "MM", default_value_t = 0.3, value_parser = values::positive)]
    pub(super) goal: f64,
    /// Validate the result on a second recording, a sequence or a session, which has no part in
    /// it
    #[arg(long, value_name = "SEQUENCE|SESSION")]
    pub(super) validate: Option<PathBuf>,
    /// Pose of the phantom: a calibration file (TOML) or a PLUS XML with PhantomToReference
    /// [default: the phantom's file]
    #[arg(long, value_name = "FILE")]
    pub(super) registration: Option<PathBuf>,
    /// Method of the probe's calibration
    #[arg(long, value_enum, default_value_t = Method::Nwire)]
    pub(super) method: Method,
    #[command(flatten)]
    pub(super) target: Flags,
    /// Search only this part of the image: X,Y,W,H in pixels [default: the phantom file's, else
    /// the session configuration's, else the whole image]
    #[arg(long, value_name = "X,Y,W,H", value_parser = values::rectangle)]
    pub(super) clip: Option<ClipRect>,
    /// Refuse a result whose error on the second recording (mean, mm; of N-wires by PLUS's
    /// definition) is larger
    #[arg(long, value_name = "MM", default_value_t = 2.0, value_parser = values::positive)]
    pub(super) limit: f64,
    /// Put the result into the calibration file as a preset of that name, for the scanner's
    /// present depth, beside others [default: as the file's only one]
    #[arg(long, value_name = "NAME", requires = "output")]
    pub(super) preset: Option<String>,
    /// Length along the ruler beside the image, in pixels and in mm: the preset is refused later
    /// if the scanner is set to another depth
    #[arg(long, value_name = "PX,MM", value_parser = ruler, requires = "preset")]
    pub(super) ruler: Option<Ruler>,
    #[command(flatten)]
    pub(super) outputs: Outputs,
}

fn ruler(text: &str) -> Result<Ruler, String> {
    let numbers = text.split_once(',').and_then(|(px, mm)| Some((px.trim().parse().ok()?, mm.trim().parse().ok()?)));
    numbers.and_then(|(px, mm)| Ruler::new(px, mm)).ok_or_else(|| "must be two lengths above 0: pixels,mm".into())
}

/// A calibration, as the file keeps it.
pub(super) struct Made {
    pub(super) probe_from_image: Transform<Probe, Image>,
    pub(super) provenance: String,
    pub(super) size_px: [u32; 2],
    pub(super) quality: Quality,
    pub(super) covariance: Result<PlaneCovariance, CovarianceError>,
    pub(super) origin: Origin,
    pub(super) latency: Option<Latency>,
}

impl Arguments {
    /// Returns the calibration for the file, also as a preset if one was requested.
    ///
    /// # Errors
    /// [`Failure`] for a calibration that is too uncertain.
    pub(super) fn result(&self, made: Made) -> Result<ProbeResult, Failure> {
        let Made { probe_from_image, provenance, size_px, quality, covariance, origin, latency } = made;
        let covariance = covariance
            .map_err(|problem| Failure(format!("{}: the result is too uncertain: {problem}", self.path().display())))?;
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

    /// Returns the latencies for a lag and its standard deviation, s; `None` if no lag was
    /// sought (deviation 0).
    pub(super) fn lag(&self, recorded: &Recorded, [lag_s, sd_s]: [f64; 2]) -> Result<Option<Lag>, Failure> {
        let video_ms = recorded.bedside().map_or(0.0, |bedside| bedside.grabber.latency_ns as f64 * 1e-6);
        let known = || self.outputs.before();
        (sd_s > 0.0).then(|| Ok(Lag::new([lag_s, sd_s], video_ms, known()?.latency.as_ref()))).transpose()
    }

    /// Returns the recording's file.
    pub(super) fn path(&self) -> &Path {
        // The command line guarantees that one of them is present.
        let some = [&self.sequence, &self.session, &self.live].into_iter().flatten().next();
        some.map_or(Path::new(""), PathBuf::as_path)
    }

    /// Returns the second recording.
    pub(super) fn second(&self, first: &Recorded) -> Result<Option<Recorded>, Failure> {
        let second = self.validate.as_ref().map(|path| Recorded::of(path)).transpose()?;
        if second.as_ref().is_some_and(|second| second.bedside().is_some() != first.bedside().is_some()) {
            say("note: one recording is a sequence and the other a session; if their lags differ, the second one's \
                errors are too large");
        }
        Ok(second)
    }

    pub(super) fn recorded(&self, made: Option<&Path>) -> Result<Recorded, Failure> {
        match made.or(self.session.as_deref()) {
            Some(path) => Recorded::session(path),
            None => Ok(Recorded::Sequence(self.path().to_owned())),
        }
    }
}
