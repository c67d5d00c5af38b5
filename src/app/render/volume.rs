//! A volume to render: in memory, or a level of an OME-Zarr volume whose chunks are read when they
//! are needed.

use std::path::Path;
use std::sync::Arc;

use ome_zarr::{ChunkWork, LevelValues, OmeZarr};
use simd::team::Team;
use volume::{DenseVolume, PlacedHeader, Values};

use crate::app::input::hash;
use crate::app::reconstruct::zarr::is_ome_zarr;
use crate::app::volume_input::holds_weights;
use crate::failure::{Failure, FailureKind};

/// Part of the memory limit that is for chunks.
const OF_CHUNKS: u64 = 4;

/// A volume to render.
#[allow(clippy::large_enum_variant, reason = "few, and never moved")]
pub(crate) enum RenderVolume {
    /// All voxels in memory.
    Dense(Arc<DenseVolume>),
    /// A level on the disk.
    Level(LevelOnDisk),
}

/// A level of an OME-Zarr volume.
pub(crate) struct LevelOnDisk {
    pub(crate) values: LevelValues,
    pub(crate) number: usize,
    /// SHA-256 of the root's metadata, which name the content.
    pub(crate) key: String,
    notes: Vec<String>,
}

impl RenderVolume {
    /// Opens a volume within a limit of memory. `level` is that of an OME-Zarr volume, by default
    /// the finest.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be read, memory does not suffice, weights are given twice, or
    /// there is no such level.
    pub(crate) fn open(
        path: &Path,
        weights: Option<&Path>,
        level: Option<usize>,
        limit_bytes: u64,
    ) -> Result<Self, Failure> {
        if !is_ome_zarr(path) {
            if level.is_some() {
                fail_usage!("--level: {} has no levels, which OME-Zarr volumes have; leave it out", path.display());
            }
            return Ok(Self::Dense(Arc::new(DenseVolume::open(path, weights, limit_bytes)?)));
        }
        if let Some(weights) = weights {
            return Err(holds_weights(path, weights));
        }
        let volume = Arc::new(OmeZarr::open(path)?);
        let number = level.unwrap_or(0);
        let values = LevelValues::new(&volume, number, limit_bytes / OF_CHUNKS)?;
        let chunk_bytes = values.chunk_bytes();
        if chunk_bytes > limit_bytes / OF_CHUNKS {
            return Err(Failure::new(format!(
                "{}: a chunk takes {} MB, more than a quarter of --max-memory; raise it, or write the volume in smaller \
                 chunks",
                path.display(),
                chunk_bytes.div_ceil(1_000_000)
            ))
            .of(FailureKind::Memory));
        }
        let key = hash(&path.join("zarr.json"))?;
        Ok(Self::Level(LevelOnDisk { values, number, key, notes: volume.notes().to_vec() }))
    }

    /// Returns the values and weights.
    pub(crate) fn values(&self) -> &dyn Values {
        match self {
            Self::Dense(dense) => &**dense,
            Self::Level(level) => &level.values,
        }
    }

    /// Returns the header, and the voxels' place.
    pub(crate) fn placed(&self) -> &PlacedHeader {
        match self {
            Self::Dense(dense) => dense.placed(),
            Self::Level(level) => level.values.placed(),
        }
    }

    /// Returns values of black and white; for those of a level on the disk, all of it may be read.
    pub(crate) fn range(&self, team: Option<&Team>) -> [f32; 2] {
        match self {
            Self::Dense(dense) => dense.range(),
            Self::Level(level) => level.values.range(team),
        }
    }

    /// Returns the number of seen voxels, if all were read.
    pub(crate) fn seen(&self) -> Option<u64> {
        match self {
            Self::Dense(dense) => Some(dense.seen()),
            Self::Level(_) => None,
        }
    }

    /// Whether voxels have weights of their own.
    pub(crate) fn has_weights(&self) -> bool {
        match self {
            Self::Dense(dense) => dense.has_weights(),
            Self::Level(level) => level.values.has_weights(),
        }
    }

    /// Returns the number of the level, and the work of reading it, for a level on the disk.
    pub(crate) fn level(&self) -> Option<(usize, ChunkWork)> {
        match self {
            Self::Dense(_) => None,
            Self::Level(level) => Some((level.number, level.values.work())),
        }
    }

    /// Refuses a volume of which a chunk could not be read so far.
    ///
    /// # Errors
    /// [`Failure`] with the first error.
    pub(crate) fn check(&self) -> Result<(), Failure> {
        match self {
            Self::Level(level) => level.values.fault().map_or(Ok(()), |error| Err(error.into())),
            Self::Dense(_) => Ok(()),
        }
    }

    /// Returns notes for the user, about the voxels that were read; `path` is the volume's.
    pub(crate) fn notes(&self, path: &Path) -> Vec<String> {
        let (mut notes, is_empty) = match self {
            Self::Dense(dense) => (dense.notes().to_vec(), dense.seen() == 0),
            Self::Level(level) => {
                let mut notes = level.notes.clone();
                if level.values.has_not_finite() {
                    notes.push("some voxels have a value that is not finite: they count as not seen".into());
                }
                (notes, level.values.bricks().next().is_none())
            }
        };
        if is_empty {
            notes.push(format!("{}: no voxel was seen, so the picture is all background", path.display()));
        }
        notes
    }
}
