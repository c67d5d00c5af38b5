//! Flags for the files written beside a volume.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::app::json::JsonFlag;
use crate::app::reconstruct::beside::Beside;

/// Files beside a volume; for several recordings, the folders for each one's.
#[derive(Debug, Clone, Args)]
pub(in crate::cli) struct BesideFlags {
    /// Write the weights too: 0 for unseen voxels, −1 for filled ones
    #[arg(long, value_name = "FILE.mha")]
    pub(in crate::cli) weights: Option<PathBuf>,
    /// Write the standard error of each voxel, in grey levels, by the spread of the slices that
    /// reach it: −1 for unseen voxels. Needs an eighth more memory and the general path
    #[arg(long, value_name = "FILE.mha")]
    pub(in crate::cli) error: Option<PathBuf>,
    /// Draw the three middle planes; filled voxels are tinted
    #[arg(long, value_name = "FILE.png")]
    planes: Option<PathBuf>,
    #[command(flatten)]
    pub(in crate::cli) json: JsonFlag,
}

impl BesideFlags {
    /// Returns the files.
    pub(in crate::cli) fn beside(&self) -> Beside {
        let Self { weights, error, planes, json } = self.clone();
        Beside { weights, errors: error, planes, json: json.file().map(Path::to_owned) }
    }
}
