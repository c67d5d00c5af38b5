//! Writes a volume shard by shard, and its pyramid.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use formats::whole::{sync_folder, write_whole};
use rayon::prelude::*;

use crate::error::{BadShard, OmeZarrError};
use crate::extent::ShardIndex;
use crate::folder;
use crate::gauge::Gauge;
use crate::log::{self, Log};
use crate::meta::Meta;
use crate::metadata::{self, FILE, Kind};
use crate::pyramid::halve;
use crate::scalar::{Sample, Samples, Scalar};
use crate::shard::{ShardCodec, pad};

/// Relation of a writer to an earlier one that did not finish.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Begun {
    /// There was none.
    New,
    /// There was one with the same description; its shards are kept.
    Continued {
        /// Files of shards, and shards without a file, that are done.
        shards: usize,
    },
    /// There was one with another description; its shards are deleted.
    Anew,
}

/// Writes a volume, whole or not at all.
///
/// Shards may be written in any order and by several threads; the bytes are the same. They are
/// written beside the volume, in `NAME.part`, and synced. [`Self::finish`] gives that folder the
/// volume's name. If a writer ends before, the next one with the same description goes on.
pub struct OmeZarrWriter {
    path: PathBuf,
    part: PathBuf,
    meta: Meta,
    /// Text of the root's metadata, which is written last.
    root: String,
    values: ShardCodec,
    weights: ShardCodec,
    label: Option<ShardCodec>,
    log: Mutex<Log>,
    gauge: Gauge,
}

impl OmeZarrWriter {
    /// Begins a volume, or goes on with an unfinished one of the same description.
    ///
    /// # Errors
    /// [`OmeZarrError`] when the description cannot be written, the path has something else than a
    /// volume, another program writes it, or files cannot be written. An earlier volume is
    /// unchanged.
    pub fn create(path: &Path, meta: &Meta) -> Result<(Self, Begun), OmeZarrError> {
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

        let part = folder::unfinished(path);
        let is_new = !part.exists();
        folder::create_unfinished(&part, log::NAME)?;
        let (mut log, begun_by) = Log::open(&part)?;
        let mut files = metadata::files(meta);
        let fingerprint = metadata::fingerprint(&files);
        let root = files.pop().map(|(_, text)| text).unwrap_or_default();
        let goes_on = begun_by.as_deref() == Some(&*fingerprint);
        if goes_on {
            log.keep_whole(&part);
            let is_metadata = |key: &str| files.iter().any(|(file, _)| file == key);
            folder::clean(&part, &|key| key == log::NAME || log.has_file(key) || is_metadata(key))?;
        } else {
            folder::clean(&part, &|key| key == log::NAME)?;
            log.restart(&fingerprint)?;
        }
        for (key, text) in &files {
            let file = part.join(key);
            if fs::read_to_string(&file).is_ok_and(|there| there == *text) {
                continue;
            }
            folder::write_file(&file, text.as_bytes())?;
        }
        let begun = match (is_new, goes_on) {
            (_, true) => Begun::Continued { shards: log.len() },
            (true, false) => Begun::New,
            (false, false) => {
                if begun_by.is_some() {
                    Begun::Anew
                } else {
                    Begun::New
                }
            }
        };
        let (log, gauge) = (Mutex::new(log), Gauge::default());
        let (path, meta) = (path.into(), meta.clone());
        Ok((Self { path, part, meta, root, values, weights, label, log, gauge }, begun))
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
        let _counted = self.gauge.take(2);
        let (mut whole_values, mut whole_weights) = (vec![unseen; voxels], vec![0.0; voxels]);
        pad(values, size, edge, &mut whole_values);
        pad(weights, size, edge, &mut whole_weights);
        for (value, weight) in whole_values.iter_mut().zip(&mut whole_weights) {
            if *weight == 0.0 {
                // Neither other values nor the sign of 0 shall make a difference.
                (*value, *weight) = (unseen, 0.0);
            }
        }
        self.store(0, index, &whole_values, whole_weights)
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

    /// Writes a shard of a coarser level, from its children on the disk: at most eight shards of
    /// the level before, each of which must be [done](Self::is_done). [`Self::finish`] writes
    /// those that are missing.
    ///
    /// # Errors
    /// [`OmeZarrError`] when there is no such shard, a child is not done or damaged, or the files
    /// cannot be written.
    pub fn write_parent(&self, level: usize, index: ShardIndex) -> Result<(), OmeZarrError> {
        if level == 0 {
            return Err(self.bad(level, index, BadShard::Outside));
        }
        self.size(level, index)?;
        let pending = self.children(level, index).find(|(child, _)| !self.is_done(level - 1, *child));
        match pending {
            Some((child, _)) => {
                let child = key(Kind::Value, level - 1, child);
                Err(self.bad(level, index, BadShard::Pending { child }))
            }
            None => self.write_mean(level, index),
        }
    }

    /// Writes the parent of shards of any type. Children that are not done have nothing seen.
    fn write_mean(&self, level: usize, index: ShardIndex) -> Result<(), OmeZarrError> {
        match self.meta.scalar {
            Scalar::U8 => self.write_mean_of::<u8>(level, index),
            Scalar::U16 => self.write_mean_of::<u16>(level, index),
            Scalar::F32 => self.write_mean_of::<f32>(level, index),
        }
    }

    fn write_mean_of<T: Sample>(&self, level: usize, index: ShardIndex) -> Result<(), OmeZarrError> {
        let unseen = T::of_unseen(self.meta.unseen);
        let (edge, voxels) = self.edge_and_voxels();
        let _counted = self.gauge.take(2);
        let (mut values, mut weights) = (vec![unseen; voxels], vec![0.0; voxels]);
        // Children that make a voxel of the parent lie in one shard, as its edge is even.
        for (child, octant) in self.children(level, index) {
            let [value_key, weight_key] = [Kind::Value, Kind::Weight].map(|kind| key(kind, level - 1, child));
            if !self.log().has_file(&weight_key) {
                continue;
            }
            let _counted = self.gauge.take(2);
            let child_weights = self.load(&self.weights, &weight_key)?;
            let has_values = self.log().has_file(&value_key);
            let child_values = if has_values { self.load(&self.values, &value_key)? } else { vec![unseen; voxels] };
            halve(edge, (&child_values, &child_weights), octant, (&mut values, &mut weights));
        }
        self.store(level, index, &values, weights)
    }

    /// Returns the children of a shard, with their octants.
    fn children(&self, level: usize, index: ShardIndex) -> impl Iterator<Item = (ShardIndex, [usize; 3])> + use<> {
        let shards = self.meta.extent.shards(level - 1);
        let octants = (0..8).map(|octant| [octant >> 2, octant >> 1 & 1, octant & 1]);
        octants.filter_map(move |octant| {
            let child: ShardIndex = std::array::from_fn(|a| 2 * index[a] + octant[a] as u64);
            (0..3).all(|a| child[a] < shards[a]).then_some((child, octant))
        })
    }

    /// Writes what is missing of the pyramid, then the root's metadata, and gives the volume its
    /// name. Shards of level 0 that were not written have nothing seen. An earlier volume of that
    /// name is replaced. On return the volume survives a power cut.
    ///
    /// # Errors
    /// [`OmeZarrError`] when a child is damaged or a file cannot be written. An earlier volume is
    /// unchanged, and another writer may go on.
    pub fn finish(self) -> Result<(), OmeZarrError> {
        for level in 1..self.meta.extent.levels() {
            let missing: Vec<ShardIndex> =
                self.meta.extent.shard_indices(level).filter(|index| !self.is_done(level, *index)).collect();
            missing.into_par_iter().try_for_each(|index| self.write_mean(level, index))?;
        }
        folder::check_target(&self.path)?;
        folder::sync_below(&self.part)?;
        let root = self.part.join(FILE);
        write_whole(&root, |to| to.write_all(self.root.as_bytes())).map_err(OmeZarrError::io(root, "writing"))?;
        folder::publish(&self.part, &self.path)?;
        // Not before: a log without its volume would be another's.
        let log = self.path.join(log::NAME);
        fs::remove_file(&log).and_then(|()| sync_folder(&self.path)).map_err(OmeZarrError::io(log, "removing"))
    }

    /// Writes the files of a whole shard.
    fn store<T: Sample>(
        &self,
        level: usize,
        index: ShardIndex,
        values: &[T],
        weights: Vec<f32>,
    ) -> Result<(), OmeZarrError> {
        self.reopen_parents(level, index)?;
        let _counted = self.gauge.take(1);
        let unseen = T::of_unseen(self.meta.unseen);
        self.store_encoded(Kind::Value, level, index, self.values.encode(values, unseen))?;
        self.store_encoded(Kind::Weight, level, index, self.weights.encode(&weights, 0.0))?;
        if let Some(label) = &self.label {
            let seen: Vec<u8> = weights.into_iter().map(|weight| u8::from(weight > 0.0)).collect();
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

    /// Reads a shard that is on the disk.
    fn load<T: Sample>(&self, codec: &ShardCodec, key: &str) -> Result<Vec<T>, OmeZarrError> {
        let _counted = self.gauge.take(1);
        let path = self.part.join(key);
        let file = fs::read(&path).map_err(OmeZarrError::io(&path, "reading"))?;
        codec.decode(file).map_err(|problem| OmeZarrError::Damaged {
            path: self.part.clone(),
            key: key.to_owned(),
            problem,
        })
    }

    fn size(&self, level: usize, index: ShardIndex) -> Result<[usize; 3], OmeZarrError> {
        self.meta.extent.shard_size(level, index).ok_or_else(|| self.bad(level, index, BadShard::Outside))
    }

    fn edge_and_voxels(&self) -> (usize, usize) {
        let edge = self.meta.extent.shard as usize;
        (edge, edge.pow(3))
    }

    fn bad(&self, level: usize, index: ShardIndex, source: BadShard) -> OmeZarrError {
        OmeZarrError::Shard { path: self.path.clone(), key: key(Kind::Value, level, index), source }
    }

    fn log(&self) -> MutexGuard<'_, Log> {
        // A line is entered as a whole, or the next writer finds that it is missing.
        self.log.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Returns the file of a shard, as a path in the volume.
fn key(kind: Kind, level: usize, [z, y, x]: ShardIndex) -> String {
    format!("{}{level}/c/{z}/{y}/{x}", kind.prefix())
}
