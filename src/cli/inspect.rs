//! `sonoweave inspect`: describes a sequence, session, volume or calibration file.

mod configuration;
mod histograms;
mod sequence;
pub(super) mod session;
mod sidecar;
pub(in crate::cli) mod text;
mod volume;

use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use config::Settings as Config;
use formats::Limits;
use formats::image::{Content, content};

use super::{Failure, FailureKind};
use crate::app::input;
use crate::app::json::JsonFlag;
use crate::app::reconstruct::zarr::is_ome_zarr;
use configuration::ConfigurationReport;
use sequence::SequenceReport;
use session::SessionReport;
use text::Text;
use volume::VolumeReport;

/// Bytes of a file that suffice to recognise its type.
const HEAD_BYTES: u64 = 4096;

/// Flags of `inspect`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
The command identifies a file by its content, not by its name. It reads only the header of a sequence, but the whole \
of a session.

Examples:
  sonoweave inspect sweep.igs.mha --config PlusConfiguration.xml
  sonoweave inspect sweep.igs.mha --config probe.toml --preset 4cm --sidecar sub-01_run-01_sweep.json
  sonoweave inspect SESSION-20261121-213000.mcap --json")]
pub struct Arguments {
    /// Tracked sequence or volume (.mha, .mhd, .nrrd, .nhdr, .nii, .nii.gz, .dcm, .ome.zarr),
    /// session (.mcap), our calibration TOML or a PLUS XML
    file: PathBuf,
    #[command(flatten)]
    json: JsonFlag,
    /// Place a sequence's images with this calibration: our TOML or a PLUS XML
    #[arg(short, long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Preset of the calibration file, for the scanner's depth
    #[arg(long, value_name = "NAME", requires = "config")]
    preset: Option<String>,
    /// Frame in which to place them [default: Reference if the sequence has one, else Tracker]
    #[arg(long, value_name = "NAME")]
    world: Option<String>,
    /// Write a sequence's facts for an archive: frames, rate, transforms, latencies, the
    /// calibration's hash and error; no name of a file
    #[arg(long, value_name = "FILE.json")]
    sidecar: Option<PathBuf>,
    /// Compare a volume, voxel by voxel, with this one on the same lattice; voxels of either's
    /// unseen value (0 if it notes none) do not count
    #[arg(long, value_name = "VOL.mha")]
    against: Option<PathBuf>,
    /// Volume's weights, as `reconstruct --weights` wrote them: 0 marks unseen voxels, −1 filled
    /// holes, and every value counts elsewhere
    #[arg(long, value_name = "FILE.mha")]
    weights: Option<PathBuf>,
}

/// The report; its fields are the JSON form, tagged by `kind`.
#[derive(Debug, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
enum Report {
    Sequence(Box<SequenceReport>),
    Session(Box<SessionReport>),
    Volume(Box<VolumeReport>),
    Configuration(Box<ConfigurationReport>),
}

/// Type of a file.
enum Kind {
    Sequence,
    Session,
    Volume,
    Configuration,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the file cannot be read or its type is unknown.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let inputs = [Some(&arguments.file), arguments.config.as_ref(), arguments.against.as_ref()];
    arguments.json.check(inputs.into_iter().flatten().map(PathBuf::as_path))?;
    let report = arguments.report()?;
    let mut text = Text::default();
    match &report {
        Report::Sequence(report) => report.write(&mut text),
        Report::Session(report) => report.write(&mut text),
        Report::Volume(report) => report.write(&mut text),
        Report::Configuration(report) => report.write(&mut text),
    }
    print_line!("{}", text.finish().trim_end_matches('\n'));
    arguments.json.write(&report)
}

impl Arguments {
    fn report(&self) -> Result<Report, Failure> {
        let path = &self.file;
        let kind = kind(path)?;
        let is_placed = self.config.is_some() || self.world.is_some() || self.sidecar.is_some();
        if !matches!(kind, Kind::Sequence) && is_placed {
            fail!(
                "{}: is not a sequence; leave out --config, --world and --sidecar, which are for sequences",
                path.display()
            );
        }
        let flag = self.against.as_ref().map(|_| "--against").or(self.weights.as_ref().map(|_| "--weights"));
        if let (false, Some(flag)) = (matches!(kind, Kind::Volume), flag) {
            fail!("{}: is no volume; leave out {flag}, which is for volumes", path.display());
        }
        Ok(match kind {
            Kind::Session => Report::Session(Box::new(SessionReport::read(path)?)),
            Kind::Sequence => {
                if let Some(sidecar) = &self.sidecar {
                    input::check_output(sidecar)?;
                    input::check_is_not(sidecar, path)?;
                }
                let config = self.config.as_deref().map(|path| Config::read(path, self.preset.as_deref()));
                let config = config.transpose()?;
                let report = SequenceReport::read(path, config.clone().unwrap_or_default(), self.world.as_deref())?;
                if let Some(sidecar) = &self.sidecar {
                    sidecar::write(sidecar, &report, self.config.as_deref().zip(config.as_ref()))?;
                }
                Report::Sequence(Box::new(report))
            }
            Kind::Volume => {
                Report::Volume(Box::new(VolumeReport::read(path, self.against.as_deref(), self.weights.as_deref())?))
            }
            Kind::Configuration => Report::Configuration(Box::new(ConfigurationReport::read(path)?)),
        })
    }
}

/// Recognises a file by its content.
fn kind(path: &Path) -> Result<Kind, Failure> {
    let failed = |e: std::io::Error| Failure::io(path, "reading", &e);
    if is_ome_zarr(path) {
        return Ok(Kind::Volume);
    }
    if std::fs::metadata(path).map_err(failed)?.is_dir() {
        fail!("{}: is a folder; give a file", path.display());
    }
    let mut head = Vec::new();
    File::open(path).map_err(failed)?.take(HEAD_BYTES).read_to_end(&mut head).map_err(failed)?;
    if input::is_session(path)? {
        return Ok(Kind::Session);
    }
    let text = String::from_utf8_lossy(&head);
    let text = text.trim_start_matches('\u{feff}').trim_start();
    let begins = |line: &str, key: &str| line.strip_prefix(key).is_some_and(|rest| rest.trim_start().starts_with('='));
    if text.starts_with('<') {
        return Ok(Kind::Configuration);
    }
    // The grammars of a MetaImage header and of our TOML's first lines overlap; the keys do not.
    let has = |keys: &[&str]| text.lines().map(str::trim).any(|line| keys.iter().any(|key| begins(line, key)));
    // NIfTI's first bytes in either byte order, and gzip's: only volumes are compressed whole.
    let nifti = [&b"\x5c\x01\0\0"[..], b"\0\0\x01\x5c", b"\x1f\x8b"].iter().any(|magic| head.starts_with(magic));
    let dicom = head.get(128..132) == Some(b"DICM");
    if nifti || dicom || text.starts_with("NRRD") || has(&["ObjectType", "NDims", "DimSize", "ElementType"]) {
        return Ok(match content(path, &Limits::default())? {
            Content::Sequence => Kind::Sequence,
            Content::Volume => Kind::Volume,
        });
    }
    if has(&["format", "version"]) {
        return Ok(Kind::Configuration);
    }
    if head.is_empty() {
        return Err(formats::Error::NoImage { path: path.to_owned(), source: formats::NoImage::Empty }.into());
    }
    Err(Failure::new(format!(
        "{}: is of no known kind: neither MetaImage (no ObjectType, NDims or DimSize in its first {} bytes), nor NRRD, \
        NIfTI, DICOM, a session, a configuration or calibration of sonoweave, nor XML; give one of these",
        path.display(),
        head.len()
    ))
    .of(FailureKind::Input))
}
