//! Places that somebody points at in the volume's picture: asked of the thread that draws it, which alone knows what is seen there.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::oneshot;

use crate::render::{Picked, Renderer};

/// Questions that wait; of more the oldest are given up.
const MOST: usize = 32;

/// What is answered: a place, or in a sentence why there is none.
pub(super) type Answer = Result<Picked, String>;

/// Questions that wait for the thread that draws.
#[derive(Debug, Default)]
pub(super) struct Picks {
    /// Whether any may: nobody asks for a lock to know that none does.
    is_asked: AtomicBool,
    waiting: Mutex<Vec<Question>>,
    cast: AtomicU64,
}

#[derive(Debug)]
struct Question {
    at: [f64; 2],
    answer: oneshot::Sender<Answer>,
}

impl Picks {
    fn waiting(&self) -> MutexGuard<'_, Vec<Question>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Asks for the place that is seen at a place of the picture, by its share of the width from the left and of the height from above. Nothing is answered where nobody
    /// draws, or too many ask.
    ///
    /// # Errors
    /// A sentence for what is no place of a picture.
    pub(super) fn ask(&self, at: [f64; 2]) -> Result<oneshot::Receiver<Answer>, String> {
        if at.iter().any(|share| !(0.0..=1.0).contains(share)) {
            return Err("a place in the picture is told by two shares of its sides, from 0 to 1".into());
        }
        let (answer, answered) = oneshot::channel();
        let mut waiting = self.waiting();
        waiting.retain(|question| !question.answer.is_closed());
        if waiting.len() >= MOST {
            waiting.remove(0);
        }
        waiting.push(Question { at, answer });
        self.is_asked.store(true, Ordering::Release);
        Ok(answered)
    }

    /// Answers all that is asked, by the picture that is shown; `None` is that of an empty volume.
    pub(super) fn answer(&self, shown: Option<&Renderer>) {
        if !self.is_asked.swap(false, Ordering::Acquire) {
            return;
        }
        let waiting = std::mem::take(&mut *self.waiting());
        for Question { at, answer } in waiting.into_iter().filter(|question| !question.answer.is_closed()) {
            // Whoever no longer waits is none that it is owed to.
            let _ = answer.send(self.picked(at, shown));
        }
    }

    fn picked(&self, [x, y]: [f64; 2], shown: Option<&Renderer>) -> Answer {
        let renderer = shown.ok_or("there is no volume yet in which a place could be seen")?;
        let [width, height] = renderer.camera().size().map(f64::from);
        self.cast.fetch_add(1, Ordering::Relaxed);
        let picked = renderer.pick([x * width - 0.5, y * height - 0.5]);
        picked.ok_or_else(|| "nothing is seen there that hides what lies behind it: point at something else".into())
    }

    /// Rays that were cast for answers.
    pub(super) fn cast(&self) -> u64 {
        self.cast.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_question_is_answered_once_and_too_many_are_not_kept() {
        let picks = Picks::default();
        assert!(picks.ask([0.5, f64::NAN]).unwrap_err().contains("from 0 to 1"));
        picks.answer(None);
        let mut asked: Vec<_> = (0..MOST + 3).map(|_| picks.ask([0.5; 2]).unwrap()).collect();
        assert_eq!(picks.waiting().len(), MOST);
        assert!(asked[2].try_recv() == Err(oneshot::error::TryRecvError::Closed), "the oldest are given up");
        drop(asked.split_off(10));
        drop(picks.ask([0.1; 2]).unwrap());
        assert_eq!(picks.waiting().len(), 8, "whoever has gone is forgotten");
        picks.answer(None);
        assert!(asked[9].try_recv().unwrap().unwrap_err().contains("no volume yet"));
        assert_eq!((picks.waiting().len(), picks.cast()), (0, 0));
    }
}
