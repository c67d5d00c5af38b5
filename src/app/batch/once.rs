//! Values that several rows of a manifest have in common.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Values by keys, each made once, however many rows and threads ask for it.
#[derive(Debug)]
pub(crate) struct Once<K, V>(Mutex<HashMap<K, Arc<OnceLock<V>>>>);

impl<K, V> Default for Once<K, V> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<K: Eq + Hash, V: Clone> Once<K, V> {
    /// Returns the value of a key, which `make` makes for the first that asks.
    pub(crate) fn get(&self, key: K, make: impl FnOnce() -> V) -> V {
        let place = Arc::clone(self.0.lock().unwrap_or_else(PoisonError::into_inner).entry(key).or_default());
        place.get_or_init(make).clone()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};

    use super::*;

    #[test]
    fn each_value_is_made_once_by_any_thread() {
        let (once, made) = (Once::default(), AtomicU32::new(0));
        let make = |key: u32| {
            made.fetch_add(1, Ordering::Relaxed);
            key * 10
        };
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| (0..100).for_each(|key| assert_eq!(once.get(key, || make(key)), key * 10)));
            }
        });
        assert_eq!(made.into_inner(), 100);
    }
}
