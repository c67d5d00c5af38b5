//! `sonoweave reconstruct`: a recorded sweep becomes a volume.

mod weighing;

use std::path::PathBuf;
use std::time::Instant;

use clap::{Args, ValueEnum};
use drivers::OpenSettings;
use drivers::recording::SequenceSettings;
use glam::DVec3;

use super::{Failure, input, values};
use crate::config::Settings as Config;
use crate::export::planes::{PlanesOptions, Window, planes};
use crate::export::volume::{DenseBox, Encoding, Scalar, write_values, write_weights};
use crate::mask::{Clip, parse_fan};
use crate::path::PathChoice;
use crate::pipeline::{self, Job, Outcome, PixelKind};
use crate::reconstruct::planar::{OnDeparture, PlanarSettings};
use crate::reconstruct::{Path, Settings, Simd};
use crate::statistics::Statistics;
use crate::volume::Grid;
use crate::volume::sparse::SEEN;
use weighing::Weighing;

/// Voxel spacing when neither the command line nor the configuration has one, mm.
const SPACING_MM: f64 = 0.5;

/// Flags of `reconstruct`.
#[derive(Debug, Args)]
#[command(after_help = "\
A sequence needs a way from its pictures to the world: transforms like ProbeToTracker and ReferenceToTracker in the sequence, and the \
probe's calibration ImageToProbe in --config or --image-to-probe. A sequence that holds ImageToReference, ImageToWorld or \
ImageToTracker needs no calibration.

Example: sonoweave reconstruct sweep.igs.mha --config PlusConfiguration.xml -o volume.mha --planes volume.png")]
pub struct Arguments {
    /// The recorded sweep: a tracked sequence (.igs.mha, .mha)
    sequence: PathBuf,
    /// Where to write the volume (.mha)
    #[arg(short, long, value_name = "VOL.mha")]
    output: PathBuf,
    /// Calibration and volume settings: our TOML or a PLUS XML
    #[arg(short, long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// The probe's calibration: 16 numbers, row major, pixels to mm
    #[arg(long, value_name = "16 NUMBERS", allow_hyphen_values = true)]
    image_to_probe: Option<String>,
    /// Frame in which the volume lives [default: Reference if the sequence has one, else Tracker]
    #[arg(long, value_name = "NAME")]
    world: Option<String>,
    /// Distance between voxels, mm [default: the configuration's, else 0.5]
    #[arg(long, value_name = "MM[,MM,MM]", value_parser = values::spacing)]
    spacing: Option<DVec3>,
    /// World position of voxel (0,0,0), mm [default: the lattice passes through the world's origin]
    #[arg(long, value_name = "X,Y,Z", value_parser = values::point, allow_hyphen_values = true)]
    origin: Option<DVec3>,
    /// Voxels of the volume: cropped or padded exactly so [default: all that was touched]
    #[arg(long, value_name = "NX,NY,NZ", value_parser = values::size)]
    size: Option<[u64; 3]>,
    /// Which path slices go. Planar is for scans whose slices stay perpendicular to one plane, with image axis u along its normal, and whose data is a
    /// rectangle: several times faster on half the memory, with the volume's axes along the scan's. Auto takes it when all poses and the mask allow
    /// it, one spacing is given, and neither --origin nor --size speaks of the world's axes
    #[arg(long, value_enum, default_value_t, value_name = "PATH")]
    path: PathName,
    /// What the planar path does with a frame that leaves the plane: refuse it, or upgrade to the general path with all there is
    #[arg(long, value_enum, default_value_t, value_name = "WHAT")]
    departure: DepartureName,
    /// How far the picture's corners may lie off the plane on the planar path, voxels
    #[arg(long, value_name = "VOXELS", default_value_t = 0.25)]
    planar_tolerance: f64,
    /// What of the picture is data: a rectangle in pixels, all, or found in the first frames [default: the configuration's, else auto]
    #[arg(long, value_name = "X,Y,W,H|auto|none")]
    clip: Option<Clip>,
    /// Sector that is data: apex and radii in pixels, angles in degrees from straight down, positive to the right
    #[arg(long, value_name = "X,Y,R0,R1,A0,A1", allow_hyphen_values = true)]
    fan: Option<String>,
    /// Scalar type of the volume [default: the input's]; going to fewer bits needs --window
    #[arg(long = "type", value_enum, value_name = "TYPE")]
    scalar: Option<ScalarName>,
    /// Grey values that become black and white
    #[arg(long, value_name = "LO,HI", value_parser = values::window, allow_hyphen_values = true)]
    window: Option<WindowValue>,
    /// Value of voxels that were not seen
    #[arg(long, value_name = "V", default_value_t = 0.0, allow_hyphen_values = true)]
    unseen: f32,
    /// Write the weights too: 0 where nothing was seen
    #[arg(long, value_name = "FILE.mha")]
    weights: Option<PathBuf>,
    /// Draw the three middle planes
    #[arg(long, value_name = "FILE.png")]
    planes: Option<PathBuf>,
    /// Frames to use: from A up to, but not including, B
    #[arg(long, value_name = "A..B", value_parser = values::frames)]
    frames: Option<FrameRange>,
    /// Threads; any number gives the same volume [default: one a core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Instruction set; all give the same volume
    #[arg(long, value_enum, default_value_t)]
    simd: SimdName,
    /// Memory that the volume may take, GiB
    #[arg(long, value_name = "GIB", default_value_t = 8.0)]
    max_memory: f64,
    /// Write what was done, as JSON
    #[arg(long, value_name = "FILE.json")]
    stats: Option<PathBuf>,
    #[command(flatten)]
    weighing: Weighing,
}

// clap takes an array for its own notation of repeated values; named types are single values to it.
type WindowValue = [f32; 2];
type FrameRange = std::ops::Range<u64>;

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum PathName {
    /// By the poses and the mask
    #[default]
    Auto,
    /// Any pose and any mask; the volume's axes are the world's
    General,
    /// Slices perpendicular to one plane; the volume's axes are the scan's, along which --spacing and --size count then
    Planar,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum DepartureName {
    /// The general path takes over
    #[default]
    Upgrade,
    /// The frame is refused
    Refuse,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum SimdName {
    /// The best that the machine has
    #[default]
    Auto,
    /// AVX-512
    Avx512,
    /// AVX2 and FMA
    Avx2,
    /// Any machine
    Portable,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ScalarName {
    /// 8 bit unsigned
    U8,
    /// 16 bit unsigned
    U16,
    /// Single precision
    F32,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`]: nothing was written then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let began = Instant::now();
    let job = arguments.job()?;
    let effective = job.config.clone();
    let mask_settings = job.mask;
    let frames = job.frames.clone();
    // Fails before the work, not after it, where the output cannot be.
    arguments.check_outputs()?;
    let bar = input::progress("weaving", 1);
    let result = pipeline::reconstruct(job, |p| {
        bar.set_length(p.total);
        bar.set_position(p.done);
    });
    bar.finish_and_clear();
    let mut outcome = result?;
    outcome.notes.extend(arguments.weighing.note());
    let encoding = arguments.encoding(outcome.pixels)?;
    let space = arguments.dense_box(&outcome)?;

    let hash = input::hash(&arguments.sequence)?;
    let fields = provenance(arguments, &outcome, &hash)?;
    let volume = outcome.reconstructor.volume();
    write_values(volume, &space, &arguments.output, &encoding, &fields)?;
    if let Some(path) = &arguments.weights {
        write_weights(volume, &space, path, &fields)?;
    }
    let picture = match &arguments.planes {
        Some(path) => Some((path, draw(&outcome, &space, path)?)),
        None => None,
    };

    let statistics = Statistics::new(&outcome, &space, encoding.scalar.name(), began.elapsed());
    if let Some(path) = &arguments.stats {
        let frames = (frames != (0..u64::MAX)).then_some([frames.start, frames.end]);
        statistics.write(path, &arguments.sequence, &hash, &effective, &mask_settings, frames)?;
    }
    report(arguments, &outcome, &statistics, picture.map(|(path, _)| path.as_path()));
    Ok(())
}

impl Arguments {
    fn job(&self) -> Result<Job, Failure> {
        let mut config = match &self.config {
            Some(path) => Config::read(path)?,
            None => Config::default(),
        };
        if let Some(text) = &self.image_to_probe {
            config.set_image_to_probe(text).map_err(|e| Failure(format!("--image-to-probe: {e}")))?;
        }
        let mut mask = config.mask();
        if let Some(clip) = self.clip {
            mask.clip = clip;
        }
        if let Some(text) = &self.fan {
            mask.fan = Some(parse_fan(text).map_err(|e| Failure(format!("--fan {text}: {e}")))?);
        }
        let spacing = self.spacing.or(config.spacing_mm.map(DVec3::from_array)).unwrap_or(DVec3::splat(SPACING_MM));
        let mut settings = Settings::new(spacing);
        settings.lattice_origin_mm = self.origin.unwrap_or(DVec3::ZERO);
        let off_plane = self.weighing.apply(&config, &mut settings)?;
        settings.threads = match self.threads {
            Some(n) => usize::from(n),
            None => std::thread::available_parallelism().map_or(1, usize::from),
        };
        settings.simd = match self.simd {
            SimdName::Auto => Simd::detect(),
            SimdName::Avx512 => Simd::Avx512,
            SimdName::Avx2 => Simd::Avx2,
            SimdName::Portable => Simd::Portable,
        };
        let most = self.max_memory * f64::from(1 << 30);
        if !(most > 0.0 && most.is_finite()) {
            return Err(Failure(format!("--max-memory {}: must be a positive number of GiB", self.max_memory)));
        }
        settings.memory_bytes = most as u64;
        let sequence = SequenceSettings::new(&self.sequence);
        Ok(Job {
            survey: OpenSettings::Sequence(SequenceSettings { images: false, ..sequence.clone() }),
            input: OpenSettings::Sequence(sequence),
            config,
            world: self.world.clone(),
            mask,
            settings,
            off_plane,
            path: match self.path {
                PathName::Auto if self.origin.is_some() || self.size.is_some() => PathChoice::WorldBox,
                PathName::Auto => PathChoice::Auto,
                PathName::General => PathChoice::General,
                PathName::Planar => PathChoice::Planar,
            },
            planar: PlanarSettings {
                tolerance_voxels: self.planar_tolerance,
                on_departure: match self.departure {
                    DepartureName::Upgrade => OnDeparture::Upgrade,
                    DepartureName::Refuse => OnDeparture::Refuse,
                },
                ..PlanarSettings::default()
            },
            frames: self.frames.clone().unwrap_or(0..u64::MAX),
        })
    }

    /// The folders of all outputs exist, and none is the input.
    fn check_outputs(&self) -> Result<(), Failure> {
        let outputs = [Some(&self.output), self.weights.as_ref(), self.planes.as_ref(), self.stats.as_ref()];
        let input = self.sequence.canonicalize().ok();
        for path in outputs.into_iter().flatten() {
            let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(".".as_ref());
            if !folder.is_dir() {
                return Err(Failure(format!("{}: the folder {} does not exist", path.display(), folder.display())));
            }
            if path.canonicalize().ok().is_some_and(|p| Some(p) == input) {
                return Err(Failure(format!("{}: is the input; give another name", path.display())));
            }
        }
        let volumes = [Some(&self.output), self.weights.as_ref()];
        for path in volumes.into_iter().flatten() {
            if path.extension().is_none_or(|e| !e.eq_ignore_ascii_case("mha")) {
                return Err(Failure(format!("{}: volumes are written as .mha; give such a name", path.display())));
            }
        }
        Ok(())
    }

    fn encoding(&self, pixels: PixelKind) -> Result<Encoding, Failure> {
        let input = match pixels {
            PixelKind::U8 => ScalarName::U8,
            PixelKind::U16 => ScalarName::U16,
            PixelKind::F32 => ScalarName::F32,
        };
        let scalar = self.scalar.unwrap_or(input);
        let bits = |s: ScalarName| s as u8;
        if bits(scalar) < bits(input) && self.window.is_none() {
            return Err(Failure(format!(
                "--type {0:?}: the input is {input:?}; say with --window LO,HI which grey values become black and white",
                scalar
            )
            .to_lowercase()
            .replace("lo,hi", "LO,HI")));
        }
        let scalar = match scalar {
            ScalarName::U8 => Scalar::U8,
            ScalarName::U16 => Scalar::U16,
            ScalarName::F32 => Scalar::F32,
        };
        let representable = match scalar {
            Scalar::U8 => (0.0..=255.0).contains(&self.unseen) && self.unseen.fract() == 0.0,
            Scalar::U16 => (0.0..=65535.0).contains(&self.unseen) && self.unseen.fract() == 0.0,
            Scalar::F32 => true,
        };
        if !representable {
            return Err(Failure(format!("--unseen {}: is no value of type {}", self.unseen, scalar.name())));
        }
        Ok(Encoding { scalar, window: self.window, unseen: self.unseen })
    }

    fn dense_box(&self, outcome: &Outcome) -> Result<DenseBox, Failure> {
        let reconstructor = &outcome.reconstructor;
        let settings = reconstructor.settings();
        let Some((low, high)) = reconstructor.volume().seen_bounds() else {
            return Err(Failure(
                "no voxel was seen: the slices' kernel fell between the voxels; choose a finer --spacing".into(),
            ));
        };
        let (first, size) = match (self.origin, self.size) {
            // The lattice begins at the origin that was given.
            (Some(_), Some(size)) => ([0; 3], size),
            (None, Some(size)) => (low, size),
            (_, None) => (low, [0, 1, 2].map(|a| (high[a] - low[a] + 1) as u64)),
        };
        let origin = reconstructor.world_from_lattice().point(DVec3::from_array(first.map(|x| x as f64)));
        let grid = Grid { origin, spacing: settings.spacing_mm, direction: settings.lattice_direction, size };
        Ok(DenseBox { first, grid })
    }
}

/// What the volume was made of, for its header.
fn provenance(arguments: &Arguments, outcome: &Outcome, hash: &str) -> Result<Vec<(String, String)>, Failure> {
    let name = arguments.sequence.file_name().unwrap_or(arguments.sequence.as_os_str());
    let calibration = match &arguments.config {
        Some(path) => {
            let name = path.file_name().unwrap_or(path.as_os_str());
            format!("{} sha256 {}", name.to_string_lossy(), input::hash(path)?)
        }
        None if arguments.image_to_probe.is_some() => "command line".into(),
        None => "in the sequence".into(),
    };
    let three = |values: [f64; 3]| values.map(|v| format!("{v}")).join(" ");
    let kernels = outcome.reconstructor.kernels();
    let per_axis = |f: fn(&crate::reconstruct::kernel::AxisKernel) -> f64| kernels.map(|k| three(k.each_ref().map(f)));
    let line = |key: &str, value: String| (format!("Sonoweave{key}"), one_line(&value));
    let mut fields = vec![
        line("Version", env!("CARGO_PKG_VERSION").into()),
        line("Frame", format!("{} (mm, not anatomical)", outcome.world)),
        line("Input", format!("{} sha256 {hash}", name.to_string_lossy())),
        line("Calibration", calibration),
        line("Route", outcome.route.clone()),
        line("Method", arguments.weighing.method().name().into()),
        line("Compounding", outcome.reconstructor.settings().compounding.to_string()),
        line("Path", outcome.reconstructor.path().name().into()),
    ];
    if let (Some(sigma), Some(support)) = (per_axis(|k| k.sigma_mm), per_axis(|k| k.support_mm)) {
        fields.push(line("SigmaMm", sigma));
        fields.push(line("SupportMm", support));
    }
    fields.push(line("Unseen", format!("{}", arguments.unseen)));
    fields.push(line("Frames", format!("{} of {}", outcome.ledger.frames.used, outcome.ledger.frames.total)));
    Ok(fields)
}

/// Header fields end with the line.
fn one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect::<String>().trim().to_owned()
}

fn draw(outcome: &Outcome, space: &DenseBox, path: &std::path::Path) -> Result<(), Failure> {
    let volume = outcome.reconstructor.volume();
    let value = |voxel: [u64; 3]| {
        let at: [i64; 3] = std::array::from_fn(|a| space.first[a] + voxel[a] as i64);
        let (r, w) = volume.voxel(at);
        (w > SEEN).then(|| r / w)
    };
    let options = PlanesOptions { window: Window::Percentiles, ..PlanesOptions::default() };
    Ok(planes(&space.grid, value, &options)?.write_png(path)?)
}

/// What was done, in a few lines on stdout; what the user should know, on stderr.
#[allow(clippy::print_stdout, clippy::print_stderr, reason = "the command's output")]
fn report(arguments: &Arguments, outcome: &Outcome, statistics: &Statistics, picture: Option<&std::path::Path>) {
    for note in &outcome.notes {
        eprintln!("sonoweave: note: {note}");
    }
    if outcome.ledger.refused_total() > 0 || outcome.ledger.untimed > 0 {
        eprintln!("sonoweave: {}", outcome.ledger);
    }
    let grid = &statistics.grid;
    let [nx, ny, nz] = grid.size;
    println!(
        "{}: {nx}×{ny}×{nz} voxels of {} mm in {}, from {} of {} frames",
        arguments.output.display(),
        grid.spacing.map(|s| s.to_string()).join("×"),
        outcome.world,
        outcome.ledger.frames.used,
        outcome.ledger.frames.total,
    );
    if let Some(ms) = &statistics.insert_ms {
        println!(
            "{:.2} ms a slice (median; p99 {:.2}) by the {} path, {} voxels updated, {:.0} MB of {}, {} thread{}, {}",
            ms.median,
            ms.p99,
            statistics.path,
            statistics.voxels_updated,
            statistics.bytes as f64 / 1e6,
            match outcome.reconstructor.path() {
                Path::General => "bricks",
                Path::Planar => "columns",
            },
            statistics.threads,
            if statistics.threads == 1 { "" } else { "s" },
            statistics.simd,
        );
    }
    let [su, sv, sn] = statistics.sigma_mm;
    let [eu, ev, en] = statistics.sigma_effective_mm;
    println!("kernel σ {su:.3}, {sv:.3}, {sn:.3} mm along u, v, n; effective {eu:.3}, {ev:.3}, {en:.3}");
    if let Some(path) = &arguments.weights {
        println!("weights: {}", path.display());
    }
    if let Some(path) = picture {
        println!("middle planes: {}", path.display());
    }
}
