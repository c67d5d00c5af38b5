//! The native part of `Sequence`.

use std::path::PathBuf;

use numpy::{PyArrayDyn, PyReadonlyArrayDyn};
use pyo3::prelude::*;

use sonoweave::library::{Keyword, Keywords, PosedFrames, Recording};

use crate::{arrays, errors};

/// Poses, times and status.
type Poses<'py> = (Bound<'py, PyArrayDyn<f64>>, Bound<'py, PyArrayDyn<f64>>, Vec<&'static str>);

/// A tracked sequence or session.
#[pyclass(frozen, name = "Recording", module = "sonoweave._sonoweave")]
pub(crate) struct PyRecording(pub(crate) Recording);

#[pymethods]
impl PyRecording {
    /// Opens a sequence file or a session.
    #[new]
    fn new(py: Python<'_>, path: PathBuf, keywords: Vec<Keyword>) -> PyResult<Self> {
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

    /// Poses, (N, 4, 4), times, s, (N,), and the status of each frame.
    fn poses<'py>(&self, py: Python<'py>) -> PyResult<Poses<'py>> {
        let poses = py.detach(|| self.0.poses()).map_err(|error| errors::raise(py, error))?;
        let count = poses.status.len();
        let world_from_image = arrays::array(py, poses.world_from_image.into_flattened(), [count, 4, 4])?;
        Ok((world_from_image, arrays::array(py, poses.times_s, [count])?, poses.status))
    }

    /// Name of the poses' frame of reference, and the route to it.
    fn world(&self) -> [String; 2] {
        self.0.world()
    }

    /// Reads a frame, (height, width).
    fn picture(&self, py: Python<'_>, number: u64) -> PyResult<Py<PyAny>> {
        let picture = py.detach(|| self.0.picture(number)).map_err(|error| errors::raise(py, error))?;
        arrays::of_picture(py, &picture)
    }
}
