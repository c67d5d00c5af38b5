//! `sonoweave phantom`: makes a synthetic sweep with known ground truth.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use clap::{ArgGroup, Args, ValueEnum as _};
use glam::DVec3;
use serde::Serialize;

use calibration::file::CalibrationFile;
use formats::image::write::{SequenceHeader, SequenceItem, SequenceWriter, VolumeWriter};
use formats::image::{Container, VolumeHeader};
use formats::whole::write_whole;
use sonoweave_core::reading::{NamedTransform, PixelType, Stamp, Status};

pub(super) mod choices;
mod echoes;

use choices::{ScalarName, direction, frequency, tracker_noise};

use super::progress::progress;
use super::{Failure, values};
use crate::app::input;
use crate::app::json::JsonFlag;
use phantom::named::{AXIS_DISTANCE_MM, DWELL, MotionOptions, RADIUS_MM, SceneName, SceneOptions, TrajectoryName};
use phantom::scan::{Depth, convex_fan};
use phantom::scene::Speckle;
use phantom::{EffectiveKernel, Scan, ScanSettings, TrackerNoise, blur, truth};
use sonoweave_core::slice::Pixels;
use volume::Grid;

/// Frames rendered at once: enough for all cores, few enough for memory.
const BATCH: u32 = 8;

/// Flags of `phantom`.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("truths").multiple(true)), after_long_help = "\
The sequence holds ImageToReference, so that `sonoweave reconstruct SEQ -o VOL` needs no calibration. With \
--calibration it holds what a tracker records instead, ProbeToTracker and ReferenceToTracker, and the probe's \
calibration is written to a file of its own. The same flags give the same bits on every machine.

A reconstruction is the scene blurred by its kernel, so even a perfect one differs from --truth. A kernel as wide as \
the scanner's own blur widens the result by √2. --truth-blurred is the scene blurred by the kernel of `reconstruct \
--spacing`, turned with the frames, or by that of --sigma. Its difference from a reconstruction is the \
reconstruction's own error. To undersample a sweep twice, double --gap and halve --frames.

Dolls, thighs, wires, floors and styli are bodies for a simulated ultrasound scanner, and their truth is the mean \
echo. Pixels outside the scanner's field are black and no data. The sequence contains the fan or the clip, and \
--calibration writes it for `reconstruct --config`.

Example: sonoweave phantom -o sweep.igs.mha --truth truth.mha --scene blobs --trajectory freehand --spacing 0.5")]
pub struct Arguments {
    /// Write the sweep to this file, a tracked sequence (.mha, .mhd, .nrrd, .nhdr)
    #[arg(short, long, value_name = "SEQ.igs.mha")]
    output: PathBuf,
    #[command(flatten)]
    json: JsonFlag,
    /// Write the scene on the lattice that `reconstruct --spacing` uses, over the box around all
    /// images
    #[arg(long, value_name = "VOL.mha", group = "truths")]
    truth: Option<PathBuf>,
    /// Write the scene under the reconstruction's kernel on the same lattice
    #[arg(long, value_name = "VOL.mha", group = "truths")]
    truth_blurred: Option<PathBuf>,
    /// Effective σ of the kernel of --truth-blurred along u, v and the image's normal, mm
    /// [default: those of `reconstruct` at this --spacing and --pixel; its statistics show
    /// others]
    #[arg(long, value_name = "SU,SV,SN", value_parser = values::lengths, requires = "truth_blurred")]
    sigma: Option<[f64; 3]>,
    /// Time of the truths of a moving scene, s [default: the last image's time]
    #[arg(long, value_name = "S", requires = "truths", allow_hyphen_values = true)]
    truth_time: Option<f64>,
    /// Distance between the truths' voxels, mm
    #[arg(long, value_name = "MM[,MM,MM]", value_parser = values::spacing, default_value = "0.5")]
    spacing: DVec3,
    /// Scene to scan
    #[arg(long, value_enum, default_value_t)]
    scene: SceneName,
    /// Grey value of --scene constant
    #[arg(long, value_name = "GREY", default_value_t = 100.0, allow_hyphen_values = true)]
    grey: f64,
    /// Normal of --scene plane and sheet, of any length
    #[arg(long, value_name = "X,Y,Z", value_parser = direction, default_value = "1,2,3", allow_hyphen_values = true)]
    normal: DVec3,
    /// Frequency of a single wave for --scene sinusoid, cycles per mm along x, y and z [default:
    /// one of 0.25 along each axis]
    #[arg(long, value_name = "FX,FY,FZ", value_parser = frequency, allow_hyphen_values = true)]
    frequency: Option<DVec3>,
    /// Distance at which the correlation of --scene speckle has fallen to a half, mm
    #[arg(long, value_name = "MM", default_value_t = Speckle::STANDARD_PITCH_MM)]
    grain: f64,
    /// Motion of the probe
    #[arg(long, value_enum, default_value_t)]
    trajectory: TrajectoryName,
    /// Distance of the axis of --trajectory fan from the image's centre, mm
    #[arg(long, value_name = "MM", default_value_t = AXIS_DISTANCE_MM)]
    axis_distance: f64,
    /// Distance from the axis of --trajectory rotation at which neighbouring images lie the gap
    /// apart, mm
    #[arg(long, value_name = "MM", default_value_t = RADIUS_MM)]
    radius: f64,
    /// Number of images in the pause of --trajectory dwell
    #[arg(long, value_name = "N", default_value_t = DWELL)]
    dwell: u32,
    /// Standard deviations of the recorded poses' errors: position along each axis, mm, and
    /// rotation about each, degrees
    #[arg(long, value_name = "MM,DEG", value_parser = tracker_noise, default_value = "0,0")]
    tracker_noise: TrackerNoise,
    /// Number of images
    #[arg(long, value_name = "N", default_value_t = 120)]
    frames: u32,
    /// Mean distance between neighbouring images of a moving probe, mm [default: 0.35; for a
    /// body, enough to see all of it; for --trajectory about, 1]
    #[arg(long, value_name = "MM")]
    gap: Option<f64>,
    /// Images a second
    #[arg(long, value_name = "HZ", default_value_t = 30.0)]
    rate: f64,
    /// Size of an image, pixels
    #[arg(long, value_name = "WxH", value_parser = values::picture_size, default_value = "512x480")]
    image_size: PictureSize,
    /// Size of a pixel, mm [default: 0.1; for a body, enough to show the scanner's whole field]
    #[arg(long, value_name = "MM")]
    pixel: Option<f64>,
    /// Show the sector of a convex probe; the rest of the image is black and no data
    #[arg(long)]
    fan: bool,
    /// Standard deviation of the noise, grey values [default: 6; for a body 0, because its
    /// scanner has noise of its own]
    #[arg(long, value_name = "SD")]
    noise: Option<f64>,
    /// Seed of the blobs, the speckle, the probe's walk and all noise
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Scalar type of the images
    #[arg(long = "type", value_enum, value_name = "TYPE", default_value_t)]
    scalar: ScalarName,
    /// Compress the images (zlib)
    #[arg(long)]
    compress: bool,
    /// Write the probe's calibration to this file, and the tracker's raw transforms into the
    /// sequence
    #[arg(long, value_name = "FILE.toml")]
    calibration: Option<PathBuf>,
    /// Write the intersections of a body's wires with each image, and the positions of its
    /// landmarks, as CSV
    #[arg(long, value_name = "FILE.csv")]
    crossings: Option<PathBuf>,
    /// Write a body's wires and landmarks, and its pose, as `calibrate` takes them
    #[arg(long, value_name = "FILE.toml")]
    phantom: Option<PathBuf>,
    #[command(flatten)]
    echoes: echoes::EchoFlags,
}

// clap treats a named type as a single value.
type PictureSize = [u32; 2];

/// Runs the command.
///
/// # Errors
/// [`Failure`]: nothing was written then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.check_outputs()?;
    let scan = Scan::new(arguments.settings()?)?;
    let time_ns = arguments.truth_time_ns(&scan)?;
    // The grid and the kernel may be refused; check them before rendering.
    let grid = match (&arguments.truth, &arguments.truth_blurred) {
        (None, None) => None,
        _ => Some(scan.grid(arguments.spacing, 0.0)?),
    };
    let kernel = arguments.kernel(&scan)?;
    let phantom = arguments.phantom.as_ref().map(|path| Ok::<_, Failure>((path, echoes::held(&scan)?))).transpose()?;
    let sequence = arguments.write_pictures(&scan)?;
    let mut volumes = Vec::new();
    if let (Some(path), Some(grid)) = (&arguments.truth, &grid) {
        let voxels = truth::sample(&scan.settings().scene.at_time(time_ns), grid)?;
        volumes.push(arguments.write_truth(&scan, time_ns, None, &voxels, grid, path)?);
    }
    if let (Some(path), Some(grid)) = (&arguments.truth_blurred, &grid) {
        let voxels = blur::sample_under(&scan, &kernel, grid, time_ns)?;
        volumes.push(arguments.write_truth(&scan, time_ns, Some(&kernel), &voxels, grid, path)?);
    }
    // All slow or failing steps are done: now the files get their names together.
    sequence.finish()?;
    for volume in volumes {
        volume.finish()?;
    }
    if let Some(path) = &arguments.calibration {
        let provenance = format!("simulated: {}", arguments.describe(&scan));
        let file = CalibrationFile {
            provenance,
            probe_from_image: Some(scan.probe_from_image()),
            fan: scan.settings().fan,
            clip: scan.bmode().and_then(|bmode| bmode.layout().clip()),
            ..CalibrationFile::default()
        };
        file.write(path)?;
    }
    if let Some(path) = &arguments.crossings {
        write_whole(path, |to| to.write_all(echoes::crossings(&scan).as_bytes()))
            .map_err(|e| Failure::io(path, "writing the crossings", &e))?;
    }
    if let Some((path, phantom)) = phantom {
        write_whole(path, |to| to.write_all(phantom.to_text().as_bytes()))
            .map_err(|e| Failure::io(path, "writing the phantom", &e))?;
    }
    report(arguments, &scan, grid.as_ref(), &kernel);
    arguments.json.write(&Report {
        output: &arguments.output,
        content: arguments.describe(&scan),
        truth_size: grid.as_ref().map(|grid| grid.size),
        sigma_effective_mm: kernel.sigma_mm(),
    })
}

impl Arguments {
    fn settings(&self) -> Result<ScanSettings, Failure> {
        if !(self.rate.is_finite() && (1e-3..=1e6).contains(&self.rate)) {
            fail_usage!("--rate {}: must lie between 0.001 and 1000000 pictures a second", self.rate);
        }
        if !self.grey.is_finite() {
            fail_usage!("--grey {}: must be finite", self.grey);
        }
        if !(self.grain.is_finite() && self.grain > 0.0) {
            fail_usage!("--grain {}: must be a positive, finite length in mm", self.grain);
        }
        let options = SceneOptions {
            grey: self.grey,
            normal: self.normal,
            frequency: self.frequency,
            grain_mm: self.grain,
            ..SceneOptions::new(self.seed)
        };
        let shown = self.echoes.content(self.scene, options);
        if shown.scanned().is_none() && (self.echoes.given() || self.crossings.is_some() || self.phantom.is_some()) {
            fail_usage!(
                "--probe, --depth, --mhz, --focus, --tgc, --dynamic-range, --without, --crossings and --phantom need a \
                simulated scanner; leave them out, or give --scene doll, thigh, n-wire, cross-wire, tank-floor or \
                stylus"
            );
        }
        let scanner = shown.scanned().map(|scanned| scanned.scanner);
        if let Some(scanner) = scanner {
            scanner.check()?;
        }
        let pixel = self.pixel.unwrap_or_else(|| shown.usual_pixel_mm(self.image_size));
        let gap = self.gap.unwrap_or_else(|| self.trajectory.usual_gap_mm(&shown, self.frames));
        let noise = self.noise.unwrap_or_else(|| shown.usual_noise_sd());
        let scene = shown.placed(self.image_size, pixel)?;
        let options = MotionOptions { axis_distance_mm: self.axis_distance, radius_mm: self.radius, dwell: self.dwell };
        Ok(ScanSettings {
            motion: self.trajectory.motion(&options, &scene),
            scene,
            frames: self.frames,
            gap_mm: gap,
            image_size: self.image_size,
            pixel_mm: [pixel; 2],
            noise_sd: noise,
            depth: match self.scalar {
                ScalarName::U8 => Depth::U8,
                ScalarName::F32 => Depth::F32,
            },
            fan: if self.fan {
                Some(convex_fan(self.image_size).map_err(|e| Failure::usage(format!("--fan: {e}")))?)
            } else {
                None
            },
            scanner,
            tracker_noise: self.tracker_noise,
            seed: self.seed,
            first_ns: 0,
            interval_ns: (1e9 / self.rate).round() as i64,
        })
    }

    /// Returns the time of the truths, ns.
    fn truth_time_ns(&self, scan: &Scan) -> Result<i64, Failure> {
        match self.truth_time {
            None => Ok(scan.time_ns(scan.frames() - 1)),
            // Thirty years either way: whole nanoseconds that fit.
            Some(s) if s.abs() <= 1e9 => Ok((s * 1e9).round() as i64),
            Some(s) => Err(Failure::usage(format!("--truth-time {s}: must be a time in seconds between -1e9 and 1e9"))),
        }
    }

    /// Returns the kernel of the blurred truth.
    fn kernel(&self, scan: &Scan) -> Result<EffectiveKernel, Failure> {
        Ok(match self.sigma {
            Some(sigma) => EffectiveKernel::new(sigma)?,
            None => EffectiveKernel::of_defaults(self.spacing, scan.settings().pixel_mm)?,
        })
    }

    /// Checks that all outputs can be written, that their names have known formats, and that no
    /// two are the same.
    fn check_outputs(&self) -> Result<(), Failure> {
        let others = [&self.truth, &self.truth_blurred, &self.calibration, &self.crossings, &self.phantom];
        let outputs: Vec<&PathBuf> =
            std::iter::once(&self.output).chain(others.into_iter().filter_map(Option::as_ref)).collect();
        for (n, path) in outputs.iter().enumerate() {
            input::check_output(path)?;
            if outputs[..n].contains(path) {
                fail!("{}: is the name of two outputs; give another name", path.display());
            }
        }
        for path in [&self.truth, &self.truth_blurred].into_iter().flatten() {
            input::check_volume(path)?;
        }
        let named = Container::of_sequence(&self.output);
        named.map_err(|why| Failure::new(format!("{}: {why}", self.output.display())))?;
        self.json.check([])
    }

    /// Describes the settings that determine the output, for people.
    fn describe(&self, scan: &Scan) -> String {
        let settings = scan.settings();
        let scene = self.scene.to_possible_value().map_or(String::new(), |v| v.get_name().to_owned());
        let trajectory = self.trajectory.to_possible_value().map_or(String::new(), |v| v.get_name().to_owned());
        let vector = |v: DVec3| format!("{},{},{}", v.x, v.y, v.z);
        let scene = match (self.scene, self.frequency) {
            (SceneName::Constant, _) => format!("{scene} {}", self.grey),
            (SceneName::Plane | SceneName::Sheet, _) => format!("{scene} across {}", vector(self.normal)),
            (SceneName::Sinusoid, Some(frequency)) => format!("{scene} of {} cycles per mm", vector(frequency)),
            (SceneName::Speckle, _) => format!("{scene} of {} mm", self.grain),
            _ => scene,
        };
        let trajectory = match self.trajectory {
            TrajectoryName::Fan if self.axis_distance != AXIS_DISTANCE_MM => {
                format!("{trajectory} about an axis {} mm away", self.axis_distance)
            }
            TrajectoryName::Rotation => format!("{trajectory}, gap at {} mm", self.radius),
            TrajectoryName::Dwell => format!("{trajectory} of {} frames", self.dwell),
            _ => trajectory,
        };
        let TrackerNoise { position_mm, rotation_degrees } = self.tracker_noise;
        let tracker = if self.tracker_noise == TrackerNoise::default() {
            String::new()
        } else {
            format!(", tracker noise {position_mm} mm {rotation_degrees} deg")
        };
        format!(
            "scene {scene}, trajectory {trajectory}, {} frames, gap {} mm, {}x{} pixels of {} mm{}, noise {}{tracker}, seed {}{}",
            self.frames,
            settings.gap_mm,
            self.image_size[0],
            self.image_size[1],
            // A scanner's default is a quotient: its last digits come from rounding.
            (settings.pixel_mm[0] * 1e9).round() / 1e9,
            if self.fan { " in a fan" } else { "" },
            settings.noise_sd,
            self.seed,
            echoes::describe(scan),
        )
    }

    /// Renders and writes all images. The file gets its name only when the writer is finished.
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
            fields: self.provenance(scan),
            items: (0..scan.frames()).map(|frame| self.item(scan, frame)).collect(),
        };
        let mut writer = SequenceWriter::create(&self.output, &header)?;
        let bar = progress("painting", u64::from(scan.frames()));
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

    /// Writes a truth's voxels. The file gets its name only when the writer is finished.
    fn write_truth(
        &self,
        scan: &Scan,
        time_ns: i64,
        kernel: Option<&EffectiveKernel>,
        voxels: &[f32],
        grid: &Grid,
        path: &Path,
    ) -> Result<VolumeWriter, Failure> {
        let mut size = [0; 3];
        for (to, from) in size.iter_mut().zip(grid.size) {
            *to = u32::try_from(from)?;
        }
        let mut fields = self.provenance(scan);
        fields.push(("SonoweaveFrame".into(), "Reference (mm, not anatomical)".into()));
        if let Some(kernel) = kernel {
            let [u, v, n] = kernel.sigma_mm();
            fields.push(("SonoweaveTruthKernel".into(), format!("Gaussian, sigma u {u:.6} v {v:.6} n {n:.6} mm")));
        }
        if scan.settings().scene.moves() {
            fields.push(("SonoweaveTruthTime".into(), format!("{} s", time_ns as f64 / 1e9)));
        }
        let header = VolumeHeader {
            spacing: grid.spacing.to_array(),
            origin: grid.origin.to_array(),
            fields,
            ..VolumeHeader::new(size, PixelType::F32)
        };
        let mut writer = VolumeWriter::create(path, &header)?;
        writer.write_all(bytemuck::cast_slice(voxels)).map_err(|e| Failure::io(path, "writing the truth", &e))?;
        Ok(writer)
    }

    fn provenance(&self, scan: &Scan) -> Vec<(String, String)> {
        vec![
            ("SonoweaveVersion".into(), env!("CARGO_PKG_VERSION").into()),
            ("SonoweavePhantom".into(), self.describe(scan)),
        ]
    }
}

/// A synthetic sweep.
#[derive(Debug, Serialize)]
struct Report<'a> {
    output: &'a Path,
    /// Content of the sweep, in words.
    content: String,
    /// Voxels of the truths along x, y, z.
    truth_size: Option<[u64; 3]>,
    /// Effective σ of the kernel of the blurred truth along u, v and the normal.
    sigma_effective_mm: [f64; 3],
}

/// Prints a report to stdout.
fn report(arguments: &Arguments, scan: &Scan, grid: Option<&Grid>, kernel: &EffectiveKernel) {
    print_line!("{}: {}", arguments.output.display(), arguments.describe(scan));
    if let (Some(path), Some(grid)) = (&arguments.truth, grid) {
        let [nx, ny, nz] = grid.size;
        let [sx, sy, sz] = grid.spacing.to_array();
        print_line!("{}: the truth, {nx}×{ny}×{nz} voxels of {sx}×{sy}×{sz} mm", path.display());
    }
    if let Some(path) = &arguments.truth_blurred {
        let [u, v, n] = kernel.sigma_mm();
        print_line!(
            "{}: the truth blurred by a kernel of σ {u:.3}, {v:.3} and {n:.3} mm along u, v and the normal",
            path.display()
        );
    }
    if let Some(path) = &arguments.crossings {
        print_line!("{}: crossings of wires with each frame, and landmarks", path.display());
    }
    if let Some(path) = &arguments.phantom {
        print_line!("{}: the phantom; give it to `calibrate` with --phantom", path.display());
    }
    if let Some(path) = &arguments.calibration {
        print_line!("{}: the probe's calibration; give it to `reconstruct` with --config", path.display());
    }
}
