//! Errors of the library as Python's exceptions, whose classes are Python's.

use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;

use sonoweave::library::LibraryError;

/// Module of the classes.
const MODULE: &str = "sonoweave.errors";

static SONOWEAVE: PyOnceLock<Py<PyType>> = PyOnceLock::new();
static INPUT: PyOnceLock<Py<PyType>> = PyOnceLock::new();
static CALIBRATION: PyOnceLock<Py<PyType>> = PyOnceLock::new();
static MEMORY: PyOnceLock<Py<PyType>> = PyOnceLock::new();

/// Makes an exception of a class of the package; returns the import's error if there is none.
fn make(py: Python<'_>, class: &PyOnceLock<Py<PyType>>, name: &str, arguments: impl Arguments) -> PyErr {
    let class = match class.import(py, MODULE, name) {
        Ok(class) => class.clone(),
        Err(error) => return error,
    };
    arguments.raise(class)
}

/// Arguments of an exception.
trait Arguments {
    fn raise(self, class: Bound<'_, PyType>) -> PyErr;
}

impl Arguments for String {
    fn raise(self, class: Bound<'_, PyType>) -> PyErr {
        PyErr::from_type(class, (self,))
    }
}

impl Arguments for (String, [String; 2]) {
    fn raise(self, class: Bound<'_, PyType>) -> PyErr {
        let (sentence, [from, to]) = self;
        PyErr::from_type(class, (sentence, (from, to)))
    }
}

/// Converts an error of the library.
pub(crate) fn raise(py: Python<'_>, error: LibraryError) -> PyErr {
    match error {
        LibraryError::Input(sentence) => make(py, &INPUT, "InputError", sentence),
        LibraryError::Calibration { sentence, missing } => {
            make(py, &CALIBRATION, "CalibrationError", (sentence, missing))
        }
        LibraryError::Memory(sentence) => make(py, &MEMORY, "MemoryLimit", sentence),
        LibraryError::File { sentence, code, path } => PyOSError::new_err((code, sentence, path.into_os_string())),
    }
}

/// Makes the error of an argument that does not fit.
pub(crate) fn input(py: Python<'_>, sentence: String) -> PyErr {
    make(py, &INPUT, "InputError", sentence)
}

/// Makes the package's general error.
pub(crate) fn general(py: Python<'_>, sentence: String) -> PyErr {
    make(py, &SONOWEAVE, "SonoweaveError", sentence)
}
