//! The native part of `Sequence`.

use std::path::PathBuf;

use numpy::{PyArrayDyn, PyReadonlyArrayDyn};
use pyo3::prelude::*;

use sonoweave::library::{Keywords, PosedFrames, Recording};

use crate::{arrays, errors};

/// A tracked sequence.
#[pyclass(frozen, name = "Recording", module = "sonoweave._sonoweave")]
pub(crate) struct PyRecording(pub(crate) Recording);

#[pymethods]
impl PyRecording {
    /// Opens a sequence file.
    #[new]
    fn new(py: Python<'_>, path: PathBuf, keywords: Vec<(String, String)>) -> PyResult<Self> {
        let opened = py.detach(|| Recording::open(&path, Keywords::new(keywords)?));
        Ok(Self(opened.map_err(|error| errors::raise(py, error))?))
    }

    /// Takes frames from memory; they are copied.
    #[staticmethod]
    #[pyo3(signature = (name, frames, world_from_image, times))]
    fn of_frames(
        py: Python<'_>,
        name: String,
        frames: &Bound<'_, PyAny>,
        world_from_image: PyReadonlyArrayDyn<'_, f64>,
        times: Option<Vec<f64>>,
    ) -> PyResult<Self> {
        let arrays::Frames { size, pixel, frames } = arrays::frames(frames)?;
        let poses = arrays::poses(&world_from_image)?;
        if frames.len() != poses.len() || times.as_ref().is_some_and(|times| times.len() != frames.len()) {
            return Err(errors::input(py, "frames, world_from_image and times: must have the same length".into()));
        }
        let frames = PosedFrames {
            name,
            size,
            pixel,
            frames: frames.into(),
            world_from_image: poses.into(),
            times_s: times.map(Into::into),
        };
        let taken = py.detach(|| Recording::of_frames(frames));
        Ok(Self(taken.map_err(|error| errors::raise(py, error))?))
    }

    /// Number of frames.
    fn __len__(&self) -> PyResult<usize> {
        Ok(usize::try_from(self.0.count())?)
    }

    /// Poses, (N, 4, 4).
    fn poses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let poses = self.0.poses();
        let count = poses.len();
        arrays::array(py, poses.into_iter().flatten().collect(), [count, 4, 4])
    }

    /// Times, s, (N,).
    fn times<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let times = self.0.times_s();
        let count = times.len();
        arrays::array(py, times, [count])
    }

    /// Status of each frame.
    fn status(&self) -> Vec<&'static str> {
        self.0.status()
    }

    /// Name of the poses' frame of reference, and the route to it.
    fn world(&self) -> (String, String) {
        let (world, route) = self.0.world();
        (world.to_owned(), route)
    }

    /// Reads a frame, (height, width).
    fn picture(&self, py: Python<'_>, number: u64) -> PyResult<Py<PyAny>> {
        let picture = py.detach(|| self.0.picture(number)).map_err(|error| errors::raise(py, error))?;
        arrays::of_picture(py, &picture)
    }
}
