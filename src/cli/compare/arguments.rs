//! Flags of `compare`.

use std::path::PathBuf;

use clap::Args;

use crate::app::json::JsonFlag;

/// Flags of `compare`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Only voxels that are seen in both volumes count. A voxel is seen by its weight, if weights are given; else by the \
header's unseen value; else always. Filled holes count as unseen.

Volumes on the same lattice are compared voxel by voxel, whatever their extents. For other volumes, --resample \
interpolates the second one at the voxels of the first. The interpolation is trilinear, which smooths, and needs all \
neighbours to be seen.

The exit code is 0 whatever the difference, unless --limit is given.

Examples:
  sonoweave compare volume.mha truth.mha --weights weights.mha -o difference.png
  sonoweave compare a.mha b.mha --json --limit 1.5")]
pub struct Arguments {
    /// First volume (.mha), which the second is subtracted from
    pub(super) first: PathBuf,
    /// Second volume (.mha)
    pub(super) second: PathBuf,
    /// First volume's weights, as `reconstruct --weights` wrote them
    #[arg(long, value_name = "FILE.mha")]
    pub(super) weights: Option<PathBuf>,
    /// Second volume's weights
    #[arg(long, value_name = "FILE.mha")]
    pub(super) other_weights: Option<PathBuf>,
    /// Interpolate the second volume at the first one's voxels if their lattices differ
    #[arg(long)]
    pub(super) resample: bool,
    /// Draw the difference in the first volume's three middle planes: blue if the first is
    /// lower, orange if it is higher
    #[arg(short, long, value_name = "DIFF.png")]
    pub(super) output: Option<PathBuf>,
    /// Fail, with exit code 1, if the root mean square of the difference is larger
    #[arg(long, value_name = "RMSE", allow_hyphen_values = true)]
    pub(super) limit: Option<f64>,
    #[command(flatten)]
    pub(super) json: JsonFlag,
    /// Memory limit for the volumes and their difference, GiB
    #[arg(long, value_name = "GIB", default_value_t = 8.0)]
    pub(super) max_memory: f64,
}
