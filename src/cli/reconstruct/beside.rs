//! Flags that say what is written beside a volume.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::cli::Failure;

/// Files beside a volume; of several recordings, the folders for each one's.
#[derive(Debug, Clone, Default, Args)]
pub(in crate::cli) struct Beside {
    /// Write the weights too: 0 where nothing was seen, −1 where that was filled
    #[arg(long, value_name = "FILE.mha")]
    pub(in crate::cli) weights: Option<PathBuf>,
    /// Draw the three middle planes; what was filled is tinted
    #[arg(long, value_name = "FILE.png")]
    pub(in crate::cli) planes: Option<PathBuf>,
    /// Write what was done, as JSON
    #[arg(long, value_name = "FILE.json")]
    pub(in crate::cli) stats: Option<PathBuf>,
}

/// How the files end that a recording has in such folders.
const ENDS: [&str; 3] = ["weights.mha", "planes.png", "stats.json"];

impl Beside {
    /// Each that is given.
    pub(super) fn all(&self) -> impl Iterator<Item = &Path> {
        [&self.weights, &self.planes, &self.stats].into_iter().flatten().map(PathBuf::as_path)
    }

    /// Of several recordings: those that are given are folders, in which each has a file.
    ///
    /// # Errors
    /// [`Failure`] with the first that is none.
    pub(super) fn check_folders(&self) -> Result<(), Failure> {
        let given = [("--weights", &self.weights), ("--planes", &self.planes), ("--stats", &self.stats)];
        for ((flag, path), end) in given.into_iter().zip(ENDS) {
            if let Some(path) = path.as_deref().filter(|path| !path.is_dir()) {
                return Err(Failure(format!(
                    "{flag} {}: is no folder, and of several recordings each has a file of its own there (NAME.{end}): make the folder, or give the one of -o",
                    path.display()
                )));
            }
        }
        Ok(())
    }

    /// The files in these folders of the recording of that name.
    pub(super) fn of(&self, name: &str) -> Self {
        let file =
            |folder: &Option<PathBuf>, end: &str| folder.as_ref().map(|folder| folder.join(format!("{name}.{end}")));
        let [weights, planes, stats] = ENDS;
        Self {
            weights: file(&self.weights, weights),
            planes: file(&self.planes, planes),
            stats: file(&self.stats, stats),
        }
    }
}
