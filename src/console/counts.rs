//! What became of those who asked.

use std::sync::atomic::{AtomicU64, Ordering};

/// Counts of a server.
#[derive(Debug, Default)]
pub struct Counts {
    /// Connections that were taken.
    pub connections: AtomicU64,
    /// Connections that gave way to others as they asked for nothing.
    pub gave_way: AtomicU64,
    /// Connections that did not come as far as to speak TLS.
    pub no_tls: AtomicU64,
    /// Pages that were sent away as all places were taken.
    pub pages_sent_away: AtomicU64,
    /// Pages that were cut off as they took nothing, said too much, or fell silent.
    pub pages_cut_off: AtomicU64,
    /// Pictures that were packed for slow lines, once for all pages.
    pub pictures_packed: AtomicU64,
    /// Wrong tokens.
    pub tokens_wrong: AtomicU64,
    /// Tokens that were not looked at, as too many wrong ones came from their address.
    pub tokens_unheard: AtomicU64,
}

impl Counts {
    pub(super) fn add(count: &AtomicU64) {
        count.fetch_add(1, Ordering::Relaxed);
    }

    /// So far.
    pub(super) fn of(count: &AtomicU64) -> u64 {
        count.load(Ordering::Relaxed)
    }
}
