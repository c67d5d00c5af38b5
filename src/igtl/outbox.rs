//! What waits to be sent to a client: of what is shown the newest of each name, and answers in order. Bounded by the number of names and of answers.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// A message as bytes, shared by all who get it.
pub(super) type Wire = Arc<[u8]>;

/// Answers that may wait; who asks for more and takes none is cut off.
const ANSWERS: usize = 64;

/// What waits.
#[derive(Debug, Default)]
pub(super) struct Outbox {
    answers: VecDeque<Wire>,
    /// By type and device name.
    newest: BTreeMap<String, Wire>,
    /// Names in the order in which they began to wait.
    order: VecDeque<String>,
}

impl Outbox {
    /// An answer. Whether there was room.
    pub(super) fn answer(&mut self, wire: Wire) -> bool {
        if self.answers.len() >= ANSWERS {
            return false;
        }
        self.answers.push_back(wire);
        true
    }

    /// What is shown by a name: it takes the place of what was not sent yet, which is counted.
    pub(super) fn show(&mut self, name: &str, wire: Wire, replaced: &AtomicU64) {
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

    /// The next to be sent.
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
    fn the_newest_takes_the_place_of_what_waits_and_names_go_in_turn() {
        let (mut outbox, replaced) = (Outbox::default(), AtomicU64::new(0));
        for n in 0..10_u8 {
            outbox.show("IMAGE", [n].into(), &replaced);
            outbox.show("PROBE", [100 + n].into(), &replaced);
        }
        assert!(outbox.answer([7].into()));
        assert_eq!(replaced.load(Ordering::Relaxed), 18);
        let sent: Vec<u8> = std::iter::from_fn(|| outbox.next()).map(|wire| wire[0]).collect();
        assert_eq!(sent, [7, 9, 109]);
        assert!(outbox.next().is_none());
        // One that never reads does not fill the memory.
        assert_eq!((0..1000).filter(|_| outbox.answer([0].into())).count(), ANSWERS);
    }
}
