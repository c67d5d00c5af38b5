//! The native part of `Reconstructor`.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use numpy::{PyArrayDyn, PyReadonlyArrayDyn};
use pyo3::prelude::*;

use sonoweave::library::{Inserted, Keyword, Keywords, Ledger, Reconstruction};

use crate::process::InProcess;
use crate::recording::PyRecording;
use crate::volume::PyVolume;
use crate::{arrays, errors};

/// Shortest time between two calls of a progress callback.
const PROGRESS_EVERY: Duration = Duration::from_millis(100);

/// Bricks that changed, (n, 3); refused frames as number, reason and sentence; frames that wait.
type Outcome<'py> = (Bound<'py, PyArrayDyn<i32>>, Vec<(u64, &'static str, String)>, u64);

/// A volume that grows.
#[pyclass(frozen, name = "Reconstruction", module = "sonoweave._sonoweave")]
pub(crate) struct PyReconstruction(InProcess<Reconstruction>);

#[pymethods]
impl PyReconstruction {
    /// Creates an empty volume.
    #[new]
    fn new(py: Python<'_>, keywords: Vec<Keyword>) -> PyResult<Self> {
        let made = py.detach(|| Reconstruction::new(Keywords::new(keywords)?));
        Ok(Self(InProcess::new(made.map_err(|error| errors::raise(py, error))?)))
    }

    /// Inserts the first frame of (1, height, width) at the first pose of (1, 4, 4).
    #[pyo3(signature = (frame, world_from_image, time))]
    fn insert<'py>(
        &self,
        py: Python<'py>,
        frame: &Bound<'py, PyAny>,
        world_from_image: PyReadonlyArrayDyn<'py, f64>,
        time: Option<f64>,
    ) -> PyResult<Outcome<'py>> {
        let arrays::Frames { size, pixel, mut frames } = arrays::frames(frame)?;
        let (Some(pixels), Some(pose)) = (frames.pop(), arrays::poses(&world_from_image)?.pop()) else {
            return Err(errors::input(py, "frame, world_from_image: must be one each".into()));
        };
        let inserted = self.0.with(py, |reconstruction| reconstruction.insert((size, pixel, pixels), &pose, time))?;
        let Inserted { mut touched, refused, waiting } = inserted.map_err(|error| errors::raise(py, error))?;
        let count = touched.len();
        // As the arrays' axes: z, y, x.
        touched.iter_mut().for_each(|brick| brick.reverse());
        let refused = refused.into_iter().map(|refusal| (refusal.item, refusal.reason.name(), refusal.to_string()));
        Ok((arrays::array(py, touched.into_flattened(), [count, 3])?, refused.collect(), waiting))
    }

    /// Inserts a recording. `progress` is called with the numbers of frames done and of all; an
    /// exception in it, or of a signal, ends the run. Returns the account, as JSON.
    #[pyo3(signature = (recording, progress))]
    fn insert_all(&self, py: Python<'_>, recording: &PyRecording, progress: Option<Py<PyAny>>) -> PyResult<String> {
        let (ends, total) = (AtomicBool::new(false), recording.0.count());
        let mut raised: Option<PyErr> = None;
        let mut called: Option<Instant> = None;
        let ran = self.0.with(py, |reconstruction| {
            reconstruction.insert_all(&recording.0, &ends, |ledger: &Ledger| {
                if raised.is_some() {
                    return;
                }
                let frames = &ledger.frames;
                let done = frames.total - frames.waiting;
                let is_due = called.is_none_or(|called| called.elapsed() >= PROGRESS_EVERY);
                let answered = Python::attach(|py| {
                    py.check_signals()?;
                    if let Some(progress) = progress.as_ref().filter(|_| is_due) {
                        called = Some(Instant::now());
                        progress.call1(py, (done, total))?;
                    }
                    Ok(())
                });
                if let Err(error) = answered {
                    raised = Some(error);
                    ends.store(true, Ordering::Relaxed);
                }
            })
        })?;
        if let Some(raised) = raised {
            return Err(raised);
        }
        let ledger = ran.map_err(|error| errors::raise(py, error))?;
        if let Some(progress) = progress {
            progress.call1(py, (ledger.frames.total, total))?;
        }
        json(py, &ledger)
    }

    /// Copies the present volume; `None` without a frame in it.
    fn snapshot(&self, py: Python<'_>) -> PyResult<Option<PyVolume>> {
        let taken = self.0.with(py, Reconstruction::snapshot)?;
        Ok(taken.map_err(|error| errors::raise(py, error))?.map(PyVolume))
    }

    /// Account of all frames, as JSON.
    fn ledger(&self, py: Python<'_>) -> PyResult<String> {
        let ledger = self.0.with(py, |reconstruction| reconstruction.ledger())?;
        json(py, &ledger)
    }
}

/// Returns an account as JSON.
pub(crate) fn json(py: Python<'_>, ledger: &Ledger) -> PyResult<String> {
    serde_json::to_string(ledger).map_err(|error| errors::general(py, error.to_string()))
}
