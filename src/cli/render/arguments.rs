//! Flags of `render`.

use std::path::PathBuf;

use clap::Args;

use super::view_flags::ViewFlags;
use crate::app::json::JsonFlag;
use crate::app::part::Part;
use crate::cli::movie::MovieRate;
use crate::cli::values;

/// Default memory limit, GiB.
pub(super) const MAX_MEMORY: f64 = 8.0;

/// Flags of `render`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
With --weights, unseen voxels differ from seen black ones. For a volume from `reconstruct --type f32` with its \
weights, the picture equals the last picture of `replay`.

An OME-Zarr volume is read chunk by chunk. If its voxels do not fit into --max-memory at once, it is rendered in \
parts, one after the other, to the same picture; --parts gives their number. Several processes can render the parts:

sonoweave render limb.ome.zarr --part 1/2 -o 1.part
sonoweave render limb.ome.zarr --part 2/2 -o 2.part
sonoweave render limb.ome.zarr --composite 1.part 2.part -o picture.png

Examples: sonoweave render volume.mha --weights weights.mha -o picture.png --view 30,20 --transfer bone
          sonoweave render volume.mha -o turn.gif --turntable 60")]
pub struct Arguments {
    /// Volume (.mha, .mhd, .nrrd, .nhdr, .nii, .nii.gz, .ome.zarr)
    pub(super) volume: PathBuf,
    /// Write the picture to this file (.png), with --turntable also a movie (.apng, .gif, .avi), or
    /// with --part the message
    #[arg(short, long, value_name = "IMG.png")]
    pub(super) output: PathBuf,
    /// Volume's weights, as `reconstruct --weights` wrote them: 0 marks unseen voxels
    #[arg(long, value_name = "FILE.mha")]
    pub(super) weights: Option<PathBuf>,
    /// Grey values that are black and white to presets [default: those of the scanner's image if
    /// the file gives them, else of the scalar type, else the smallest and the largest]
    #[arg(long, value_name = "LO,HI", value_parser = values::window, allow_hyphen_values = true)]
    pub(super) window: Option<WindowValue>,
    /// Draw so many pictures all around the vertical: IMG-000.png, IMG-001.png, …, or those of a
    /// movie
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=3600))]
    pub(super) turntable: Option<u16>,
    #[command(flatten)]
    pub(super) movie_rate: MovieRate,
    /// Light the volume softly: smoothed, with shadows and light that goes through thin parts. The
    /// preset (portrait, bone, vessel, glass) has opacities of its own, unless --transfer gives
    /// them
    #[arg(long, value_name = "PRESET", conflicts_with_all = ["part", "composite", "parts", "adaptive"])]
    pub(super) soft: Option<String>,
    /// Threads; any number gives the same picture [default: one a core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(super) threads: Option<u16>,
    /// Memory limit for the volume, GiB; an OME-Zarr volume that takes more is rendered in parts
    #[arg(long, value_name = "GIB", default_value_t = MAX_MEMORY)]
    pub(super) max_memory: f64,
    /// Level of an OME-Zarr volume, 0 for the finest [default: 0]
    #[arg(long, value_name = "K")]
    pub(super) level: Option<usize>,
    /// Render the K-th of N parts of an OME-Zarr volume, from 1, and write a message for
    /// --composite
    #[arg(long, value_name = "K/N", conflicts_with_all = ["parts", "turntable", "composite"])]
    pub(super) part: Option<Part>,
    /// Composite the blocks of each ray before they are written: a short message, for 100 parts or
    /// more; the picture differs by at most a grey level
    #[arg(long, requires = "part")]
    pub(super) fold: bool,
    /// Make the picture of the messages of all parts; the other flags are those of the parts
    #[arg(long, value_name = "FILE", num_args = 1.., conflicts_with_all = ["parts", "turntable"])]
    pub(super) composite: Vec<PathBuf>,
    #[command(flatten)]
    pub(super) json: JsonFlag,
    #[command(flatten)]
    pub(super) view_flags: ViewFlags,
}

// clap takes an array for its own notation of repeated values; a named type is a single value to
// it.
type WindowValue = [f32; 2];
