//! The native part of `Calibration`.

use std::path::PathBuf;

use numpy::PyArrayDyn;
use pyo3::prelude::*;

use sonoweave::library::{Keyword, LibraryCalibration};

use crate::{arrays, errors};

/// A calibration.
#[pyclass(frozen, name = "Calibration", module = "sonoweave._sonoweave")]
pub(crate) struct PyCalibration(LibraryCalibration);

#[pymethods]
impl PyCalibration {
    /// Reads a file.
    #[new]
    #[pyo3(signature = (path, preset))]
    fn new(py: Python<'_>, path: PathBuf, preset: Option<String>) -> PyResult<Self> {
        let read = py.detach(|| LibraryCalibration::read(&path, preset.as_deref()));
        Ok(Self(read.map_err(|error| errors::raise(py, error))?))
    }

    /// Carries out a command of `calibrate`. Returns its report, as JSON.
    #[staticmethod]
    fn measure(py: Python<'_>, quantity: &str, keywords: Vec<Keyword>) -> PyResult<String> {
        py.detach(|| LibraryCalibration::measure(quantity, keywords)).map_err(|error| errors::raise(py, error))
    }

    /// Names of the constant transforms: from, to.
    #[getter]
    fn names(&self) -> Vec<(String, String)> {
        self.0.transforms.iter().map(|(from, to, _)| (from.clone(), to.clone())).collect()
    }

    /// The constant transforms, (N, 4, 4), in the order of the names.
    fn matrices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let numbers = self.0.transforms.iter().flat_map(|(_, _, rows)| *rows).collect();
        arrays::array(py, numbers, [self.0.transforms.len(), 4, 4])
    }

    /// Name of the image's frame of reference.
    #[getter]
    fn image(&self) -> String {
        self.0.image.clone()
    }

    /// Latencies of video and tracker, ms.
    #[getter]
    fn latency_ms(&self) -> Option<[f64; 2]> {
        self.0.latency_ms
    }

    /// Distance between voxels, mm.
    #[getter]
    fn spacing_mm(&self) -> Option<[f64; 3]> {
        self.0.spacing_mm
    }

    /// Origin of the numbers.
    #[getter]
    fn provenance(&self) -> String {
        self.0.provenance.clone()
    }

    /// Names of the presets.
    #[getter]
    fn presets(&self) -> Vec<String> {
        self.0.presets.clone()
    }
}
