//! Questions of clients that a session's thread answers when it comes to them, as only it has what
//! they ask for.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::oneshot;

/// Largest number of waiting questions; beyond it the oldest are dropped.
pub(super) const MOST: usize = 32;

/// Waiting questions.
#[derive(Debug)]
pub(super) struct Questions<Q, A> {
    /// Whether questions may be waiting; avoids taking the lock without need.
    is_asked: AtomicBool,
    waiting: Mutex<Vec<Question<Q, A>>>,
}

#[derive(Debug)]
struct Question<Q, A> {
    of: Q,
    answer: oneshot::Sender<A>,
}

impl<Q, A> Default for Questions<Q, A> {
    fn default() -> Self {
        Self { is_asked: AtomicBool::default(), waiting: Mutex::default() }
    }
}

impl<Q, A> Questions<Q, A> {
    fn waiting(&self) -> MutexGuard<'_, Vec<Question<Q, A>>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Asks a question. The channel closes without an answer if there are too many.
    pub(super) fn ask(&self, of: Q) -> oneshot::Receiver<A> {
        let (answer, answered) = oneshot::channel();
        let mut waiting = self.waiting();
        waiting.retain(|question| !question.answer.is_closed());
        if waiting.len() >= MOST {
            waiting.remove(0);
        }
        waiting.push(Question { of, answer });
        self.is_asked.store(true, Ordering::Release);
        answered
    }

    /// Answers all questions whose clients still wait.
    pub(super) fn answer(&self, mut answer: impl FnMut(Q) -> A) {
        if !self.is_asked.swap(false, Ordering::Acquire) {
            return;
        }
        let waiting = std::mem::take(&mut *self.waiting());
        for question in waiting.into_iter().filter(|question| !question.answer.is_closed()) {
            // The client may have stopped waiting.
            let _ = question.answer.send(answer(question.of));
        }
    }

    #[cfg(test)]
    pub(super) fn count(&self) -> usize {
        self.waiting().len()
    }
}
