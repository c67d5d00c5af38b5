//! File formats for written images, chosen by file name.

use std::path::{Path, PathBuf};

use crate::Unwritable;

/// Format of a file, derived from its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Container {
    /// MetaImage in one file (`.mha`, `.igs.mha`).
    Mha,
    /// MetaImage with the pixels in a separate file (`.mhd` with `.raw` or `.zraw`).
    Mhd,
    /// NRRD in one file (`.nrrd`, `.igs.nrrd`).
    Nrrd,
    /// NRRD in one file, in the form of 3D Slicer's sequences (`.seq.nrrd`).
    SeqNrrd,
    /// NRRD with the pixels in a separate file (`.nhdr` with `.raw` or `.raw.gz`).
    Nhdr,
    /// A NIfTI volume (`.nii`).
    Nifti,
    /// A compressed NIfTI volume (`.nii.gz`).
    NiftiGz,
}

impl Container {
    /// File name endings of sequences.
    pub const SEQUENCES: &str = ".mha, .mhd, .nrrd, .seq.nrrd or .nhdr";
    /// File name endings of volumes.
    pub const VOLUMES: &str = ".mha, .mhd, .nrrd, .nhdr, .nii or .nii.gz";

    /// Returns the format by the end of the name, case-insensitively.
    pub fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
        let (stem, extension) = name.rsplit_once('.')?;
        Some(match extension {
            "mha" => Self::Mha,
            "mhd" => Self::Mhd,
            "nrrd" if stem.ends_with(".seq") => Self::SeqNrrd,
            "nrrd" => Self::Nrrd,
            "nhdr" => Self::Nhdr,
            "nii" => Self::Nifti,
            "gz" if stem.ends_with(".nii") => Self::NiftiGz,
            _ => return None,
        })
    }

    /// Returns the format for writing a sequence.
    ///
    /// # Errors
    /// [`Unwritable::FileName`].
    pub fn of_sequence(path: &Path) -> Result<Self, Unwritable> {
        let named = Self::of(path).filter(|container| !matches!(container, Self::Nifti | Self::NiftiGz));
        named.ok_or(Unwritable::FileName { content: "sequences", endings: Self::SEQUENCES })
    }

    /// Returns the format for writing a volume.
    ///
    /// # Errors
    /// [`Unwritable::FileName`].
    pub fn of_volume(path: &Path) -> Result<Self, Unwritable> {
        let named = Self::of(path).filter(|container| *container != Self::SeqNrrd);
        named.ok_or(Unwritable::FileName { content: "volumes", endings: Self::VOLUMES })
    }

    /// Returns the path of the separate pixel file beside `path`; `None` if the pixels follow
    /// the header.
    pub fn data_path(self, path: &Path, compressed: bool) -> Option<PathBuf> {
        self.data_file(path, compressed).map(|name| path.with_file_name(name))
    }

    /// Returns the name of the separate pixel file beside `path`; `None` if the pixels follow
    /// the header.
    pub(super) fn data_file(self, path: &Path, compressed: bool) -> Option<String> {
        let extension = match (self, compressed) {
            (Self::Mhd, false) | (Self::Nhdr, false) => "raw",
            (Self::Mhd, true) => "zraw",
            (Self::Nhdr, true) => "raw.gz",
            _ => return None,
        };
        Some(format!("{}.{extension}", path.file_stem()?.to_string_lossy()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn container_is_found_by_name() {
        let cases = [
            ("a.igs.mha", Some(Container::Mha)),
            ("A.MHD", Some(Container::Mhd)),
            ("a.igs.nrrd", Some(Container::Nrrd)),
            ("a.seq.nrrd", Some(Container::SeqNrrd)),
            ("b/a.nhdr", Some(Container::Nhdr)),
            ("a.nii", Some(Container::Nifti)),
            ("a.b.nii.gz", Some(Container::NiftiGz)),
            ("a.tar.gz", None),
            ("a.nrrd.bak", None),
            ("mha", None),
        ];
        for (name, container) in cases {
            assert_eq!(Container::of(Path::new(name)), container, "{name}");
        }
        assert!(matches!(
            Container::of_volume(Path::new("a.seq.nrrd")),
            Err(Unwritable::FileName { content: "volumes", .. })
        ));
        assert!(matches!(
            Container::of_sequence(Path::new("a.nii")),
            Err(Unwritable::FileName { content: "sequences", .. })
        ));
        assert_eq!(Container::Mhd.data_file(Path::new("b/a.igs.mhd"), true).unwrap(), "a.igs.zraw");
        assert_eq!(Container::Nhdr.data_file(Path::new("a.nhdr"), true).unwrap(), "a.raw.gz");
        assert_eq!(Container::Nrrd.data_file(Path::new("a.nrrd"), true), None);
    }
}
