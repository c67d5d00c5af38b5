//! Writes a whole volume: its shards, then its pyramid.

use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::path::Path;

use formats::whole::{sync_folder, write_whole};
use rayon::prelude::*;

use crate::error::{BadShard, OmeZarrError};
use crate::extent::ShardIndex;
use crate::folder;
use crate::log::{self, Log, ShardFile};
use crate::meta::Meta;
use crate::metadata::{self, FILE, Kind};
use crate::pyramid::halve;
use crate::region;
use crate::scalar::{Sample, Scalar};
use crate::shard::ShardCodec;
use crate::shards::{Prepared, ShardWriter, key};

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
/// Shards are written beside the volume, in `NAME.part`. [`Self::finish`] gives that folder the
/// volume's name. If a writer ends before, the next one with the same description goes on. It also
/// has the shards of all [`RegionWriter`](crate::RegionWriter)s of this description.
pub struct OmeZarrWriter {
    shards: ShardWriter,
    /// Text of the root's metadata, which is written last.
    root: String,
}

impl OmeZarrWriter {
    /// Begins a volume, or goes on with an unfinished one of the same description.
    ///
    /// # Errors
    /// [`OmeZarrError`] when the description cannot be written, the path has something else than a
    /// volume, another program writes it, or files cannot be written. An earlier volume is
    /// unchanged.
    pub fn create(path: &Path, meta: &Meta) -> Result<(Self, Begun), OmeZarrError> {
        let prepared = Prepared::new(path, meta)?;
        let part = &prepared.part;
        let is_new = !part.exists();
        folder::create_unfinished(part, log::NAME)?;
        let (mut log, begun_by) = Log::open(part)?;
        let mut files = metadata::files(meta);
        let fingerprint = metadata::fingerprint(&files);
        let root = files.pop().map(|(_, text)| text).unwrap_or_default();
        let goes_on = begun_by.as_deref() == Some(&*fingerprint);
        if goes_on {
            region::enter_all(part, &fingerprint, &mut log)?;
            log.keep_whole(part);
            let is_metadata = |key: &str| files.iter().any(|(file, _)| file == key);
            let is_kept = |key: &str| log::is_log(key) || key == region::PLAN || log.has_file(key) || is_metadata(key);
            folder::clean(part, &is_kept)?;
        } else {
            folder::clean(part, &|key| key == log::NAME)?;
            log.restart(&fingerprint)?;
        }
        for (key, text) in &files {
            let file = part.join(key);
            if fs::read_to_string(&file).is_ok_and(|there| there == *text) {
                continue;
            }
            folder::write_file(&file, text.as_bytes())?;
        }
        let begun = match (goes_on, begun_by) {
            (true, _) => Begun::Continued { shards: log.len() },
            (false, Some(_)) if !is_new => Begun::Anew,
            (false, _) => Begun::New,
        };
        Ok((Self { shards: prepared.writer(log), root }, begun))
    }

    /// Returns the writer of shards of level 0.
    pub fn shards(&self) -> &ShardWriter {
        &self.shards
    }

    /// Returns the notes of finished regions, by name ([`RegionWriter`](crate::RegionWriter)).
    ///
    /// # Errors
    /// [`OmeZarrError`] when their logs cannot be read.
    pub fn notes(&self) -> Result<BTreeMap<String, String>, OmeZarrError> {
        region::notes(&self.shards.part, &self.shards.fingerprint())
    }

    /// Writes a shard of a coarser level, from its children on the disk: at most eight shards of
    /// the level before, each of which must be [done](ShardWriter::is_done).
    /// [`Self::finish`] writes those that are missing.
    ///
    /// # Errors
    /// [`OmeZarrError`] when there is no such shard, a child is not done or damaged, or the files
    /// cannot be written.
    pub fn write_parent(&self, level: usize, index: ShardIndex) -> Result<(), OmeZarrError> {
        if level == 0 {
            return Err(self.shards.bad(level, index, BadShard::Outside));
        }
        self.shards.size(level, index)?;
        let pending = self.children(level, index).find(|(child, _)| !self.shards.is_done(level - 1, *child));
        match pending {
            Some((child, _)) => {
                let child = key(Kind::Value, level - 1, child);
                Err(self.shards.bad(level, index, BadShard::Pending { child }))
            }
            None => self.write_mean(level, index),
        }
    }

    /// Writes the parent of shards of any type. Children that are not done have nothing seen.
    fn write_mean(&self, level: usize, index: ShardIndex) -> Result<(), OmeZarrError> {
        match self.shards.meta.scalar {
            Scalar::U8 => self.write_mean_of::<u8>(level, index),
            Scalar::U16 => self.write_mean_of::<u16>(level, index),
            Scalar::F32 => self.write_mean_of::<f32>(level, index),
        }
    }

    fn write_mean_of<T: Sample>(&self, level: usize, index: ShardIndex) -> Result<(), OmeZarrError> {
        let unseen = T::of_unseen(self.shards.meta.unseen);
        let (edge, voxels) = self.shards.edge_and_voxels();
        let _counted = self.shards.gauge.take(2);
        let (mut values, mut weights) = (vec![unseen; voxels], vec![0.0; voxels]);
        // Children that make a voxel of the parent lie in one shard, as its edge is even.
        for (child, octant) in self.children(level, index) {
            let [value_key, weight_key] = [Kind::Value, Kind::Weight].map(|kind| key(kind, level - 1, child));
            if !self.shards.log().has_file(&weight_key) {
                continue;
            }
            let _counted = self.shards.gauge.take(2);
            let child_weights = self.load(&self.shards.weights, &weight_key)?;
            let has_values = self.shards.log().has_file(&value_key);
            let child_values =
                if has_values { self.load(&self.shards.values, &value_key)? } else { vec![unseen; voxels] };
            halve(edge, (&child_values, &child_weights), octant, (&mut values, &mut weights));
        }
        self.shards.store(level, index, &values, &weights)
    }

    /// Returns the children of a shard, with their octants.
    fn children(&self, level: usize, index: ShardIndex) -> impl Iterator<Item = (ShardIndex, [usize; 3])> + use<> {
        let shards = self.shards.meta.extent.shards(level - 1);
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
        for level in 1..self.shards.meta.extent.levels() {
            let missing: Vec<ShardIndex> = self
                .shards
                .meta
                .extent
                .shard_indices(level)
                .filter(|index| !self.shards.is_done(level, *index))
                .collect();
            missing.into_par_iter().try_for_each(|index| self.write_mean(level, index))?;
        }
        let Self { shards: ShardWriter { path, part, .. }, root } = &self;
        folder::check_target(path)?;
        folder::sync_below(part)?;
        let file = part.join(FILE);
        write_whole(&file, |to| to.write_all(root.as_bytes())).map_err(OmeZarrError::io(file, "writing"))?;
        folder::publish(part, path)?;
        // Not before: a log without its volume would be another's. It goes last.
        for file in [region::PLAN, log::REGIONS, log::NAME].map(|name| path.join(name)) {
            let removed = if file.is_dir() { fs::remove_dir_all(&file) } else { fs::remove_file(&file) };
            match removed {
                Err(error) if error.kind() != ErrorKind::NotFound => {
                    return Err(OmeZarrError::io(file, "removing")(error));
                }
                _ => {}
            }
        }
        sync_folder(path).map_err(OmeZarrError::io(path, "syncing"))
    }

    /// Reads a shard that is on the disk.
    fn load<T: Sample>(&self, codec: &ShardCodec, key: &str) -> Result<Vec<T>, OmeZarrError> {
        let _counted = self.shards.gauge.take(1);
        let path = self.shards.part.join(key);
        let file = fs::read(&path).map_err(OmeZarrError::io(&path, "reading"))?;
        let damaged = |problem| OmeZarrError::Damaged { path: self.shards.part.clone(), key: key.to_owned(), problem };
        // A decoder would not find all damage, and the pyramid would hold it.
        let hashed = ShardFile::of(&file);
        if !self.shards.log().is_entered(key, &hashed) {
            return Err(damaged("its bytes are not those that were written".into()));
        }
        codec.decode(file).map_err(damaged)
    }
}
