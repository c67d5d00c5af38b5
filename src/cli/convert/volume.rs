//! Flags of `convert` for volumes.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::app::convert::Changes;
use crate::app::convert::volume::{Converted, VolumeRequest};
use crate::cli::reconstruct::filling::FillFlags;
use crate::cli::{Failure, values};

/// Weights, filling and label of a volume.
#[derive(Debug, Args)]
pub(super) struct VolumeFlags {
    /// Weights of the input volume (an .ome.zarr volume has its own)
    #[arg(long, value_name = "FILE.mha")]
    weights: Option<PathBuf>,
    /// Write the volume's weights to this file: 0 for unseen voxels, −1 for filled ones
    #[arg(long, value_name = "FILE.mha")]
    write_weights: Option<PathBuf>,
    #[command(flatten)]
    filling: FillFlags,
    /// Add the label of seen voxels to an .ome.zarr volume, for viewers: 1 seen, 0 not
    #[arg(long)]
    seen_label: bool,
    /// Memory limit for filling, GiB
    #[arg(long, value_name = "GIB", default_value_t = 8.0, value_parser = values::positive)]
    max_memory: f64,
}

impl VolumeFlags {
    /// Whether a flag is given that applies to volumes only.
    pub(super) fn are_given(&self) -> bool {
        let Self { weights, write_weights, filling, seen_label, .. } = self;
        weights.is_some() || write_weights.is_some() || filling.filling().is_some() || *seen_label
    }

    /// Converts a volume.
    ///
    /// # Errors
    /// [`Failure`]: no output remains then, except shards that another run goes on with.
    pub(super) fn run(&self, input: &Path, output: &Path, changes: &Changes) -> Result<Converted, Failure> {
        VolumeRequest {
            input,
            weights: self.weights.as_deref(),
            output,
            written_weights: self.write_weights.as_deref(),
            filling: self.filling.filling(),
            label: self.seen_label,
            memory_bytes: (self.max_memory * f64::from(1 << 30)) as u64,
            changes,
        }
        .run()
    }
}
