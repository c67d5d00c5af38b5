//! Counters of clients and messages.

use std::sync::atomic::{AtomicU64, Ordering};

/// Counters of clients and messages.
#[derive(Debug, Default)]
pub struct Counts {
    /// Clients served.
    pub served: AtomicU64,
    /// Connections refused because all slots were taken.
    pub turned_away: AtomicU64,
    /// Clients disconnected because they received too little or too slowly.
    pub cut_off: AtomicU64,
    /// Clients disconnected because they did not send OpenIGTLink.
    pub nonsense: AtomicU64,
    /// Messages replaced by newer ones before they were sent.
    pub replaced: AtomicU64,
}

impl Counts {
    pub(super) fn add(count: &AtomicU64) {
        count.fetch_add(1, Ordering::Relaxed);
    }

    /// Returns the counts in words, if there were any clients.
    pub fn sentence(&self) -> Option<String> {
        let [served, away, cut, nonsense, replaced] =
            [&self.served, &self.turned_away, &self.cut_off, &self.nonsense, &self.replaced]
                .map(|count| count.load(Ordering::Relaxed));
        (served + away > 0).then(|| {
            format!(
                "OpenIGTLink: {served} clients, {away} refused, {cut} disconnected as too slow, {nonsense} for invalid \
                data; {replaced} messages were replaced by newer ones before they were sent"
            )
        })
    }
}
