//! Reconstructs a sweep while pictures follow it, slice by slice.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use pipeline::{InsertedSlice, Observer, Outcome};

use crate::app::reconstruct::sweep::Sweep;
use crate::app::reporter::Steps;
use crate::failure::{Failure, Reason};

/// Pictures that follow the volume, rendered after each slice before the next is inserted.
pub(crate) trait Follow: Send {
    /// Renders what a slice has changed.
    ///
    /// # Errors
    /// [`Failure`] when a picture cannot be drawn or written.
    fn follow(&mut self, inserted: &InsertedSlice<'_>) -> Result<(), Failure>;
}

/// Observer that lets pictures follow each slice.
pub(crate) struct Follower<F>(Mutex<F>);

impl<F> Follower<F> {
    pub(crate) fn lock(&self) -> MutexGuard<'_, F> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<F: Follow> Observer for Follower<F> {
    fn inserted(&self, inserted: &InsertedSlice<'_>) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        self.lock().follow(inserted).map_err(|Failure(Reason { sentence, .. })| sentence.into())
    }
}

/// Reconstructs a sweep, followed by pictures.
pub(crate) fn reconstruct<F: Follow + 'static>(
    mut sweep: Sweep,
    follow: F,
    steps: Steps<'_>,
) -> Result<(Outcome, Arc<Follower<F>>), Failure> {
    let follower = Arc::new(Follower(Mutex::new(follow)));
    sweep.session.observers.push(Arc::clone(&follower) as Arc<dyn Observer>);
    Ok((sweep.reconstruct("replaying", steps)?, follower))
}
