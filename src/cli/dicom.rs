//! `sonoweave dicom`: converts a sweep or a volume to DICOM, for a picture archive.

pub(super) mod flags;

use std::path::{Path, PathBuf};

use clap::Args;
use glam::DVec3;
use serde::Serialize;

use config::Settings as Config;
use drivers::OpenSettings;
use drivers::replay::SequenceSettings;
use export::ExportError;
use export::dicom::Identifiers;
use export::dicom::sweep::{Sweep, SweepFrame};
use export::dicom::volume::VolumeImage;
use export::volume::Scalar;
use formats::Limits;
use formats::image::{Content, content};
use sonoweave_core::reading::{NamedTransform, PixelType, Status};
use sonoweave_core::slice::Pixels;
use sonoweave_core::{Next, Reading};
use sync::Survey;
use sync::graph::Edge;
use sync::ingest::{Ingest, Picture, Sample};
use sync::survey;
use sync::survey::SurveyError;
use volume::dense::UNSEEN_FIELD;
use volume::{DenseVolume, Values};

use super::{Failure, values};
use crate::app::convert::identity;
use crate::app::input;
use crate::app::json::JsonFlag;
use crate::app::reconstruct::filling::advised;
use crate::app::volume_input::{FRAME_FIELD, INPUT_FIELD, field};
use flags::DicomFlags;

/// Flags of `dicom`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
A sweep becomes an ultrasound multi-frame image (8 bits), with the frames' times and with poses in private elements, \
from which all commands read it back as a sequence. Its pixel size comes from the calibration, if given. A volume becomes an enhanced ultrasound volume (8 or 16 bits), \
with the position of each plane. Unseen voxels keep their value. Files from one recording with the same identifiers \
belong to one study. The same input gives the same bytes.

Examples:
  sonoweave dicom sweep.igs.mha -o sweep.dcm --config PlusConfiguration.xml --patient-id 4711
  sonoweave dicom volume.mha -o volume.dcm --patient-id 4711")]
pub struct Arguments {
    /// Tracked sequence or volume (.igs.mha, .mha)
    input: PathBuf,
    /// Write the image to this file (.dcm)
    #[arg(short, long, value_name = "IMG.dcm")]
    output: PathBuf,
    #[command(flatten)]
    json: JsonFlag,
    /// Place a sequence's images with this calibration: our TOML or a PLUS XML
    #[arg(short, long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Frame in which to place them [default: Reference if the sequence has one, else Tracker]
    #[arg(long, value_name = "NAME")]
    world: Option<String>,
    /// Frames of a sequence to write: from A up to, but not including, B
    #[arg(long, value_name = "A..B", value_parser = values::frames)]
    frames: Option<FrameRange>,
    /// Memory limit for a volume, GiB
    #[arg(long, value_name = "GIB", default_value_t = 8.0)]
    max_memory: f64,
    #[command(flatten)]
    identifiers: DicomFlags,
}

// clap takes an array for its own notation of repeated values; named types are single values to
// it.
type FrameRange = std::ops::Range<u64>;

/// A written image.
#[derive(Debug, Serialize)]
struct Report<'a> {
    input: &'a Path,
    output: &'a Path,
    /// Content of the image, in words.
    content: &'a str,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`]: nothing was written then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let identifiers = arguments.identifiers.identifiers();
    identifiers.check()?;
    let Arguments { input, output, .. } = arguments;
    input::check_output(output)?;
    input::check_is_not(output, input)?;
    arguments.json.check([input.as_path()])?;
    if !input::is_dicom(output) {
        fail!("{}: is not a name of a DICOM file; give a name that ends in .dcm", output.display());
    }
    let summary = match content(input, &Limits::default())? {
        Content::Sequence => write_sweep(arguments, &identifiers)?,
        Content::Volume => write_volume(arguments, &identifiers)?,
    };
    print_line!("{}: {summary}", output.display());
    arguments.json.write(&Report { input, output, content: &summary })
}

fn write_volume(arguments: &Arguments, identifiers: &Identifiers) -> Result<String, Failure> {
    let Arguments { input, output, config, world, frames, max_memory, .. } = arguments;
    if config.is_some() || world.is_some() || frames.is_some() {
        fail!("{}: is a volume; leave out --config, --world and --frames, which are for sequences", input.display());
    }
    let most = max_memory * f64::from(1 << 30);
    if !(most > 0.0 && most.is_finite()) {
        fail_usage!("--max-memory {max_memory}: must be a positive number of GiB");
    }
    let volume = DenseVolume::open(input, None, most as u64)?;
    let header = volume.header();
    let scalar = match header.pixel {
        PixelType::U8 => Scalar::U8,
        PixelType::U16 => Scalar::U16,
        other => {
            fail!(
                "{}: has voxels of {other:?}, but DICOM's ultrasound volumes have 8 or 16 bit unsigned ones; \
                reconstruct with --type u8 or u16 and --window",
                input.display()
            );
        }
    };
    let unseen = field(&header.fields, UNSEEN_FIELD).and_then(|text| text.parse().ok()).unwrap_or(0.0_f32);
    let unseen = unseen.clamp(0.0, scalar.top());
    // Uses the recording's hash, so that the volume belongs to its study; else the file's own.
    let recording = match field(&header.fields, INPUT_FIELD).and_then(|text| text.rsplit_once(" sha256 ")) {
        Some((_, hash)) => hash.to_owned(),
        None => input::hash(input)?,
    };
    let world =
        field(&header.fields, FRAME_FIELD).and_then(|text| text.split_once(" (")).map_or("World", |(name, _)| name);
    let grid = volume.grid();
    let fields = &identity::numeric(&header.fields);
    let image = VolumeImage { grid: &grid, scalar, unseen, recording: &recording, world, fields, identifiers };
    let mut weights = vec![0.0; grid.size[0] as usize];
    let written = image.write(output, |y, z, row| {
        volume.values(volume.index([0, y as i64, z as i64]), row, &mut weights);
        for (value, weight) in row.iter_mut().zip(&weights) {
            if *weight <= 0.0 {
                *value = unseen;
            }
        }
    });
    written.map_err(advised)?;
    let [nx, ny, nz] = grid.size;
    Ok(format!("{nx}×{ny}×{nz} voxels of {}, an enhanced ultrasound volume", scalar.name()))
}

fn write_sweep(arguments: &Arguments, identifiers: &Identifiers) -> Result<String, Failure> {
    let Arguments { input, output, .. } = arguments;
    let within = |problem: String| Failure::new(format!("{}: {problem}", input.display()));
    let frames = arguments.frames.clone().unwrap_or(0..u64::MAX);
    let config = arguments.config.as_deref().map(|path| Config::read(path, None)).transpose()?.unwrap_or_default();
    let options = config.pairing_options(arguments.world.as_deref());
    let open =
        |images| drivers::open(&OpenSettings::Sequence(SequenceSettings { images, ..SequenceSettings::new(input) }));
    let placed = match survey(open(false)?.as_mut(), &options, None) {
        Ok(survey) => Some(survey),
        // Without a way to the world, it is a sweep without poses, unless poses were requested.
        Err(SurveyError::NoPath(_)) if arguments.config.is_none() && arguments.world.is_none() => None,
        Err(error) => return Err(within(error.to_string())),
    };
    let mut sweep = Frames::new(placed.as_ref());
    let mut device = open(true)?;
    let mut ingest = Ingest::new();
    device.start()?;
    loop {
        match device.next(sonoweave_core::NO_DEADLINE)? {
            Next::Reading(reading) => {
                let number = if let Reading::Frame(frame) = &reading { frame.frame_number } else { None };
                match ingest.take(reading) {
                    Sample::Picture(picture) if frames.contains(&picture.head.stamp.item) => {
                        sweep.add(&picture, number).map_err(|e| within(e.0.sentence))?;
                    }
                    Sample::Refused(refusal) if frames.contains(&refusal.item) => {
                        return Err(within(refusal.to_string()));
                    }
                    Sample::Transform(transform) => sweep.transform(&transform),
                    _ => {}
                }
            }
            Next::Pending => {}
            Next::End => break,
        }
    }
    device.stop()?;
    sweep.write(output, &input::hash(input)?, identifiers).map_err(|e| within(e.0.sentence))
}

/// Adds the flag that helps to the error of a sweep's export.
fn shorter(error: ExportError) -> Failure {
    let flag = if matches!(error, ExportError::DicomTooLarge { .. }) { ": --frames A..B" } else { "" };
    Failure::new(format!("{error}{flag}"))
}

/// Frames of a sweep, in order.
struct Frames<'a> {
    /// Poses of the frames, if the sequence leads to a world.
    placed: Option<&'a Survey>,
    size: [u32; 2],
    frames: Vec<SweepFrame>,
    pixels: Vec<u8>,
    /// Frame of the last transform that the source declared invalid, and its word.
    invalid: Option<(u64, String)>,
}

impl<'a> Frames<'a> {
    fn new(placed: Option<&'a Survey>) -> Self {
        Self { placed, size: [0, 0], frames: Vec::new(), pixels: Vec::new(), invalid: None }
    }

    /// Notes a transform on the way from the image to the world, if its source declared it invalid.
    fn transform(&mut self, transform: &NamedTransform) {
        let Some(survey) = self.placed else { return };
        let is_on_way = survey.route.steps.iter().any(|step| match step.edge {
            Edge::PerFrame(at) => survey.names[at].0 == transform.from && survey.names[at].1 == transform.to,
            Edge::Static(_) => false,
        });
        if let (true, Status::Other(word)) = (is_on_way, &transform.status) {
            self.invalid = Some((transform.stamp.item, word.to_string()));
        }
    }

    /// Returns a frame's pose; a word if it has none.
    fn pose(&self, item: u64) -> Result<[f64; 16], String> {
        let poses = self.placed.map_or(&[][..], |survey| &survey.poses);
        if let Ok(at) = poses.binary_search_by_key(&item, |pose| pose.item) {
            return Ok(glam::DMat4::from(poses[at].world_from_image.affine()).transpose().to_cols_array());
        }
        let invalid = self.invalid.as_ref().filter(|(of, _)| *of == item);
        Err(invalid.map_or_else(|| "MISSING".to_owned(), |(_, word)| word.clone()))
    }

    fn add(&mut self, picture: &Picture, number: Option<u64>) -> Result<(), Failure> {
        let (image, stamp) = (&picture.image, picture.head.stamp);
        let item = stamp.item;
        let Pixels::U8(pixels) = image.pixels() else {
            fail!(
                "item {item}: has pixels of more than 8 bits, which DICOM's multi-frame ultrasound does not allow; give a recording of 8 bits"
            );
        };
        let size = [image.width(), image.height()];
        if self.frames.is_empty() {
            self.size = size;
        } else if self.size != size {
            fail!(
                "item {item}: has {size:?} pixels, but the first frame has {:?}; choose frames of one size by --frames",
                self.size
            );
        }
        // Checks the size before memory is allocated.
        Sweep::bytes(self.frames.len() as u64 + 1, size).map_err(shorter)?;
        let frame = SweepFrame { time_ns: picture.head.time_ns, stamp, number, pose: self.pose(item) };
        self.frames.push(frame);
        self.pixels.extend_from_slice(pixels);
        Ok(())
    }

    fn write(&self, output: &Path, recording: &str, identifiers: &Identifiers) -> Result<String, Failure> {
        let pixel_mm = self
            .placed
            .and_then(|survey| survey.poses.first())
            .map(|pose| [DVec3::X, DVec3::Y].map(|axis| pose.world_from_image.vector(axis).length()));
        let sweep = Sweep {
            size: self.size,
            pixels: &self.pixels,
            frames: &self.frames,
            pixel_mm,
            recording,
            world: self.placed.map_or("", |survey| survey.route.world()),
            identifiers,
        };
        sweep.write(output).map_err(shorter)?;
        let [width, height] = self.size;
        let place = self.placed.map_or_else(
            || "without poses".to_owned(),
            |survey| {
                let known = self.frames.iter().filter(|frame| frame.pose.is_ok()).count();
                format!("{known} of them placed in {}", survey.route.world())
            },
        );
        let count = self.frames.len();
        Ok(format!("{count} frames of {width}×{height} pixels, {place}, an ultrasound multi-frame image"))
    }
}
