//! Counters of connections, pages and tokens.

use std::sync::atomic::{AtomicU64, Ordering};

/// Counters of one server.
#[derive(Debug, Default)]
pub struct Counts {
    /// Connections accepted.
    pub connections: AtomicU64,
    /// Idle connections closed to make room for others.
    pub evictions: AtomicU64,
    /// Connections that failed before TLS was established.
    pub no_tls: AtomicU64,
    /// Pages refused because all viewer slots were taken.
    pub pages_refused: AtomicU64,
    /// Pages disconnected because they received nothing, sent too much, or fell silent.
    pub pages_cut_off: AtomicU64,
    /// Pictures compressed for slow connections, once for all pages.
    pub pictures_packed: AtomicU64,
    /// Wrong tokens.
    pub tokens_wrong: AtomicU64,
    /// Tokens not checked because too many wrong ones came from their address.
    pub tokens_unchecked: AtomicU64,
}

impl Counts {
    pub(super) fn add(count: &AtomicU64) {
        count.fetch_add(1, Ordering::Relaxed);
    }

    /// Returns the present count.
    pub(super) fn of(count: &AtomicU64) -> u64 {
        count.load(Ordering::Relaxed)
    }
}
