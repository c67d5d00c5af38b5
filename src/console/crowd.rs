//! Who holds a connection, and who gives way: a client that asks for nothing keeps nobody else from asking, however many there are of it.
//!
//! Whoever comes is taken. When all places are taken, the one gives way that has asked for nothing for the longest time, and then the one whose answer has taken longest; but
//! nobody before it had the time to ask, or to be answered. So a thousand clients that say nothing hold up the next by what it takes to send them away, and no longer.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::Notify;
use tokio::time::sleep;

/// Connections at a time.
pub(super) const PLACES: usize = 128;
/// The time that everybody has to ask.
const GRACE: Duration = Duration::from_millis(500);
/// The time that everybody has to take an answer.
const ANSWERED: Duration = Duration::from_secs(5);
/// Between two looks whether somebody may be sent away.
const LOOK: Duration = Duration::from_millis(20);

/// Those who hold a connection.
#[derive(Debug, Default)]
pub(super) struct Crowd(Mutex<Members>);

#[derive(Debug, Default)]
struct Members {
    next: u64,
    all: Vec<Member>,
}

#[derive(Debug)]
struct Member {
    number: u64,
    /// Since when it asks for nothing, or is being answered.
    since: Instant,
    is_answered: bool,
    sent_away: Arc<Notify>,
}

/// A place; free again when dropped.
#[derive(Debug)]
pub(super) struct Place {
    crowd: Arc<Crowd>,
    number: u64,
    sent_away: Arc<Notify>,
}

impl Crowd {
    fn members(&self) -> MutexGuard<'_, Members> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A place, once there is one, and whether somebody gave way for it.
    pub(super) async fn enter(self: &Arc<Self>) -> (Place, bool) {
        loop {
            if let Some(entered) = self.try_enter(Instant::now()) {
                return entered;
            }
            sleep(LOOK).await;
        }
    }

    fn try_enter(self: &Arc<Self>, now: Instant) -> Option<(Place, bool)> {
        let mut members = self.members();
        let is_full = members.all.len() >= PLACES;
        if is_full {
            let time = |member: &Member| if member.is_answered { ANSWERED } else { GRACE };
            let may_go = |member: &Member| now.saturating_duration_since(member.since) >= time(member);
            let those = members.all.iter().enumerate().filter(|(_, member)| may_go(member));
            let (at, _) = those.min_by_key(|(_, member)| (member.is_answered, member.since))?;
            members.all.swap_remove(at).sent_away.notify_one();
        }
        members.next += 1;
        let (number, sent_away) = (members.next, Arc::new(Notify::new()));
        members.all.push(Member { number, since: now, is_answered: false, sent_away: Arc::clone(&sent_away) });
        Some((Place { crowd: Arc::clone(self), number, sent_away }, is_full))
    }
}

impl Place {
    /// A request has come, or its answer has gone.
    pub(super) fn is_answered(&self, whether: bool) {
        self.is_answered_from(whether, Instant::now());
    }

    fn is_answered_from(&self, whether: bool, now: Instant) {
        let mut members = self.crowd.members();
        if let Some(own) = members.all.iter_mut().find(|member| member.number == self.number) {
            (own.since, own.is_answered) = (now, whether);
        }
    }

    /// Until it has to give way.
    pub(super) async fn sent_away(&self) {
        self.sent_away.notified().await;
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.crowd.members().all.retain(|member| member.number != self.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_sent_away(place: &Place) -> bool {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        runtime.block_on(async { tokio::time::timeout(Duration::from_millis(1), place.sent_away()).await.is_ok() })
    }

    #[test]
    fn who_asked_for_nothing_longest_gives_way_and_nobody_before_it_had_the_time() {
        let crowd = Arc::new(Crowd::default());
        let begun = Instant::now();
        let after = |ms| begun + Duration::from_millis(ms);
        let mut held: Vec<_> = (0..PLACES as u64).map(|n| crowd.try_enter(after(n)).unwrap()).collect();
        assert!(held.iter().all(|(_, gave_way)| !gave_way));
        held[0].0.is_answered_from(true, after(200));
        assert!(crowd.try_enter(after(500)).is_none(), "the second one still has the time to ask");
        let (late, gave_way) = crowd.try_enter(after(501)).unwrap();
        assert!(gave_way && is_sent_away(&held[1].0));
        assert!(!is_sent_away(&held[2].0) && !is_sent_away(&late));
        assert!(!is_sent_away(&held[0].0), "it is being answered");
        // Only those are left who are answered: they have more time.
        held.iter().map(|(place, _)| place).chain([&late]).for_each(|place| place.is_answered_from(true, after(1000)));
        assert!(crowd.try_enter(after(5999)).is_none());
        let (last, gave_way) = crowd.try_enter(after(6000)).unwrap();
        assert!(gave_way && !is_sent_away(&last));
        // A place that was left is free at once.
        drop(held.pop());
        assert!(!crowd.try_enter(after(6001)).unwrap().1);
        drop((held, late, last));
        assert!(crowd.0.lock().unwrap().all.is_empty());
    }
}
