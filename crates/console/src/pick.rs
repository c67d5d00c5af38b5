//! Picking: the render thread answers which place is visible at a point of the volume's
//! picture, since only it knows the picture's contents.

use std::sync::atomic::{AtomicU64, Ordering};

use tokio::sync::oneshot;

use render::{Picked, Renderer};

use super::questions::Questions;
use super::request_error::RequestError;

/// The answer: a place, or the reason that there is none.
pub(super) type Answer = Result<Picked, RequestError>;

/// Requests waiting for the render thread.
#[derive(Debug, Default)]
pub(super) struct Picks {
    waiting: Questions<[f64; 2], Answer>,
    cast: AtomicU64,
}

impl Picks {
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
        Ok(self.waiting.ask(at))
    }

    /// Answers all requests from the displayed picture; `None` if the volume is empty.
    pub(super) fn answer(&self, shown: Option<&Renderer>) {
        self.waiting.answer(|at| self.picked(at, shown));
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
    use super::super::questions::MOST;
    use super::*;

    #[test]
    fn picks_answered_once_and_excess_dropped() {
        let picks = Picks::default();
        assert!(picks.request([0.5, f64::NAN]).unwrap_err().to_string().contains("from 0 to 1"));
        picks.answer(None);
        let mut requests: Vec<_> = (0..MOST + 3).map(|_| picks.request([0.5; 2]).unwrap()).collect();
        assert_eq!(picks.waiting.count(), MOST);
        assert!(requests[2].try_recv() == Err(oneshot::error::TryRecvError::Closed), "the oldest are given up");
        drop(requests.split_off(10));
        drop(picks.request([0.1; 2]).unwrap());
        assert_eq!(picks.waiting.count(), 8, "whoever has gone is forgotten");
        picks.answer(None);
        assert!(requests[9].try_recv().unwrap().unwrap_err().to_string().contains("no volume yet"));
        assert_eq!((picks.waiting.count(), picks.cast()), (0, 0));
    }
}
