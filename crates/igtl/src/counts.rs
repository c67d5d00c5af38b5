//! Counters of clients and messages.

use std::sync::atomic::{AtomicU64, Ordering};

use statistics::IgtlNumbers;

/// Counters of clients and messages.
#[derive(Debug, Default)]
pub struct Counts {
    /// Clients served.
    pub served: AtomicU64,
    /// Connections closed because their address is in no allowed network.
    pub not_allowed: AtomicU64,
    /// Connections refused because all slots were taken, or all of their address.
    pub turned_away: AtomicU64,
    /// Clients disconnected because they received too little or too slowly.
    pub cut_off: AtomicU64,
    /// Clients disconnected because they sent too many messages.
    pub too_many: AtomicU64,
    /// Clients disconnected because they did not send OpenIGTLink.
    pub nonsense: AtomicU64,
    /// Messages replaced by newer ones before they were sent.
    pub replaced: AtomicU64,
}

impl Counts {
    pub(super) fn add(count: &AtomicU64) {
        count.fetch_add(1, Ordering::Relaxed);
    }

    /// Returns the present counts.
    pub fn numbers(&self) -> IgtlNumbers {
        let of = |count: &AtomicU64| count.load(Ordering::Relaxed);
        IgtlNumbers {
            served: of(&self.served),
            not_allowed: of(&self.not_allowed),
            turned_away: of(&self.turned_away),
            cut_off: of(&self.cut_off),
            too_many: of(&self.too_many),
            nonsense: of(&self.nonsense),
            replaced: of(&self.replaced),
        }
    }

    /// Returns the counts in words, if there were any clients.
    pub fn sentence(&self) -> Option<String> {
        let IgtlNumbers { served, not_allowed, turned_away, cut_off, too_many, nonsense, replaced } = self.numbers();
        (served + not_allowed + turned_away > 0).then(|| {
            format!(
                "OpenIGTLink: {served} clients, {not_allowed} refused as not allowed, {turned_away} as too many, \
                {cut_off} disconnected as too slow, {too_many} for too many messages, {nonsense} for invalid data; \
                {replaced} messages were replaced by newer ones before they were sent"
            )
        })
    }
}
