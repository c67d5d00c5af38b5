//! Connection limiter: idle clients, however many, cannot keep others from connecting.
//!
//! Every connection is accepted. When all slots are taken, the limiter closes the connection
//! that has been idle longest. If none is idle, it closes the one whose answer has taken
//! longest. No connection is closed before it had time to send a request or to receive its
//! answer. A thousand silent clients therefore delay the next client only by the time it takes
//! to close them. tower's limits close nothing, and axum-server has none.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::Notify;
use tokio::time::sleep;

/// Largest number of simultaneous connections.
pub(super) const PLACES: usize = 128;
/// Time in which a connection may send a request before it can be closed.
const GRACE: Duration = Duration::from_millis(500);
/// Time in which a connection may receive an answer before it can be closed.
const ANSWERED: Duration = Duration::from_secs(5);
/// Interval between two checks whether a connection may be closed.
const LOOK: Duration = Duration::from_millis(20);

/// The open connections.
#[derive(Debug, Default)]
pub(super) struct ConnectionLimiter(Mutex<Members>);

#[derive(Debug, Default)]
struct Members {
    next: u64,
    all: Vec<Member>,
}

#[derive(Debug)]
struct Member {
    number: u64,
    /// Time since which it has been idle, or since which it is being answered.
    since: Instant,
    is_answered: bool,
    sent_away: Arc<Notify>,
}

/// A connection slot; dropping it frees the slot.
#[derive(Debug)]
pub(super) struct Place {
    crowd: Arc<ConnectionLimiter>,
    number: u64,
    sent_away: Arc<Notify>,
}

impl ConnectionLimiter {
    fn members(&self) -> MutexGuard<'_, Members> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for a slot. Also returns whether another connection was closed for it.
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
    /// Records that a request has arrived, or that its answer has been sent.
    pub(super) fn is_answered(&self, whether: bool) {
        self.is_answered_from(whether, Instant::now());
    }

    fn is_answered_from(&self, whether: bool, now: Instant) {
        let mut members = self.crowd.members();
        if let Some(own) = members.all.iter_mut().find(|member| member.number == self.number) {
            (own.since, own.is_answered) = (now, whether);
        }
    }

    /// Waits until the limiter closes this connection.
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
    fn full_limiter_closes_longest_idle_after_grace() {
        let crowd = Arc::new(ConnectionLimiter::default());
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
        // Only connections being answered are left: these have more time.
        held.iter().map(|(place, _)| place).chain([&late]).for_each(|place| place.is_answered_from(true, after(1000)));
        assert!(crowd.try_enter(after(5999)).is_none());
        let (last, gave_way) = crowd.try_enter(after(6000)).unwrap();
        assert!(gave_way && !is_sent_away(&last));
        // A slot whose connection ended is free at once.
        drop(held.pop());
        assert!(!crowd.try_enter(after(6001)).unwrap().1);
        drop((held, late, last));
        assert!(crowd.0.lock().unwrap().all.is_empty());
    }
}
