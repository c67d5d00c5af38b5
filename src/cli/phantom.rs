//! `sonoweave phantom`: a synthetic sweep whose truth is known.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use calibration::file::CalibrationFile;
use clap::{Args, ValueEnum};
use drivers::reading::{NamedTransform, PixelType, Stamp, Status};
use drivers::recording::metaimage::VolumeHeader;
use drivers::recording::metaimage::write::{SequenceHeader, SequenceItem, SequenceWriter, VolumeWriter};
use glam::DVec3;

use super::{Failure, input, values};
use crate::phantom::scan::{Depth, convex_fan};
use crate::phantom::scene::Blobs;
use crate::phantom::{Motion, Scan, ScanSettings, Scene, truth};
use crate::slice::Pixels;
use crate::volume::Grid;

/// Frames painted at once: enough for all cores, little enough for memory.
const BATCH: u32 = 8;

/// Flags of `phantom`.
#[derive(Debug, Args)]
#[command(after_help = "\
The sequence holds ImageToReference, so that `sonoweave reconstruct SEQ -o VOL` needs no calibration. With --calibration it holds what a \
tracker records instead, ProbeToTracker and ReferenceToTracker, and the probe's calibration is written to a file of its own. The same flags \
give the same bits on every machine.

Example: sonoweave phantom -o sweep.igs.mha --truth truth.mha --scene blobs --trajectory freehand --spacing 0.5")]
pub struct Arguments {
    /// Where to write the sweep, a tracked sequence (.igs.mha, .mha)
    #[arg(short, long, value_name = "SEQ.igs.mha")]
    output: PathBuf,
    /// Write the scene on the lattice that `reconstruct --spacing` uses, over the box that holds all pictures
    #[arg(long, value_name = "VOL.mha")]
    truth: Option<PathBuf>,
    /// Distance between the truth's voxels, mm
    #[arg(long, value_name = "MM[,MM,MM]", value_parser = values::spacing, default_value = "0.5")]
    spacing: DVec3,
    /// What lies in the world
    #[arg(long, value_enum, default_value_t)]
    scene: SceneName,
    /// Grey level of --scene constant
    #[arg(long, value_name = "GREY", default_value_t = 100.0)]
    grey: f64,
    /// How the probe moves
    #[arg(long, value_enum, default_value_t)]
    trajectory: TrajectoryName,
    /// Distance of the axis of --trajectory fan from the picture's middle, mm
    #[arg(long, value_name = "MM", default_value_t = 60.0)]
    axis_distance: f64,
    /// Number of pictures
    #[arg(long, value_name = "N", default_value_t = 120)]
    frames: u32,
    /// Mean distance between neighbouring pictures, mm
    #[arg(long, value_name = "MM", default_value_t = 0.35)]
    gap: f64,
    /// Pictures a second
    #[arg(long, value_name = "HZ", default_value_t = 30.0)]
    rate: f64,
    /// Size of a picture, pixels
    #[arg(long, value_name = "WxH", value_parser = values::picture_size, default_value = "512x480")]
    image_size: PictureSize,
    /// Size of a pixel, mm
    #[arg(long, value_name = "MM", default_value_t = 0.1)]
    pixel: f64,
    /// Show the sector of a convex probe; the rest of the picture is black and no data
    #[arg(long)]
    fan: bool,
    /// Standard deviation of the noise, grey levels
    #[arg(long, value_name = "SD", default_value_t = 6.0)]
    noise: f64,
    /// Seed of the blobs, the hand's walk and the noise
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Scalar type of the pictures
    #[arg(long = "type", value_enum, value_name = "TYPE", default_value_t)]
    scalar: ScalarName,
    /// Compress the pictures (zlib)
    #[arg(long)]
    compress: bool,
    /// Write the probe's calibration here, and into the sequence what a tracker records
    #[arg(long, value_name = "FILE.toml")]
    calibration: Option<PathBuf>,
}

// A named type is a single value to clap.
type PictureSize = [u32; 2];

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum SceneName {
    /// The same grey level everywhere
    Constant,
    /// Linear along every axis
    Ramp,
    /// 60 Gaussian blobs and a soft sphere
    #[default]
    Blobs,
    /// A hard sphere of 10 mm radius in the middle
    Sphere,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum TrajectoryName {
    /// Equal steps along the plane's normal
    Parallel,
    /// Equal tilts about an axis above the picture
    Fan,
    /// By hand: wandering, tilting, at uneven speed
    #[default]
    Freehand,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum ScalarName {
    /// 8 bit unsigned
    #[default]
    U8,
    /// Single precision
    F32,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`]: nothing was written then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.check_outputs()?;
    let scan = Scan::new(arguments.settings()?)?;
    // The grid may be refused: before the painting, not after it.
    let grid = match &arguments.truth {
        Some(_) => Some(scan.grid(arguments.spacing, 0.0)?),
        None => None,
    };
    let sequence = arguments.write_pictures(&scan)?;
    let volume = match (&arguments.truth, &grid) {
        (Some(path), Some(grid)) => Some(arguments.write_truth(&scan, grid, path)?),
        _ => None,
    };
    // All that can take long or fail for lack of room is behind: the files take their names together.
    sequence.finish()?;
    if let Some(volume) = volume {
        volume.finish()?;
    }
    if let Some(path) = &arguments.calibration {
        let provenance = format!("simulated: {}", arguments.describe());
        let file = CalibrationFile {
            provenance,
            probe_from_image: Some(scan.probe_from_image()),
            fan: scan.settings().fan,
            ..CalibrationFile::default()
        };
        file.write(path)?;
    }
    report(arguments, grid.as_ref());
    Ok(())
}

impl Arguments {
    fn settings(&self) -> Result<ScanSettings, Failure> {
        if !(self.rate.is_finite() && (1e-3..=1e6).contains(&self.rate)) {
            return Err(Failure(format!("--rate {}: must lie between 0.001 and 1000000 pictures a second", self.rate)));
        }
        if !self.grey.is_finite() {
            return Err(Failure(format!("--grey {}: must be finite", self.grey)));
        }
        Ok(ScanSettings {
            scene: match self.scene {
                SceneName::Constant => Scene::Constant(self.grey),
                SceneName::Ramp => Scene::standard_ramp(),
                SceneName::Blobs => Scene::Blobs(Blobs::draw(self.seed)),
                SceneName::Sphere => Scene::standard_sphere(),
            },
            motion: match self.trajectory {
                TrajectoryName::Parallel => Motion::Parallel,
                TrajectoryName::Fan => Motion::Fan { axis_distance_mm: self.axis_distance },
                TrajectoryName::Freehand => Motion::Freehand,
            },
            frames: self.frames,
            gap_mm: self.gap,
            image_size: self.image_size,
            pixel_mm: [self.pixel; 2],
            noise_sd: self.noise,
            depth: match self.scalar {
                ScalarName::U8 => Depth::U8,
                ScalarName::F32 => Depth::F32,
            },
            fan: if self.fan {
                Some(convex_fan(self.image_size).map_err(|e| Failure(format!("--fan: {e}")))?)
            } else {
                None
            },
            seed: self.seed,
            first_ns: 0,
            interval_ns: (1e9 / self.rate).round() as i64,
        })
    }

    /// All outputs can be written, their names tell MetaImage files, and no two are the same.
    fn check_outputs(&self) -> Result<(), Failure> {
        let outputs: Vec<&PathBuf> =
            [Some(&self.output), self.truth.as_ref(), self.calibration.as_ref()].into_iter().flatten().collect();
        for (n, path) in outputs.iter().enumerate() {
            input::check_output(path)?;
            if outputs[..n].contains(path) {
                return Err(Failure(format!("{}: is named for two outputs; give another name", path.display())));
            }
        }
        for (path, what) in [(Some(&self.output), "sequences"), (self.truth.as_ref(), "volumes")] {
            if let Some(path) = path
                && path.extension().is_none_or(|e| !e.eq_ignore_ascii_case("mha"))
            {
                return Err(Failure(format!("{}: {what} are written as .mha; give such a name", path.display())));
            }
        }
        Ok(())
    }

    /// What determines the bits, for people.
    fn describe(&self) -> String {
        let name =
            |value: Option<clap::builder::PossibleValue>| value.map_or(String::new(), |v| v.get_name().to_owned());
        let scene = name(self.scene.to_possible_value());
        format!(
            "scene {}, trajectory {}, {} frames, gap {} mm, {}x{} pixels of {} mm{}, noise {}, seed {}",
            if self.scene == SceneName::Constant { format!("{scene} {}", self.grey) } else { scene },
            name(self.trajectory.to_possible_value()),
            self.frames,
            self.gap,
            self.image_size[0],
            self.image_size[1],
            self.pixel,
            if self.fan { " in a fan" } else { "" },
            self.noise,
            self.seed,
        )
    }

    /// Paints and writes all pictures; the file has its name only when the writer is finished.
    fn write_pictures(&self, scan: &Scan) -> Result<SequenceWriter, Failure> {
        let header = SequenceHeader {
            size: self.image_size,
            pixel: match self.scalar {
                ScalarName::U8 => PixelType::U8,
                ScalarName::F32 => PixelType::F32,
            },
            channels: 1,
            orientation: "MFA".into(),
            image_type: "BRIGHTNESS".into(),
            compressed: self.compress,
            fields: self.provenance(),
            items: (0..scan.frames()).map(|frame| self.item(scan, frame)).collect(),
        };
        let mut writer = SequenceWriter::create(&self.output, &header)?;
        let bar = input::progress("painting", u64::from(scan.frames()));
        for first in (0..scan.frames()).step_by(BATCH as usize) {
            let batch = scan.slices(first..scan.frames().min(first + BATCH));
            for slice in &batch {
                match slice.image.pixels() {
                    Pixels::U8(pixels) => writer.write_frame(pixels)?,
                    Pixels::U16(pixels) => writer.write_frame(bytemuck::cast_slice(pixels))?,
                    Pixels::F32(pixels) => writer.write_frame(bytemuck::cast_slice(pixels))?,
                }
            }
            bar.inc(batch.len() as u64);
        }
        bar.finish_and_clear();
        Ok(writer)
    }

    fn item(&self, scan: &Scan, frame: u32) -> SequenceItem {
        let tracked = scan.tracked(frame);
        let stamp = Stamp { item: u64::from(frame), source_s: Some(tracked.timestamp_s), ..Stamp::default() };
        let transform = |from: &str, to: &str, matrix| NamedTransform {
            stamp,
            from: from.into(),
            to: to.into(),
            matrix,
            status: Status::Ok,
        };
        let transforms = if self.calibration.is_some() {
            vec![
                transform("Probe", "Tracker", tracked.probe_to_tracker),
                transform("Reference", "Tracker", tracked.reference_to_tracker),
            ]
        } else {
            vec![transform("Image", "Reference", tracked.image_to_reference)]
        };
        SequenceItem { stamp, frame_number: Some(u64::from(frame)), status: Status::Ok, transforms, fields: Vec::new() }
    }

    /// Writes the scene's voxels; the file has its name only when the writer is finished.
    fn write_truth(&self, scan: &Scan, grid: &Grid, path: &Path) -> Result<VolumeWriter, Failure> {
        let voxels = truth::sample(&scan.settings().scene, grid)?;
        let mut size = [0; 3];
        for (to, from) in size.iter_mut().zip(grid.size) {
            *to = u32::try_from(from)?;
        }
        let mut fields = self.provenance();
        fields.push(("SonoweaveFrame".into(), "Reference (mm, not anatomical)".into()));
        let header = VolumeHeader {
            spacing: grid.spacing.to_array(),
            origin: grid.origin.to_array(),
            fields,
            ..VolumeHeader::new(size, PixelType::F32)
        };
        let mut writer = VolumeWriter::create(path, &header)?;
        writer
            .write_all(bytemuck::cast_slice(&voxels))
            .map_err(|e| Failure(format!("{}: writing the truth failed: {e}", path.display())))?;
        Ok(writer)
    }

    fn provenance(&self) -> Vec<(String, String)> {
        vec![
            ("SonoweaveVersion".into(), env!("CARGO_PKG_VERSION").into()),
            ("SonoweavePhantom".into(), self.describe()),
        ]
    }
}

/// What was made, on stdout.
#[allow(clippy::print_stdout, reason = "the command's output")]
fn report(arguments: &Arguments, grid: Option<&Grid>) {
    println!("{}: {}", arguments.output.display(), arguments.describe());
    if let (Some(path), Some(grid)) = (&arguments.truth, grid) {
        let [nx, ny, nz] = grid.size;
        let [sx, sy, sz] = grid.spacing.to_array();
        println!("{}: its truth, {nx}×{ny}×{nz} voxels of {sx}×{sy}×{sz} mm", path.display());
    }
    if let Some(path) = &arguments.calibration {
        println!("{}: the probe's calibration; give it to `reconstruct` with --config", path.display());
    }
}
