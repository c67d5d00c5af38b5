//! Chunks in memory, up to a limit; the one used longest ago goes first.

use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, PoisonError};

/// Index of a chunk along z, y, x.
type Key = [u64; 3];

/// Chunks by their index.
pub(crate) struct Cache<T> {
    limit: u64,
    chunks: Mutex<Chunks<T>>,
}

struct Chunks<T> {
    bytes: u64,
    /// Number of the last use.
    uses: u64,
    by_key: HashMap<Key, Entry<T>>,
    by_use: BTreeMap<u64, Key>,
}

struct Entry<T> {
    chunk: Arc<T>,
    bytes: u64,
    last_use: u64,
}

impl<T> Cache<T> {
    /// Returns a cache that keeps chunks of at most `limit` bytes together.
    pub(crate) fn new(limit: u64) -> Self {
        let chunks = Chunks { bytes: 0, uses: 0, by_key: HashMap::new(), by_use: BTreeMap::new() };
        Self { limit, chunks: Mutex::new(chunks) }
    }

    /// Returns a chunk, if it is there.
    pub(crate) fn get(&self, key: Key) -> Option<Arc<T>> {
        let mut all = self.chunks.lock().unwrap_or_else(PoisonError::into_inner);
        let Chunks { uses, by_key, by_use, .. } = &mut *all;
        let entry = by_key.get_mut(&key)?;
        *uses += 1;
        by_use.remove(&entry.last_use);
        by_use.insert(*uses, key);
        entry.last_use = *uses;
        Some(entry.chunk.clone())
    }

    /// Keeps a chunk of `bytes`, unless it alone exceeds the limit.
    pub(crate) fn put(&self, key: Key, chunk: Arc<T>, bytes: u64) {
        if bytes > self.limit {
            return;
        }
        let mut all = self.chunks.lock().unwrap_or_else(PoisonError::into_inner);
        all.remove(key);
        while all.bytes + bytes > self.limit {
            let Some((_, oldest)) = all.by_use.first_key_value() else { break };
            let oldest = *oldest;
            all.remove(oldest);
        }
        all.uses += 1;
        let last_use = all.uses;
        all.bytes += bytes;
        all.by_use.insert(last_use, key);
        all.by_key.insert(key, Entry { chunk, bytes, last_use });
    }

    /// Returns the bytes of all chunks.
    #[cfg(test)]
    pub(crate) fn bytes(&self) -> u64 {
        self.chunks.lock().unwrap().bytes
    }
}

impl<T> Chunks<T> {
    fn remove(&mut self, key: Key) {
        if let Some(entry) = self.by_key.remove(&key) {
            self.by_use.remove(&entry.last_use);
            self.bytes -= entry.bytes;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunk_used_longest_ago_goes_first() {
        let cache = Cache::new(20);
        cache.put([1; 3], Arc::new("one"), 10);
        cache.put([2; 3], Arc::new("two"), 10);
        assert_eq!(cache.get([1; 3]).as_deref(), Some(&"one"));
        cache.put([3; 3], Arc::new("three"), 10);
        assert_eq!(cache.get([2; 3]), None);
        assert!(cache.get([1; 3]).is_some() && cache.get([3; 3]).is_some());
        cache.put([3; 3], Arc::new("again"), 5);
        assert_eq!((cache.get([3; 3]).as_deref(), cache.bytes()), (Some(&"again"), 15));
        cache.put([4; 3], Arc::new("large"), 21);
        assert_eq!((cache.get([4; 3]), cache.bytes()), (None, 15));
    }
}
