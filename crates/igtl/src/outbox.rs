//! Messages waiting for a client: of published ones the newest of each name, and answers in
//! order. The number of names and of answers bounds it.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// An encoded message, shared by all its receivers.
pub(super) type Wire = Arc<[u8]>;

/// Largest number of waiting answers; a client that exceeds it is disconnected.
const ANSWERS: usize = 64;

/// The waiting messages.
#[derive(Debug, Default)]
pub(super) struct Outbox {
    answers: VecDeque<Wire>,
    /// By type and device name.
    newest: BTreeMap<String, Wire>,
    /// Names in the order in which they began to wait.
    order: VecDeque<String>,
}

impl Outbox {
    /// Queues an answer. Returns whether there was room.
    pub(super) fn answer(&mut self, wire: Wire) -> bool {
        if self.answers.len() >= ANSWERS {
            return false;
        }
        self.answers.push_back(wire);
        true
    }

    /// Queues a published message. It replaces an unsent one of the same name; replacements are
    /// counted.
    pub(super) fn publish(&mut self, name: &str, wire: Wire, replaced: &AtomicU64) {
        match self.newest.get_mut(name) {
            Some(waiting) => {
                *waiting = wire;
                replaced.fetch_add(1, Ordering::Relaxed);
            }
            None => {
                self.newest.insert(name.to_owned(), wire);
                self.order.push_back(name.to_owned());
            }
        }
    }

    /// Returns the next message to send.
    pub(super) fn next(&mut self) -> Option<Wire> {
        if let Some(answer) = self.answers.pop_front() {
            return Some(answer);
        }
        self.newest.remove(&self.order.pop_front()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn newest_message_replaces_waiting_one_in_turn() {
        let (mut outbox, replaced) = (Outbox::default(), AtomicU64::new(0));
        for n in 0..10_u8 {
            outbox.publish("IMAGE", [n].into(), &replaced);
            outbox.publish("PROBE", [100 + n].into(), &replaced);
        }
        assert!(outbox.answer([7].into()));
        assert_eq!(replaced.load(Ordering::Relaxed), 18);
        let sent: Vec<u8> = std::iter::from_fn(|| outbox.next()).map(|wire| wire[0]).collect();
        assert_eq!(sent, [7, 9, 109]);
        assert!(outbox.next().is_none());
        // A client that never reads does not fill the memory.
        assert_eq!((0..1000).filter(|_| outbox.answer([0].into())).count(), ANSWERS);
    }
}
