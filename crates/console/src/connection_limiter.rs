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
pub(super) const SLOTS: usize = 128;
/// Time in which a connection may send a request before it can be closed.
const GRACE: Duration = Duration::from_millis(500);
/// Time in which a connection may receive an answer before it can be closed.
const ANSWERED: Duration = Duration::from_secs(5);
/// Interval between two checks whether a connection may be closed.
const POLL: Duration = Duration::from_millis(20);

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
    evicted: Arc<Notify>,
}

/// A connection slot; dropping it frees the slot.
#[derive(Debug)]
pub(super) struct ConnectionSlot {
    limiter: Arc<ConnectionLimiter>,
    number: u64,
    evicted: Arc<Notify>,
}

impl ConnectionLimiter {
    fn members(&self) -> MutexGuard<'_, Members> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for a slot. Also returns whether another connection was closed for it.
    pub(super) async fn enter(self: &Arc<Self>) -> (ConnectionSlot, bool) {
        loop {
            if let Some(entered) = self.try_enter(Instant::now()) {
                return entered;
            }
            sleep(POLL).await;
        }
    }

    fn try_enter(self: &Arc<Self>, now: Instant) -> Option<(ConnectionSlot, bool)> {
        let mut members = self.members();
        let is_full = members.all.len() >= SLOTS;
        if is_full {
            let time = |member: &Member| if member.is_answered { ANSWERED } else { GRACE };
            let may_go = |member: &Member| now.saturating_duration_since(member.since) >= time(member);
            let those = members.all.iter().enumerate().filter(|(_, member)| may_go(member));
            let (at, _) = those.min_by_key(|(_, member)| (member.is_answered, member.since))?;
            members.all.swap_remove(at).evicted.notify_one();
        }
        members.next += 1;
        let (number, evicted) = (members.next, Arc::new(Notify::new()));
        members.all.push(Member { number, since: now, is_answered: false, evicted: Arc::clone(&evicted) });
        Some((ConnectionSlot { limiter: Arc::clone(self), number, evicted }, is_full))
    }
}

impl ConnectionSlot {
    /// Records that a request has arrived, or that its answer has been sent.
    pub(super) fn is_answered(&self, whether: bool) {
        self.is_answered_from(whether, Instant::now());
    }

    fn is_answered_from(&self, whether: bool, now: Instant) {
        let mut members = self.limiter.members();
        if let Some(own) = members.all.iter_mut().find(|member| member.number == self.number) {
            (own.since, own.is_answered) = (now, whether);
        }
    }

    /// Waits until the limiter closes this connection.
    pub(super) async fn evicted(&self) {
        self.evicted.notified().await;
    }
}

impl Drop for ConnectionSlot {
    fn drop(&mut self) {
        self.limiter.members().all.retain(|member| member.number != self.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_sent_away(slot: &ConnectionSlot) -> bool {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        runtime.block_on(async { tokio::time::timeout(Duration::from_millis(1), slot.evicted()).await.is_ok() })
    }

    #[test]
    fn full_limiter_closes_longest_idle_after_grace() {
        let limiter = Arc::new(ConnectionLimiter::default());
        let begun = Instant::now();
        let after = |ms| begun + Duration::from_millis(ms);
        let mut held: Vec<_> = (0..SLOTS as u64).map(|n| limiter.try_enter(after(n)).unwrap()).collect();
        assert!(held.iter().all(|(_, has_evicted)| !has_evicted));
        held[0].0.is_answered_from(true, after(200));
        assert!(limiter.try_enter(after(500)).is_none(), "the second one still has the time to ask");
        let (late, has_evicted) = limiter.try_enter(after(501)).unwrap();
        assert!(has_evicted && is_sent_away(&held[1].0));
        assert!(!is_sent_away(&held[2].0) && !is_sent_away(&late));
        assert!(!is_sent_away(&held[0].0), "it is being answered");
        // Only connections being answered are left: these have more time.
        held.iter().map(|(slot, _)| slot).chain([&late]).for_each(|slot| slot.is_answered_from(true, after(1000)));
        assert!(limiter.try_enter(after(5999)).is_none());
        let (last, has_evicted) = limiter.try_enter(after(6000)).unwrap();
        assert!(has_evicted && !is_sent_away(&last));
        // A slot whose connection ended is free at once.
        drop(held.pop());
        assert!(!limiter.try_enter(after(6001)).unwrap().1);
        drop((held, late, last));
        assert!(limiter.0.lock().unwrap().all.is_empty());
    }
}
