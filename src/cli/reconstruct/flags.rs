//! Flags of all commands that reconstruct.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, ValueEnum};
use glam::DVec3;

use config::Settings as Config;
use drivers::replay::SequenceSettings;
use export::volume::Scalar;
use mask::{Clip, parse_fan};
use pipeline::session::Session;
use reconstruct::path_choice::PathChoice;
use reconstruct::planar::{OnDeparture, PlanarSettings};
use reconstruct::{Settings, Simd};
use sync::smoothing::Smoothing;

use super::beside::BesideFlags;
use super::filling::FillFlags;
use super::weighing::Weighing;
use crate::app::input;
use crate::app::reconstruct::beside::Beside;
use crate::app::reconstruct::leave_one_out;
use crate::app::reconstruct::origin::Origin;
use crate::app::reconstruct::outputs::{OutputOptions, Request};
use crate::app::reconstruct::standard_error::pose_noise;
use crate::app::reconstruct::sweep::Sweep;
use crate::cli::dicom::flags::DicomFlags;
use crate::cli::progress::{say, steps, turning};
use crate::cli::{Failure, values};

/// Voxel spacing when neither the command line nor the configuration has one, mm.
pub(in crate::cli) const SPACING_MM: f64 = 0.5;

/// Settings of a reconstruction, and of its outputs beside the volume.
#[derive(Debug, Args)]
pub(crate) struct Flags {
    /// Calibration and volume settings: our TOML or a PLUS XML
    #[arg(short, long, value_name = "FILE")]
    pub(in crate::cli) config: Option<PathBuf>,
    /// Preset of the calibration file, by its name, for the scanner's depth during the recording
    #[arg(long, value_name = "NAME", requires = "config")]
    pub(in crate::cli) preset: Option<String>,
    /// Calibration of the probe: 16 numbers, row major, pixels to mm
    #[arg(long, value_name = "16 NUMBERS", allow_hyphen_values = true)]
    pub(in crate::cli) image_to_probe: Option<String>,
    /// Frame of the volume [default: Reference if the sequence has one, else Tracker]
    #[arg(long, value_name = "NAME")]
    pub(in crate::cli) world: Option<String>,
    /// Distance between voxels, mm [default: the configuration's, else 0.5]
    #[arg(long, value_name = "MM[,MM,MM]", value_parser = values::spacing)]
    pub(in crate::cli) spacing: Option<DVec3>,
    /// World position of voxel (0,0,0), mm [default: the lattice passes through the world's
    /// origin]
    #[arg(long, value_name = "X,Y,Z", value_parser = values::point, allow_hyphen_values = true)]
    pub(in crate::cli) origin: Option<DVec3>,
    /// Size of the volume, voxels: cropped or padded to exactly this [default: all that slices
    /// reached]
    #[arg(long, value_name = "NX,NY,NZ", value_parser = values::size)]
    pub(in crate::cli) size: Option<[u64; 3]>,
    /// Smooth the tracker's poses over this time before and after a frame, 50 to 1000 ms; 0 uses
    /// them as recorded. Only noise that is independent from pose to pose is averaged out
    #[arg(long, value_name = "MS", default_value_t = 0.0, value_parser = values::smoothing)]
    smoothing: f64,
    /// Insertion path of slices. Planar is for scans whose slices stay perpendicular to one
    /// plane, with image axis u along its normal, and whose data is a rectangle: several times
    /// faster on half the memory, with the volume's axes along the scan's. Auto takes it when
    /// all poses and the mask allow it, one spacing is given, and neither --origin nor --size
    /// refers to the world's axes
    #[arg(long, value_enum, default_value_t, value_name = "PATH")]
    path: PathName,
    /// Action of the planar path on a frame that leaves the plane: refuse the frame, or move all
    /// data to the general path
    #[arg(long, value_enum, default_value_t, value_name = "WHAT")]
    departure: DepartureName,
    /// Largest distance of the image's corners from the plane on the planar path, voxels
    #[arg(long, value_name = "VOXELS", default_value_t = 0.25)]
    pub(in crate::cli) planar_tolerance: f64,
    /// Image data: a rectangle in pixels, all, or found in the first frames [default: the
    /// configuration's, else auto]
    #[arg(long, value_name = "X,Y,W,H|auto|none")]
    pub(in crate::cli) clip: Option<Clip>,
    /// Sector of image data: apex and radii in pixels, angles in degrees from straight down,
    /// positive to the right
    #[arg(long, value_name = "X,Y,R0,R1,A0,A1", allow_hyphen_values = true)]
    pub(in crate::cli) fan: Option<String>,
    /// Scalar type of the volume [default: the input's]; fewer bits need --window
    #[arg(long = "type", value_enum, value_name = "TYPE")]
    scalar: Option<ScalarName>,
    /// Grey values that become black and white
    #[arg(long, value_name = "LO,HI", value_parser = values::window, allow_hyphen_values = true)]
    pub(in crate::cli) window: Option<WindowValue>,
    /// Value of unseen voxels
    #[arg(long, value_name = "V", default_value_t = 0.0, allow_hyphen_values = true)]
    pub(in crate::cli) unseen: f32,
    /// Add the label of seen voxels to an .ome.zarr volume, for viewers: 1 seen, 0 not
    #[arg(long)]
    seen_label: bool,
    #[command(flatten)]
    pub(in crate::cli) beside: BesideFlags,
    /// Frames to use: from A up to, but not including, B
    #[arg(long, value_name = "A..B", value_parser = values::frames)]
    pub(in crate::cli) frames: Option<FrameRange>,
    /// Threads; any number gives the same volume [default: one a core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(in crate::cli) threads: Option<u16>,
    /// Instruction set; all give the same volume
    #[arg(long, value_enum, default_value_t)]
    simd: SimdName,
    /// Memory limit for the volume, GiB
    #[arg(long, value_name = "GIB", default_value_t = 8.0)]
    pub(in crate::cli) max_memory: f64,
    #[command(flatten)]
    pub(in crate::cli) dicom: DicomFlags,
    /// Correct each written value, by the slope around it, where slices lie beside their voxel on
    /// average, as between uneven gaps
    #[arg(long)]
    first_moment: bool,
    #[command(flatten)]
    pub(in crate::cli) filling: FillFlags,
    #[command(flatten)]
    pub(in crate::cli) weighing: Weighing,
}

// clap takes an array for its own notation of repeated values; named types are single values to
// it.
type WindowValue = [f32; 2];
type FrameRange = std::ops::Range<u64>;

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum PathName {
    /// By the poses and the mask
    #[default]
    Auto,
    /// Any pose and any mask; the volume's axes are the world's
    General,
    /// Slices perpendicular to one plane; the volume's axes, and the axes of --spacing and
    /// --size, are the scan's
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
    /// The best of this machine
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

impl Flags {
    /// Returns the request for a volume and the other outputs, and the sweep. Checks the outputs
    /// before the work.
    ///
    /// # Errors
    /// [`Failure`] when flags contradict each other or files are out of reach.
    pub(in crate::cli) fn request(
        &self,
        sequence: &Path,
        volume: Option<&Path>,
        beside: Beside,
    ) -> Result<(Request, Sweep), Failure> {
        let began = Instant::now();
        let mut sweep = self.settings(sequence)?;
        let mut options = self.outputs(volume, beside);
        if self.weighing.leaves_one_out() {
            let choice = leave_one_out::choose(&sweep, &steps)?;
            say(&choice.to_string());
            sweep.session.settings.sigma_mm = choice.sigma_mm.map(Some);
            options.note = Some(choice.sentence());
        }
        Ok((Request::new(Origin::File(sequence.to_owned()), &sweep, options, began)?, sweep))
    }

    /// Returns the files beside the volume.
    pub(crate) fn beside(&self) -> Beside {
        self.beside.beside()
    }

    /// Returns the settings of the outputs.
    pub(crate) fn outputs(&self, volume: Option<&Path>, beside: Beside) -> OutputOptions {
        OutputOptions {
            volume: volume.map(Path::to_owned),
            beside,
            first_moment: self.first_moment,
            filling: self.filling.filling(),
            scalar: self.scalar.map(|scalar| match scalar {
                ScalarName::U8 => Scalar::U8,
                ScalarName::U16 => Scalar::U16,
                ScalarName::F32 => Scalar::F32,
            }),
            window: self.window,
            unseen: self.unseen,
            label: self.seen_label,
            has_origin: self.origin.is_some(),
            size: self.size,
            identifiers: self.dicom.identifiers(),
            config: self.config.clone(),
            has_calibration: self.image_to_probe.is_some(),
            note: self.weighing.note(),
        }
    }

    /// Returns the sequence with the settings of its reconstruction.
    ///
    /// # Errors
    /// [`Failure`] when files cannot be read or flags contradict each other.
    pub(crate) fn sweep(&self, sequence: &Path) -> Result<Sweep, Failure> {
        if self.weighing.leaves_one_out() {
            fail_usage!(
                "--sigma leave-one-out: is chosen by the command reconstruct; run it, and give its three numbers here"
            );
        }
        self.settings(sequence)
    }

    /// The same, but for widths by leave-one-out, which are not chosen yet.
    fn settings(&self, sequence: &Path) -> Result<Sweep, Failure> {
        let mut config = match &self.config {
            Some(path) => Config::read(path, self.preset.as_deref())?,
            None => Config::default(),
        };
        if let Some(text) = &self.image_to_probe {
            config.set_image_to_probe(text).map_err(|e| Failure::usage(format!("--image-to-probe: {e}")))?;
        }
        let mut mask = config.mask();
        if let Some(clip) = self.clip {
            mask.clip = clip;
        }
        if let Some(text) = &self.fan {
            mask.fan = Some(parse_fan(text).map_err(|e| Failure::usage(format!("--fan {text}: {e}")))?);
        }
        let spacing = self.spacing.or(config.spacing_mm.map(DVec3::from_array)).unwrap_or(DVec3::splat(SPACING_MM));
        let mut settings = Settings::new(spacing);
        settings.lattice_origin_mm = self.origin.unwrap_or(DVec3::ZERO);
        let off_plane = self.weighing.apply(&config, &mut settings)?;
        settings.standard_error = self.beside.error.is_some();
        settings.threads = input::threads(self.threads);
        settings.simd = match self.simd {
            SimdName::Auto => Simd::detect(),
            SimdName::Avx512 => Simd::Avx512,
            SimdName::Avx2 => Simd::Avx2,
            SimdName::Portable => Simd::Portable,
        };
        let most = self.max_memory * f64::from(1 << 30);
        if !(most > 0.0 && most.is_finite()) {
            fail_usage!("--max-memory {}: must be a positive number of GiB", self.max_memory);
        }
        settings.memory_bytes = most as u64;
        let session = Session {
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
            pose_noise: pose_noise(config.sensor_noise(), &config),
            smoothing: (self.smoothing > 0.0).then(|| Smoothing::offline((self.smoothing * 1e6).round() as i64)),
            ..Session::new(config.pairing_options(self.world.as_deref()), mask, settings)
        };
        let input = SequenceSettings { progress: turning(), ..SequenceSettings::new(sequence) };
        let frames = self.frames.clone().unwrap_or(0..u64::MAX);
        Ok(Sweep { input, frames, off_plane, session, config })
    }
}
