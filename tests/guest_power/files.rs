//! Files that are replaced again and again. Their content follows from their version, so that a
//! file can be told from half of one.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use calibration::file::CalibrationFile;
use formats::image::VolumeHeader;
use formats::image::write::VolumeWriter;
use sonoweave_core::reading::PixelType;

use crate::recording::noise;

/// A kind of file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// A volume in one file.
    Volume,
    /// A volume with a separate header.
    Pair,
    Calibration,
}

pub(crate) const KINDS: [Kind; 3] = [Kind::Volume, Kind::Pair, Kind::Calibration];

impl Kind {
    /// Returns the names of its files.
    fn names(self) -> &'static [&'static str] {
        match self {
            Self::Volume => &["volume.mha"],
            Self::Pair => &["pair.mhd", "pair.raw"],
            Self::Calibration => &["calibration.toml"],
        }
    }

    /// Saves a version in a folder, as the program saves all files.
    pub(crate) fn save(self, folder: &Path, version: u64) -> Result<(), String> {
        let path = folder.join(self.names()[0]);
        if self == Self::Calibration {
            let provenance = format!("version {version}: {}", "a long report; ".repeat(300));
            let file = CalibrationFile { provenance, ..CalibrationFile::default() };
            return file.write(&path).map_err(|error| error.to_string());
        }
        let size = [64, 64, 16];
        let mut header = VolumeHeader::new(size, PixelType::U8);
        header.spacing = [1.0 + version as f64; 3];
        let save = || {
            let mut volume = VolumeWriter::create(&path, &header).map_err(|error| error.to_string())?;
            volume.write_all(&noise(version, size.iter().product::<u32>() as usize)).map_err(|e| e.to_string())?;
            volume.finish().map_err(|error| error.to_string())
        };
        save()
    }

    /// Returns its present version, of those permitted; 0 if there is none. Fails for a file that
    /// is none of them, whole.
    pub(crate) fn version(self, folder: &Path, permitted: &[u64]) -> u64 {
        let read = |folder: &Path| -> Vec<Option<Vec<u8>>> {
            self.names().iter().map(|name| std::fs::read(folder.join(name)).ok()).collect()
        };
        let there = read(folder);
        if there[0].is_none() && permitted.contains(&0) {
            return 0;
        }
        let expected = Path::new("/tmp/expected");
        std::fs::create_dir_all(expected).unwrap();
        for version in permitted.iter().filter(|version| **version > 0) {
            self.save(expected, *version).unwrap();
            if read(expected) == there {
                return *version;
            }
        }
        let sizes: Vec<Option<usize>> = there.iter().map(|file| file.as_ref().map(Vec::len)).collect();
        panic!("{self:?}: files of {sizes:?} bytes are none of the versions {permitted:?}");
    }
}

/// Removes temporary files, which a power cut may leave; returns their number. Fails if there is
/// any other file but those of the kinds.
pub(crate) fn tidy(folder: &Path) -> usize {
    let names = KINDS.iter().flat_map(|kind| kind.names());
    let known: Vec<PathBuf> = names.map(|name| folder.join(name)).collect();
    let mut removed = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if known.contains(&path) {
            continue;
        }
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        assert!(name.starts_with(".sonoweave-") && name.ends_with(".part"), "{name}");
        std::fs::remove_file(&path).unwrap();
        removed += 1;
    }
    removed
}
