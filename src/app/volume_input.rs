//! Volumes as commands read them: files of all formats, and OME-Zarr folders.

use std::path::Path;
use std::sync::Arc;

use formats::Limits;
use formats::image::{VolumeReader, VolumeSlices};
use ome_zarr::{OmeZarr, SliceReader};
use volume::DenseVolume;

use crate::app::reconstruct::zarr::is_ome_zarr;
use crate::failure::Failure;

/// Header field with the recording's name and hash.
pub(crate) const INPUT_FIELD: &str = "SonoweaveInput";
/// Header field with the volume's frame.
pub(crate) const FRAME_FIELD: &str = "SonoweaveFrame";

/// Returns a field of a volume's header.
pub(crate) fn field<'a>(fields: &'a [(String, String)], name: &str) -> Option<&'a str> {
    fields.iter().find(|(n, _)| n == name).map(|(_, value)| value.as_str())
}

/// A volume that is read slice by slice, with its weights if it holds them itself.
pub(crate) struct VolumeInput {
    pub(crate) values: Box<dyn VolumeSlices>,
    pub(crate) weights: Option<Box<dyn VolumeSlices>>,
}

impl VolumeInput {
    /// Opens a volume, the finest level if it is OME-Zarr.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be read.
    pub(crate) fn open(path: &Path) -> Result<Self, Failure> {
        if !is_ome_zarr(path) {
            return Ok(Self { values: Box::new(VolumeReader::open(path, &Limits::default())?), weights: None });
        }
        let volume = Arc::new(OmeZarr::open(path)?);
        let values = Box::new(SliceReader::values(&volume, 0)?);
        let weights = volume.has_weights().then(|| SliceReader::weights(&volume, 0)).transpose()?;
        Ok(Self { values, weights: weights.map(|weights| Box::new(weights) as Box<dyn VolumeSlices>) })
    }

    /// Like [`Self::open`], with a file of weights.
    ///
    /// # Errors
    /// [`Failure`] when a file cannot be read, or weights are given twice.
    pub(crate) fn open_with(path: &Path, weights: Option<&Path>) -> Result<Self, Failure> {
        let mut input = Self::open(path)?;
        if let Some(weights) = weights {
            if is_ome_zarr(path) {
                return Err(holds_weights(path, weights));
            }
            input.weights = Some(Box::new(VolumeReader::open(weights, &Limits::default())?));
        }
        Ok(input)
    }
}

/// Reads a whole volume, and its weights if there are any. The level of an OME-Zarr volume is the
/// finest that fits into memory; a note names it if it is not the finest of all.
///
/// # Errors
/// [`Failure`] when a file cannot be read, memory does not suffice, or weights are given twice.
pub(crate) fn dense(path: &Path, weights: Option<&Path>, limit_bytes: u64) -> Result<DenseVolume, Failure> {
    if !is_ome_zarr(path) {
        return Ok(DenseVolume::open(path, weights, limit_bytes)?);
    }
    if let Some(weights) = weights {
        return Err(holds_weights(path, weights));
    }
    let volume = Arc::new(OmeZarr::open(path)?);
    let mut notes = volume.notes().to_vec();
    let fits = |level: &usize| {
        let size = volume.grid(*level).ok()?.size;
        let voxels = size.into_iter().try_fold(1_u64, u64::checked_mul)?;
        (voxels.checked_mul(8)? <= limit_bytes).then_some(size)
    };
    let level = (0..volume.levels()).find(|level| fits(level).is_some()).unwrap_or(0);
    if level > 0 {
        let spacing = volume.grid(level)?.spacing.to_array().map(|mm| mm.to_string()).join("×");
        notes.push(format!(
            "the voxels of {spacing} mm are read (level {level}), as finer ones take more than --max-memory"
        ));
    }
    let values = SliceReader::values(&volume, level)?;
    let weights = SliceReader::weights(&volume, level)?;
    let mut dense = DenseVolume::read((path, values), Some((path, weights)), limit_bytes)?;
    dense.add_notes(notes);
    Ok(dense)
}

/// Returns the refusal of a file of weights for an OME-Zarr volume.
pub(crate) fn holds_weights(volume: &Path, weights: &Path) -> Failure {
    Failure::usage(format!(
        "{}: the volume {} holds its weights itself; leave the file out",
        weights.display(),
        volume.display()
    ))
}
