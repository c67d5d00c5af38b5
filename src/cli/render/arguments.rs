//! Flags of `render`.

use std::path::PathBuf;

use clap::Args;

use super::view_flags::ViewFlags;
use crate::app::json::JsonFlag;
use crate::cli::values;

/// Flags of `render`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
With --weights, unseen voxels differ from seen black ones. For a volume from `reconstruct --type f32` with its \
weights, the picture equals the last picture of `replay`.

Example: sonoweave render volume.mha --weights weights.mha -o picture.png --view 30,20 --transfer bone")]
pub struct Arguments {
    /// Volume (.mha, .mhd, .nrrd, .nhdr, .nii, .nii.gz)
    pub(super) volume: PathBuf,
    /// Write the picture to this file (.png)
    #[arg(short, long, value_name = "IMG.png")]
    pub(super) output: PathBuf,
    /// Volume's weights, as `reconstruct --weights` wrote them: 0 marks unseen voxels
    #[arg(long, value_name = "FILE.mha")]
    pub(super) weights: Option<PathBuf>,
    /// Grey values that are black and white to presets [default: those of the scanner's image if
    /// the file gives them, else of the scalar type, else the smallest and the largest]
    #[arg(long, value_name = "LO,HI", value_parser = values::window, allow_hyphen_values = true)]
    pub(super) window: Option<WindowValue>,
    /// Draw so many pictures all around the vertical: IMG-000.png, IMG-001.png, …
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=3600))]
    pub(super) turntable: Option<u16>,
    /// Threads; any number gives the same picture [default: one a core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(super) threads: Option<u16>,
    /// Memory limit for the volume, GiB
    #[arg(long, value_name = "GIB", default_value_t = 8.0)]
    pub(super) max_memory: f64,
    #[command(flatten)]
    pub(super) json: JsonFlag,
    #[command(flatten)]
    pub(super) view_flags: ViewFlags,
}

// clap takes an array for its own notation of repeated values; a named type is a single value to
// it.
type WindowValue = [f32; 2];
