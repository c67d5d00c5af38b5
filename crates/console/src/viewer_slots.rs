//! Viewer slots: one for each page. When all are taken, a new page replaces the page that has
//! been inactive longest, if that is long enough. An inactive page neither subscribes to
//! pictures nor has control. Forgotten open pages therefore keep no other page out.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::{Notify, OwnedSemaphorePermit, Semaphore};
use tokio::time::timeout;

/// Largest number of pages at a time.
pub(super) const PAGES: usize = 8;
/// Time for which a page may be inactive before it can be replaced.
pub(super) const PATIENCE: Duration = Duration::from_secs(600);
/// Time for which a new page waits for the replaced one to leave.
const LEAVING: Duration = Duration::from_secs(1);

/// The viewer slots.
#[derive(Debug)]
pub(super) struct ViewerSlots {
    free: Arc<Semaphore>,
    patience: Duration,
    pages: Mutex<Pages>,
}

#[derive(Debug, Default)]
struct Pages {
    next: u64,
    all: Vec<Page>,
}

#[derive(Debug)]
struct Page {
    number: u64,
    /// Time since which the page neither views anything nor has control; `None` while it does.
    inactive_since: Option<Instant>,
    evicted: Arc<Notify>,
}

/// A viewer slot; dropping it frees the slot.
#[derive(Debug)]
pub(super) struct ViewerSlot {
    slots: Arc<ViewerSlots>,
    number: u64,
    evicted: Arc<Notify>,
    _permit: OwnedSemaphorePermit,
}

impl ViewerSlots {
    /// Creates free slots; pages inactive for longer than `patience` can be replaced.
    pub(super) fn new(patience: Duration) -> Self {
        Self { free: Arc::new(Semaphore::new(PAGES)), patience, pages: Mutex::default() }
    }

    fn pages(&self) -> MutexGuard<'_, Pages> {
        self.pages.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a slot; also returns whether a page was replaced for it. `None` if no page can be
    /// replaced.
    pub(super) async fn enter(self: &Arc<Self>) -> Option<(ViewerSlot, bool)> {
        if let Ok(permit) = Arc::clone(&self.free).try_acquire_owned() {
            return Some((self.slot(permit), false));
        }
        if !self.evicts(Instant::now()) {
            return None;
        }
        let permit = timeout(LEAVING, Arc::clone(&self.free).acquire_owned()).await.ok()?.ok()?;
        Some((self.slot(permit), true))
    }

    fn slot(self: &Arc<Self>, permit: OwnedSemaphorePermit) -> ViewerSlot {
        let mut pages = self.pages();
        pages.next += 1;
        let (number, evicted) = (pages.next, Arc::new(Notify::new()));
        pages.all.push(Page { number, inactive_since: None, evicted: Arc::clone(&evicted) });
        ViewerSlot { slots: Arc::clone(self), number, evicted, _permit: permit }
    }

    /// Evicts the longest inactive page, each page at most once. Returns whether there
    /// was one.
    fn evicts(&self, now: Instant) -> bool {
        let mut pages = self.pages();
        let long = |page: &Page| {
            page.inactive_since.is_some_and(|since| now.saturating_duration_since(since) >= self.patience)
        };
        let Some(page) = pages.all.iter_mut().filter(|page| long(page)).min_by_key(|page| page.inactive_since) else {
            return false;
        };
        page.inactive_since = None;
        page.evicted.notify_one();
        true
    }

    /// Waits until all pages have left.
    pub(super) async fn left(&self) {
        let _ = self.free.acquire_many(u32::try_from(PAGES).unwrap_or(u32::MAX)).await;
    }
}

impl ViewerSlot {
    /// Records whether the page is inactive from now on.
    pub(super) fn set_inactive(&self, whether: bool) {
        self.set_inactive_from(whether, Instant::now());
    }

    fn set_inactive_from(&self, whether: bool, now: Instant) {
        let mut pages = self.slots.pages();
        if let Some(own) = pages.all.iter_mut().find(|page| page.number == self.number) {
            own.inactive_since = whether.then(|| own.inactive_since.unwrap_or(now));
        }
    }

    /// Waits until this page is replaced.
    pub(super) async fn evicted(&self) {
        self.evicted.notified().await;
    }
}

impl Drop for ViewerSlot {
    fn drop(&mut self) {
        self.slots.pages().all.retain(|page| page.number != self.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_slots_replace_longest_inactive_page_only() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        runtime.block_on(async {
            let slots = Arc::new(ViewerSlots::new(PATIENCE));
            let mut held = Vec::new();
            for _ in 0..PAGES {
                held.push(slots.enter().await.unwrap().0);
            }
            assert!(slots.enter().await.is_none(), "all are taken");
            let begun = Instant::now();
            let after = |s| begun + Duration::from_secs(s);
            held[2].set_inactive_from(true, after(1));
            held[5].set_inactive_from(true, after(0));
            held[5].set_inactive_from(true, after(300));
            held[6].set_inactive_from(true, begun);
            held[6].set_inactive_from(false, after(5));
            assert!(!slots.evicts(after(599)));
            assert!(slots.evicts(after(600)), "it has rested since it began to");
            let is_sent = async |slot: &ViewerSlot| timeout(Duration::from_millis(1), slot.evicted()).await.is_ok();
            assert!(is_sent(&held[5]).await && !is_sent(&held[2]).await && !is_sent(&held[6]).await);
            assert!(!slots.evicts(after(600)), "no page is evicted twice");
            assert!(slots.evicts(after(601)) && is_sent(&held[2]).await);
            assert!(!slots.evicts(after(9999)), "the others view pictures, or have control");
            // A replaced page frees its slot for the waiting one; a page that does not leave
            // keeps its slot.
            let slots = Arc::new(ViewerSlots::new(Duration::ZERO));
            let mut held = Vec::new();
            for _ in 0..PAGES {
                held.push(slots.enter().await.unwrap().0);
            }
            held[0].set_inactive(true);
            assert!(slots.enter().await.is_none());
            let leaving = held.remove(0);
            leaving.set_inactive(true);
            let leaves = async {
                leaving.evicted().await;
                drop(leaving);
            };
            let (entered, ()) = tokio::join!(slots.enter(), leaves);
            assert!(entered.is_some_and(|(_, has_evicted)| has_evicted));
        });
    }
}
