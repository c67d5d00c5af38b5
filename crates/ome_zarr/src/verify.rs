//! Compares the files of an unfinished volume with the hashes of its log.

use std::fs;

use rayon::prelude::*;

use crate::error::OmeZarrError;
use crate::log::ShardFile;
use crate::region::RegionWriter;

/// Result of a comparison of shards with their hashes.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Verified {
    /// Shards whose file has its hash.
    pub whole: usize,
    /// Keys of those with another, sorted.
    pub damaged: Vec<String>,
}

impl RegionWriter {
    /// Reads and hashes the files of all shards that are written, of all levels, and of values,
    /// weights and label each. Those that are missing, or have another length, count as not
    /// written.
    ///
    /// # Errors
    /// [`OmeZarrError`] when a file cannot be read.
    pub fn verify(&self) -> Result<Verified, OmeZarrError> {
        let keys = self.shards.log().keys_of_files();
        let are_whole = keys.par_iter().map(|key| {
            let path = self.shards.part.join(key);
            let file = fs::read(&path).map_err(OmeZarrError::io(&path, "reading"))?;
            let hashed = ShardFile::of(&file);
            Ok(self.shards.log().is_entered(key, &hashed))
        });
        let are_whole: Vec<bool> = are_whole.collect::<Result<_, OmeZarrError>>()?;
        let whole = are_whole.iter().filter(|is_whole| **is_whole).count();
        let damaged = keys.into_iter().zip(are_whole).filter(|(_, is_whole)| !is_whole).map(|(key, _)| key);
        Ok(Verified { whole, damaged: damaged.collect() })
    }

    /// Removes shards, so that they are written again.
    ///
    /// # Errors
    /// [`OmeZarrError`] when a file cannot be removed.
    pub fn remove(&self, keys: &[String]) -> Result<(), OmeZarrError> {
        keys.iter().try_for_each(|key| {
            let path = self.shards.part.join(key);
            fs::remove_file(&path).map_err(OmeZarrError::io(&path, "removing"))?;
            self.shards.log().forget(key);
            Ok(())
        })
    }
}
