//! Files written beside a volume.

use std::path::{Path, PathBuf};

use crate::failure::Failure;

/// Files beside a volume; for several recordings, the folders for each one's.
#[derive(Debug, Clone, Default)]
pub(crate) struct Beside {
    /// The weights: 0 for unseen voxels, −1 for filled ones.
    pub(crate) weights: Option<PathBuf>,
    /// The standard errors; −1 for unseen voxels.
    pub(crate) errors: Option<PathBuf>,
    /// A picture of the three middle planes; filled voxels are tinted.
    pub(crate) planes: Option<PathBuf>,
    /// The report, as JSON.
    pub(crate) json: Option<PathBuf>,
}

/// Suffixes of a recording's files in such folders.
const ENDS: [&str; 4] = ["weights.mha", "error.mha", "planes.png", "json"];

impl Beside {
    /// Returns each given path.
    pub(super) fn all(&self) -> impl Iterator<Item = &Path> {
        [&self.weights, &self.errors, &self.planes, &self.json].into_iter().flatten().map(PathBuf::as_path)
    }

    /// Checks, for several recordings, that the given paths are folders, in which each recording
    /// has a file.
    ///
    /// # Errors
    /// [`Failure`] with the first that is no folder.
    pub(super) fn check_folders(&self) -> Result<(), Failure> {
        let given = [
            ("--weights ", &self.weights),
            ("--error ", &self.errors),
            ("--planes ", &self.planes),
            ("--json=", &self.json),
        ];
        for ((flag, path), end) in given.into_iter().zip(ENDS) {
            if let Some(path) = path.as_deref().filter(|path| !path.is_dir()) {
                fail_usage!(
                    "{flag}{}: is not a folder, but several recordings need one for their files (NAME.{end}); make \
                    the folder, or give that of -o",
                    path.display()
                );
            }
        }
        Ok(())
    }

    /// Returns the files in these folders for the recording of that name.
    pub(super) fn of(&self, name: &str) -> Self {
        let file =
            |folder: &Option<PathBuf>, end: &str| folder.as_ref().map(|folder| folder.join(format!("{name}.{end}")));
        let [weights, errors, planes, json] = ENDS;
        Self {
            weights: file(&self.weights, weights),
            errors: file(&self.errors, errors),
            planes: file(&self.planes, planes),
            json: file(&self.json, json),
        }
    }
}
