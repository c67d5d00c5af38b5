//! Writes the shards of level 0.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::error::{BadShard, OmeZarrError};
use crate::extent::ShardIndex;
use crate::folder;
use crate::gauge::Gauge;
use crate::log::{Log, ShardFile};
use crate::meta::Meta;
use crate::metadata::Kind;
use crate::scalar::{Sample, Samples, Scalar};
use crate::shard::{ShardCodec, pad};

/// Writes shards of an unfinished volume, in any order and by several threads; the bytes are the
/// same. Each is synced.
pub struct ShardWriter {
    /// The volume, and the folder in which it is written.
    pub(crate) path: PathBuf,
    pub(crate) part: PathBuf,
    pub(crate) meta: Meta,
    pub(crate) values: ShardCodec,
    pub(crate) weights: ShardCodec,
    label: Option<ShardCodec>,
    log: Mutex<Log>,
    pub(crate) gauge: Gauge,
}

/// A volume's path and codecs, before anything is written.
pub(crate) struct Prepared {
    pub(crate) path: PathBuf,
    pub(crate) part: PathBuf,
    meta: Meta,
    values: ShardCodec,
    weights: ShardCodec,
    label: Option<ShardCodec>,
}

impl Prepared {
    /// Checks that a description can be written there.
    pub(crate) fn new(path: &Path, meta: &Meta) -> Result<Self, OmeZarrError> {
        meta.check().map_err(|source| OmeZarrError::Unwritable { path: path.into(), source })?;
        // The folder behind a link is replaced, and the link stays.
        let behind = if path.is_symlink() { fs::canonicalize(path).ok() } else { None };
        let path = behind.as_deref().unwrap_or(path);
        folder::check_target(path)?;
        let codec = |kind| {
            let array =
                |problem| OmeZarrError::Array { path: path.into(), key: format!("{}0", Kind::prefix(kind)), problem };
            ShardCodec::new(meta, kind).map_err(array)
        };
        let (values, weights) = (codec(Kind::Value)?, codec(Kind::Weight)?);
        let label = meta.label.then(|| codec(Kind::Seen)).transpose()?;
        let (part, path) = (folder::unfinished(path), path.into());
        Ok(Self { path, part, meta: meta.clone(), values, weights, label })
    }

    /// Returns the writer of shards that are entered into this log.
    pub(crate) fn writer(self, log: Log) -> ShardWriter {
        let Self { path, part, meta, values, weights, label } = self;
        ShardWriter { path, part, meta, values, weights, label, log: Mutex::new(log), gauge: Gauge::default() }
    }
}

impl ShardWriter {
    /// Returns the hash of the description.
    pub(crate) fn fingerprint(&self) -> String {
        self.log().fingerprint().to_owned()
    }

    /// Returns the description.
    pub fn meta(&self) -> &Meta {
        &self.meta
    }

    /// Returns whether a shard is written, or left out.
    pub fn is_done(&self, level: usize, index: ShardIndex) -> bool {
        let log = self.log();
        self.meta.kinds().iter().all(|kind| log.has(&key(*kind, level, index)))
    }

    /// Returns the most shards that were in memory at once, those of all threads together.
    pub fn most_shards_in_memory(&self) -> usize {
        self.gauge.most()
    }

    /// Writes a shard of level 0. `values` and `weights` are those of its voxels within the array,
    /// x fastest ([`Extent::shard_size`](crate::Extent::shard_size)). Voxels of weight 0 are
    /// unseen, and their values are ignored; filled ones have a negative weight. A shard without
    /// seen or filled voxels gets no file.
    ///
    /// A shard may be written again; its parents are then written again, too.
    ///
    /// # Errors
    /// [`OmeZarrError`] when there is no such shard, the slices have another length or type, a
    /// voxel is not finite, or the files cannot be written.
    pub fn write_shard(&self, index: ShardIndex, values: Samples<'_>, weights: &[f32]) -> Result<(), OmeZarrError> {
        match values {
            Samples::U8(values) if self.meta.scalar == Scalar::U8 => self.write_level_0(index, values, weights),
            Samples::U16(values) if self.meta.scalar == Scalar::U16 => self.write_level_0(index, values, weights),
            Samples::F32(values) if self.meta.scalar == Scalar::F32 => self.write_level_0(index, values, weights),
            other => {
                let (given, expected) = (other.scalar().name(), self.meta.scalar.name());
                Err(self.bad(0, index, BadShard::Type { given, expected }))
            }
        }
    }

    /// Like [`Self::write_shard`], for values in single precision, which must be numbers of the
    /// volume's scalar type.
    ///
    /// # Errors
    /// Same as [`Self::write_shard`].
    pub fn write_numbers(&self, index: ShardIndex, values: &[f32], weights: &[f32]) -> Result<(), OmeZarrError> {
        match self.meta.scalar {
            Scalar::U8 => {
                let values: Vec<u8> = values.iter().map(|value| *value as u8).collect();
                self.write_level_0(index, &values, weights)
            }
            Scalar::U16 => {
                let values: Vec<u16> = values.iter().map(|value| *value as u16).collect();
                self.write_level_0(index, &values, weights)
            }
            Scalar::F32 => self.write_level_0(index, values, weights),
        }
    }

    fn write_level_0<T: Sample>(&self, index: ShardIndex, values: &[T], weights: &[f32]) -> Result<(), OmeZarrError> {
        let size = self.size(0, index)?;
        let expected = size.iter().product();
        for (what, given) in [("values", values.len()), ("weights", weights.len())] {
            if given != expected {
                return Err(self.bad(0, index, BadShard::Length { what, given, expected }));
            }
        }
        for (at, (value, weight)) in values.iter().zip(weights).enumerate() {
            let what = if !weight.is_finite() { "a weight" } else { "a value" };
            if !weight.is_finite() || (*weight != 0.0 && !value.is_valid()) {
                return Err(self.bad(0, index, BadShard::NotFinite { what, at }));
            }
        }
        let unseen = T::of_unseen(self.meta.unseen);
        let (edge, voxels) = self.edge_and_voxels();
        // Neither other values of unseen voxels nor the sign of 0 shall make a difference.
        let is_plain = |value: &T, weight: &f32| *weight != 0.0 || (weight.to_bits() == 0 && value.is_same(unseen));
        if size == [edge; 3] && values.iter().zip(weights).all(|(value, weight)| is_plain(value, weight)) {
            return self.store(0, index, values, weights);
        }
        let _counted = self.gauge.take(2);
        let (mut whole_values, mut whole_weights) = (vec![unseen; voxels], vec![0.0; voxels]);
        pad(values, size, edge, &mut whole_values);
        pad(weights, size, edge, &mut whole_weights);
        for (value, weight) in whole_values.iter_mut().zip(&mut whole_weights) {
            if *weight == 0.0 {
                (*value, *weight) = (unseen, 0.0);
            }
        }
        self.store(0, index, &whole_values, &whole_weights)
    }

    /// Leaves out a shard of level 0, in which nothing was seen.
    ///
    /// # Errors
    /// [`OmeZarrError`] when there is no such shard, or the log cannot be written.
    pub fn leave_out(&self, index: ShardIndex) -> Result<(), OmeZarrError> {
        self.size(0, index)?;
        self.reopen_parents(0, index)?;
        self.meta.kinds().iter().try_for_each(|kind| self.store_file(&key(*kind, 0, index), None))
    }

    /// Writes the files of a whole shard.
    pub(crate) fn store<T: Sample>(
        &self,
        level: usize,
        index: ShardIndex,
        values: &[T],
        weights: &[f32],
    ) -> Result<(), OmeZarrError> {
        self.reopen_parents(level, index)?;
        let _counted = self.gauge.take(1);
        let unseen = T::of_unseen(self.meta.unseen);
        self.store_encoded(Kind::Value, level, index, self.values.encode(values, unseen))?;
        self.store_encoded(Kind::Weight, level, index, self.weights.encode(weights, 0.0))?;
        if let Some(label) = &self.label {
            let seen: Vec<u8> = weights.iter().map(|weight| u8::from(*weight > 0.0)).collect();
            self.store_encoded(Kind::Seen, level, index, label.encode(&seen, 0))?;
        }
        Ok(())
    }

    fn store_encoded(
        &self,
        kind: Kind,
        level: usize,
        index: ShardIndex,
        file: Result<Option<Vec<u8>>, String>,
    ) -> Result<(), OmeZarrError> {
        let key = key(kind, level, index);
        let file =
            file.map_err(|problem| OmeZarrError::Array { path: self.part.clone(), key: key.clone(), problem })?;
        self.store_file(&key, file.as_deref())
    }

    /// Writes a shard's file, or removes it, and enters it into the log.
    fn store_file(&self, key: &str, file: Option<&[u8]>) -> Result<(), OmeZarrError> {
        let path = self.part.join(key);
        match file {
            Some(bytes) => folder::write_file(&path, bytes)?,
            None => match fs::remove_file(&path) {
                Err(error) if error.kind() != ErrorKind::NotFound => {
                    return Err(OmeZarrError::io(path, "removing")(error));
                }
                _ => {}
            },
        }
        let file = file.map(ShardFile::of);
        self.log().enter(key, file)
    }

    /// Marks the parents of a shard, which will have other children.
    fn reopen_parents(&self, level: usize, index: ShardIndex) -> Result<(), OmeZarrError> {
        let mut log = self.log();
        let mut index = index;
        for parent in level + 1..self.meta.extent.levels() {
            index = index.map(|at| at / 2);
            for kind in self.meta.kinds() {
                log.reopen(&key(*kind, parent, index))?;
            }
        }
        Ok(())
    }

    pub(crate) fn size(&self, level: usize, index: ShardIndex) -> Result<[usize; 3], OmeZarrError> {
        self.meta.extent.shard_size(level, index).ok_or_else(|| self.bad(level, index, BadShard::Outside))
    }

    pub(crate) fn edge_and_voxels(&self) -> (usize, usize) {
        let edge = self.meta.extent.shard as usize;
        (edge, edge.pow(3))
    }

    pub(crate) fn bad(&self, level: usize, index: ShardIndex, source: BadShard) -> OmeZarrError {
        OmeZarrError::Shard { path: self.path.clone(), key: key(Kind::Value, level, index), source }
    }

    pub(crate) fn log(&self) -> MutexGuard<'_, Log> {
        // A line is entered as a whole, or the next writer finds that it is missing.
        self.log.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Returns the file of a shard, as a path in the volume.
pub(crate) fn key(kind: Kind, level: usize, [z, y, x]: ShardIndex) -> String {
    format!("{}{level}/c/{z}/{y}/{x}", kind.prefix())
}
