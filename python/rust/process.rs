//! The process of an object, and work in it while Python's other threads run.

use std::sync::{Mutex, MutexGuard, PoisonError};

use pyo3::prelude::*;

use crate::errors;

/// Something with threads, which a child made by `fork` does not have.
pub(crate) struct InProcess<T> {
    process: u32,
    content: Mutex<T>,
}

impl<T: Send> InProcess<T> {
    pub(crate) fn new(content: T) -> Self {
        Self { process: std::process::id(), content: Mutex::new(content) }
    }

    /// Calls `work` on it, while other threads of Python run.
    ///
    /// # Errors
    /// In a child of the process that made it.
    pub(crate) fn with<R: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut T) -> R + Send) -> PyResult<R> {
        if std::process::id() != self.process {
            return Err(errors::general(
                py,
                "the reconstructor was made before a fork, and its threads are not in this process; make a new one \
                 here, or start processes by spawn"
                    .into(),
            ));
        }
        Ok(py.detach(|| work(&mut lock(&self.content))))
    }
}

fn lock<T>(content: &Mutex<T>) -> MutexGuard<'_, T> {
    content.lock().unwrap_or_else(PoisonError::into_inner)
}
