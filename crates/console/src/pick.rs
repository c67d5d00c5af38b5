//! Picking: the render thread answers which place is visible at a point of the volume's
//! picture, since only it knows the picture's contents.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::oneshot;

use render::{Picked, Renderer};

use super::request_error::RequestError;

/// Largest number of waiting requests; beyond it the oldest are dropped.
const MOST: usize = 32;

/// The answer: a place, or the reason that there is none.
pub(super) type Answer = Result<Picked, RequestError>;

/// Requests waiting for the render thread.
#[derive(Debug, Default)]
pub(super) struct Picks {
    /// Whether requests may be waiting; avoids taking the lock without need.
    is_requested: AtomicBool,
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

    /// Asks for the place visible at a point of the picture: fraction of the width from the
    /// left, of the height from the top. The channel closes without an answer if nothing is
    /// rendered, or if there are too many requests.
    ///
    /// # Errors
    /// [`RequestError::PicturePoint`] for a point outside the picture.
    pub(super) fn request(&self, at: [f64; 2]) -> Result<oneshot::Receiver<Answer>, RequestError> {
        if at.iter().any(|share| !(0.0..=1.0).contains(share)) {
            return Err(RequestError::PicturePoint);
        }
        let (answer, answered) = oneshot::channel();
        let mut waiting = self.waiting();
        waiting.retain(|question| !question.answer.is_closed());
        if waiting.len() >= MOST {
            waiting.remove(0);
        }
        waiting.push(Question { at, answer });
        self.is_requested.store(true, Ordering::Release);
        Ok(answered)
    }

    /// Answers all requests from the displayed picture; `None` if the volume is empty.
    pub(super) fn answer(&self, shown: Option<&Renderer>) {
        if !self.is_requested.swap(false, Ordering::Acquire) {
            return;
        }
        let waiting = std::mem::take(&mut *self.waiting());
        for Question { at, answer } in waiting.into_iter().filter(|question| !question.answer.is_closed()) {
            // The client may have stopped waiting.
            let _ = answer.send(self.picked(at, shown));
        }
    }

    fn picked(&self, [x, y]: [f64; 2], shown: Option<&Renderer>) -> Answer {
        let renderer = shown.ok_or(RequestError::NoVolume("select a point"))?;
        let [width, height] = renderer.camera().size().map(f64::from);
        self.cast.fetch_add(1, Ordering::Relaxed);
        let picked = renderer.pick([x * width - 0.5, y * height - 0.5]);
        picked.ok_or(RequestError::NothingVisible)
    }

    /// Returns the number of rays cast for answers.
    pub(super) fn cast(&self) -> u64 {
        self.cast.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn picks_answered_once_and_excess_dropped() {
        let picks = Picks::default();
        assert!(picks.request([0.5, f64::NAN]).unwrap_err().to_string().contains("from 0 to 1"));
        picks.answer(None);
        let mut requests: Vec<_> = (0..MOST + 3).map(|_| picks.request([0.5; 2]).unwrap()).collect();
        assert_eq!(picks.waiting().len(), MOST);
        assert!(requests[2].try_recv() == Err(oneshot::error::TryRecvError::Closed), "the oldest are given up");
        drop(requests.split_off(10));
        drop(picks.request([0.1; 2]).unwrap());
        assert_eq!(picks.waiting().len(), 8, "whoever has gone is forgotten");
        picks.answer(None);
        assert!(requests[9].try_recv().unwrap().unwrap_err().to_string().contains("no volume yet"));
        assert_eq!((picks.waiting().len(), picks.cast()), (0, 0));
    }
}
