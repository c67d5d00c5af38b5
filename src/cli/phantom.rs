//! `sonoweave phantom`: a synthetic sweep whose truth is known.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use calibration::file::CalibrationFile;
use clap::{ArgGroup, Args, ValueEnum as _};
use drivers::reading::{NamedTransform, PixelType, Stamp, Status};
use drivers::recording::image::write::{SequenceHeader, SequenceItem, SequenceWriter, VolumeWriter};
use drivers::recording::image::{Container, VolumeHeader};
use glam::DVec3;

pub(super) mod choices;
mod echoes;

use choices::{ScalarName, direction, frequency, tracker_noise};

use super::{Failure, input, values};
use crate::phantom::named::{
    AXIS_DISTANCE_MM, DWELL, MotionOptions, RADIUS_MM, SceneName, SceneOptions, TrajectoryName,
};
use crate::phantom::scan::{Depth, convex_fan};
use crate::phantom::scene::Speckle;
use crate::phantom::{EffectiveKernel, Scan, ScanSettings, TrackerNoise, blur, truth};
use crate::slice::Pixels;
use crate::volume::Grid;

/// Frames painted at once: enough for all cores, little enough for memory.
const BATCH: u32 = 8;

/// Flags of `phantom`.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("truths").multiple(true)), after_help = "\
The sequence holds ImageToReference, so that `sonoweave reconstruct SEQ -o VOL` needs no calibration. With --calibration it holds what a \
tracker records instead, ProbeToTracker and ReferenceToTracker, and the probe's calibration is written to a file of its own. The same flags \
give the same bits on every machine.

A reconstruction is the scene under its kernel, so that even a perfect one differs from --truth: a kernel as wide as the scanner's own blur \
widens the result by √2. --truth-blurred is the scene under the kernel that `reconstruct --spacing` uses, turned with the pictures, or under \
that of --sigma: what then remains is the reconstruction's own error. A sweep is undersampled twice or three times by two or three times the \
--gap and as many fewer --frames.

Dolls, thighs, wires, floors and styli are bodies: an ultrasound scanner looks into them, and their truth is the mean echo of what is there. What is \
outside the scanner's field is black and no data: the sequence tells the fan or the clip, and --calibration writes it for `reconstruct --config`.

Example: sonoweave phantom -o sweep.igs.mha --truth truth.mha --scene blobs --trajectory freehand --spacing 0.5")]
pub struct Arguments {
    /// Where to write the sweep, a tracked sequence (.mha, .mhd, .nrrd, .nhdr)
    #[arg(short, long, value_name = "SEQ.igs.mha")]
    output: PathBuf,
    /// Write the scene on the lattice that `reconstruct --spacing` uses, over the box that holds all pictures
    #[arg(long, value_name = "VOL.mha", group = "truths")]
    truth: Option<PathBuf>,
    /// Write the scene under the reconstruction's kernel on the same lattice
    #[arg(long, value_name = "VOL.mha", group = "truths")]
    truth_blurred: Option<PathBuf>,
    /// σ that the kernel of --truth-blurred really has along u, v and the picture's normal, mm [default: those of `reconstruct` at this
    /// --spacing and --pixel; its statistics tell others]
    #[arg(long, value_name = "SU,SV,SN", value_parser = values::lengths, requires = "truth_blurred")]
    sigma: Option<[f64; 3]>,
    /// When the truths are taken of a scene that moves, s [default: the last picture's time]
    #[arg(long, value_name = "S", requires = "truths", allow_hyphen_values = true)]
    truth_time: Option<f64>,
    /// Distance between the truths' voxels, mm
    #[arg(long, value_name = "MM[,MM,MM]", value_parser = values::spacing, default_value = "0.5")]
    spacing: DVec3,
    /// What lies in the world
    #[arg(long, value_enum, default_value_t)]
    scene: SceneName,
    /// Grey level of --scene constant
    #[arg(long, value_name = "GREY", default_value_t = 100.0, allow_hyphen_values = true)]
    grey: f64,
    /// Normal of --scene plane and sheet, of any length
    #[arg(long, value_name = "X,Y,Z", value_parser = direction, default_value = "1,2,3", allow_hyphen_values = true)]
    normal: DVec3,
    /// One wave for --scene sinusoid, cycles per mm along x, y and z [default: one of 0.25 along each axis]
    #[arg(long, value_name = "FX,FY,FZ", value_parser = frequency, allow_hyphen_values = true)]
    frequency: Option<DVec3>,
    /// Where the correlation of --scene speckle has fallen to a half, mm
    #[arg(long, value_name = "MM", default_value_t = Speckle::STANDARD_PITCH_MM)]
    grain: f64,
    /// How the probe moves
    #[arg(long, value_enum, default_value_t)]
    trajectory: TrajectoryName,
    /// Distance of the axis of --trajectory fan from the picture's middle, mm
    #[arg(long, value_name = "MM", default_value_t = AXIS_DISTANCE_MM)]
    axis_distance: f64,
    /// Distance from the axis of --trajectory rotation at which neighbouring pictures lie the gap apart, mm
    #[arg(long, value_name = "MM", default_value_t = RADIUS_MM)]
    radius: f64,
    /// Pictures of the stand of --trajectory dwell
    #[arg(long, value_name = "N", default_value_t = DWELL)]
    dwell: u32,
    /// Standard deviations of the recorded poses' errors: position along each axis, mm, and rotation about each, degrees
    #[arg(long, value_name = "MM,DEG", value_parser = tracker_noise, default_value = "0,0")]
    tracker_noise: TrackerNoise,
    /// Number of pictures
    #[arg(long, value_name = "N", default_value_t = 120)]
    frames: u32,
    /// Mean distance between neighbouring pictures that move, mm [default: 0.35; of a body what sees all of it; of --trajectory about 1]
    #[arg(long, value_name = "MM")]
    gap: Option<f64>,
    /// Pictures a second
    #[arg(long, value_name = "HZ", default_value_t = 30.0)]
    rate: f64,
    /// Size of a picture, pixels
    #[arg(long, value_name = "WxH", value_parser = values::picture_size, default_value = "512x480")]
    image_size: PictureSize,
    /// Size of a pixel, mm [default: 0.1; of a body what shows the scanner's whole field]
    #[arg(long, value_name = "MM")]
    pixel: Option<f64>,
    /// Show the sector of a convex probe; the rest of the picture is black and no data
    #[arg(long)]
    fan: bool,
    /// Standard deviation of the noise, grey levels [default: 6; of a body 0, as its scanner has noise of its own]
    #[arg(long, value_name = "SD")]
    noise: Option<f64>,
    /// Seed of the blobs, the speckle, the probe's walk and all noise
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
    /// Write where the wires of a body cross each picture, and where its landmarks are, as CSV
    #[arg(long, value_name = "FILE.csv")]
    crossings: Option<PathBuf>,
    /// Write a body's wires and landmarks, and where it is held, as `calibrate` takes them
    #[arg(long, value_name = "FILE.toml")]
    phantom: Option<PathBuf>,
    #[command(flatten)]
    echoes: echoes::EchoFlags,
}

// A named type is a single value to clap.
type PictureSize = [u32; 2];

/// Runs the command.
///
/// # Errors
/// [`Failure`]: nothing was written then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.check_outputs()?;
    let scan = Scan::new(arguments.settings()?)?;
    let time_ns = arguments.truth_time_ns(&scan)?;
    // The grid and the kernel may be refused: before the painting, not after it.
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
    // All that can take long or fail for lack of room is behind: the files take their names together.
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
        std::fs::write(path, echoes::crossings(&scan))
            .map_err(|e| Failure(format!("{}: writing the crossings failed: {e}", path.display())))?;
    }
    if let Some((path, phantom)) = phantom {
        std::fs::write(path, phantom.to_text())
            .map_err(|e| Failure(format!("{}: writing the phantom failed: {e}", path.display())))?;
    }
    report(arguments, &scan, grid.as_ref(), &kernel);
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
        if !(self.grain.is_finite() && self.grain > 0.0) {
            return Err(Failure(format!("--grain {}: must be a positive, finite length in mm", self.grain)));
        }
        let options = SceneOptions {
            grey: self.grey,
            normal: self.normal,
            frequency: self.frequency,
            grain_mm: self.grain,
            ..SceneOptions::new(self.seed)
        };
        let shown = self.echoes.shown(self.scene, options);
        if shown.scanned().is_none() && (self.echoes.given() || self.crossings.is_some() || self.phantom.is_some()) {
            return Err(Failure(
                "--probe, --depth, --mhz, --focus, --tgc, --dynamic-range, --without, --crossings and --phantom are of a scanner, which only --scene doll, thigh, n-wire, \
                 cross-wire, tank-floor and stylus have; leave them out or scan one of these"
                    .into(),
            ));
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
                Some(convex_fan(self.image_size).map_err(|e| Failure(format!("--fan: {e}")))?)
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

    /// When the truths are taken, ns.
    fn truth_time_ns(&self, scan: &Scan) -> Result<i64, Failure> {
        match self.truth_time {
            None => Ok(scan.time_ns(scan.frames() - 1)),
            // Thirty years either way: whole nanoseconds that fit.
            Some(s) if s.abs() <= 1e9 => Ok((s * 1e9).round() as i64),
            Some(s) => Err(Failure(format!("--truth-time {s}: must be a time in seconds between -1e9 and 1e9"))),
        }
    }

    /// The kernel of the blurred truth.
    fn kernel(&self, scan: &Scan) -> Result<EffectiveKernel, Failure> {
        Ok(match self.sigma {
            Some(sigma) => EffectiveKernel::new(sigma)?,
            None => EffectiveKernel::of_defaults(self.spacing, scan.settings().pixel_mm)?,
        })
    }

    /// All outputs can be written, their names tell what files they are, and no two are the same.
    fn check_outputs(&self) -> Result<(), Failure> {
        let others = [&self.truth, &self.truth_blurred, &self.calibration, &self.crossings, &self.phantom];
        let outputs: Vec<&PathBuf> =
            std::iter::once(&self.output).chain(others.into_iter().filter_map(Option::as_ref)).collect();
        for (n, path) in outputs.iter().enumerate() {
            input::check_output(path)?;
            if outputs[..n].contains(path) {
                return Err(Failure(format!("{}: is named for two outputs; give another name", path.display())));
            }
        }
        for path in [&self.truth, &self.truth_blurred].into_iter().flatten() {
            input::check_volume(path)?;
        }
        let named = Container::of_sequence(&self.output);
        named.map_err(|why| Failure(format!("{}: {why}", self.output.display())))?;
        Ok(())
    }

    /// What determines the bits, for people.
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
            // A scanner's default is a quotient: its last digits are rounding's.
            (settings.pixel_mm[0] * 1e9).round() / 1e9,
            if self.fan { " in a fan" } else { "" },
            settings.noise_sd,
            self.seed,
            echoes::describe(scan),
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
            fields: self.provenance(scan),
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

    /// Writes a truth's voxels; the file has its name only when the writer is finished.
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
        writer
            .write_all(bytemuck::cast_slice(voxels))
            .map_err(|e| Failure(format!("{}: writing the truth failed: {e}", path.display())))?;
        Ok(writer)
    }

    fn provenance(&self, scan: &Scan) -> Vec<(String, String)> {
        vec![
            ("SonoweaveVersion".into(), env!("CARGO_PKG_VERSION").into()),
            ("SonoweavePhantom".into(), self.describe(scan)),
        ]
    }
}

/// What was made, on stdout.
#[allow(clippy::print_stdout, reason = "the command's output")]
fn report(arguments: &Arguments, scan: &Scan, grid: Option<&Grid>, kernel: &EffectiveKernel) {
    println!("{}: {}", arguments.output.display(), arguments.describe(scan));
    if let (Some(path), Some(grid)) = (&arguments.truth, grid) {
        let [nx, ny, nz] = grid.size;
        let [sx, sy, sz] = grid.spacing.to_array();
        println!("{}: its truth, {nx}×{ny}×{nz} voxels of {sx}×{sy}×{sz} mm", path.display());
    }
    if let Some(path) = &arguments.truth_blurred {
        let [u, v, n] = kernel.sigma_mm();
        println!(
            "{}: its truth under a kernel of σ {u:.3}, {v:.3} and {n:.3} mm along u, v and the normal",
            path.display()
        );
    }
    if let Some(path) = &arguments.crossings {
        println!("{}: where wires cross each picture, and landmarks", path.display());
    }
    if let Some(path) = &arguments.phantom {
        println!("{}: the phantom; give it to `calibrate` with --phantom", path.display());
    }
    if let Some(path) = &arguments.calibration {
        println!("{}: the probe's calibration; give it to `reconstruct` with --config", path.display());
    }
}
