//! Who looks on: a place for each page. When all are taken, the page gives way to a newcomer that has neither looked at anything nor steered for the longest time, if that is
//! long; so pages that were left open and forgotten keep nobody else out.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::{Notify, OwnedSemaphorePermit, Semaphore};
use tokio::time::timeout;

/// Pages that may look on at a time.
pub(super) const PAGES: usize = 8;
/// For how long a page may rest before it gives way.
pub(super) const PATIENCE: Duration = Duration::from_secs(600);
/// For how long a newcomer waits for the one that gives way.
const LEAVING: Duration = Duration::from_secs(1);

/// The places.
#[derive(Debug)]
pub(super) struct Places {
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
    /// Since when it neither looks at anything nor steers; `None` while it does.
    rests: Option<Instant>,
    sent_away: Arc<Notify>,
}

/// A place; free again when dropped.
#[derive(Debug)]
pub(super) struct Place {
    places: Arc<Places>,
    number: u64,
    sent_away: Arc<Notify>,
    _permit: OwnedSemaphorePermit,
}

impl Places {
    /// All free; pages that rest for longer than that give way.
    pub(super) fn new(patience: Duration) -> Self {
        Self { free: Arc::new(Semaphore::new(PAGES)), patience, pages: Mutex::default() }
    }

    fn pages(&self) -> MutexGuard<'_, Pages> {
        self.pages.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A place, and whether somebody gave way for it; `None` where all are taken by pages that do not.
    pub(super) async fn enter(self: &Arc<Self>) -> Option<(Place, bool)> {
        if let Ok(permit) = Arc::clone(&self.free).try_acquire_owned() {
            return Some((self.place(permit), false));
        }
        if !self.sends_away(Instant::now()) {
            return None;
        }
        let permit = timeout(LEAVING, Arc::clone(&self.free).acquire_owned()).await.ok()?.ok()?;
        Some((self.place(permit), true))
    }

    fn place(self: &Arc<Self>, permit: OwnedSemaphorePermit) -> Place {
        let mut pages = self.pages();
        pages.next += 1;
        let (number, sent_away) = (pages.next, Arc::new(Notify::new()));
        pages.all.push(Page { number, rests: None, sent_away: Arc::clone(&sent_away) });
        Place { places: Arc::clone(self), number, sent_away, _permit: permit }
    }

    /// Whether a page is told to give way, which it is once.
    fn sends_away(&self, now: Instant) -> bool {
        let mut pages = self.pages();
        let long = |page: &Page| page.rests.is_some_and(|since| now.saturating_duration_since(since) >= self.patience);
        let Some(page) = pages.all.iter_mut().filter(|page| long(page)).min_by_key(|page| page.rests) else {
            return false;
        };
        page.rests = None;
        page.sent_away.notify_one();
        true
    }

    /// Until all have gone.
    pub(super) async fn left(&self) {
        let _ = self.free.acquire_many(u32::try_from(PAGES).unwrap_or(u32::MAX)).await;
    }
}

impl Place {
    /// Whether its page looks at nothing and does not steer, from now on.
    pub(super) fn rests(&self, whether: bool) {
        self.rests_from(whether, Instant::now());
    }

    fn rests_from(&self, whether: bool, now: Instant) {
        let mut pages = self.places.pages();
        if let Some(own) = pages.all.iter_mut().find(|page| page.number == self.number) {
            own.rests = whether.then(|| own.rests.unwrap_or(now));
        }
    }

    /// Until it has to give way.
    pub(super) async fn sent_away(&self) {
        self.sent_away.notified().await;
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.places.pages().all.retain(|page| page.number != self.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_has_rested_longest_gives_way_and_nobody_who_has_not_rested_for_long() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        runtime.block_on(async {
            let places = Arc::new(Places::new(PATIENCE));
            let mut held = Vec::new();
            for _ in 0..PAGES {
                held.push(places.enter().await.unwrap().0);
            }
            assert!(places.enter().await.is_none(), "all are taken");
            let begun = Instant::now();
            let after = |s| begun + Duration::from_secs(s);
            held[2].rests_from(true, after(1));
            held[5].rests_from(true, after(0));
            held[5].rests_from(true, after(300));
            held[6].rests_from(true, begun);
            held[6].rests_from(false, after(5));
            assert!(!places.sends_away(after(599)));
            assert!(places.sends_away(after(600)), "it has rested since it began to");
            let is_sent = async |place: &Place| timeout(Duration::from_millis(1), place.sent_away()).await.is_ok();
            assert!(is_sent(&held[5]).await && !is_sent(&held[2]).await && !is_sent(&held[6]).await);
            assert!(!places.sends_away(after(600)), "nobody is sent away twice");
            assert!(places.sends_away(after(601)) && is_sent(&held[2]).await);
            assert!(!places.sends_away(after(9999)), "the others look, or steer");
            // One that gives way leaves its place to who waits for it, and one that does not go keeps it.
            let places = Arc::new(Places::new(Duration::ZERO));
            let mut held = Vec::new();
            for _ in 0..PAGES {
                held.push(places.enter().await.unwrap().0);
            }
            held[0].rests(true);
            assert!(places.enter().await.is_none());
            let leaving = held.remove(0);
            leaving.rests(true);
            let leaves = async {
                leaving.sent_away().await;
                drop(leaving);
            };
            let (entered, ()) = tokio::join!(places.enter(), leaves);
            assert!(entered.is_some_and(|(_, gave_way)| gave_way));
        });
    }
}
