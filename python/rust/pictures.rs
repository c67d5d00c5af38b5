//! Pictures of volumes on the disk.

use std::path::PathBuf;

use numpy::PyArrayDyn;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::PyBytes;

use sonoweave::library::{Keyword, LibraryError, picture_of_file, picture_of_parts, picture_part};

use crate::{arrays, errors};

/// Flags of `render` by name.
type Pairs = Vec<Keyword>;
/// Red, green, blue, opacity, (height, width, 4).
type Picture<'py> = Bound<'py, PyArrayDyn<u8>>;

/// Draws while other threads of Python run, and makes an array of it.
pub(crate) fn drawn<'py>(
    py: Python<'py>,
    draw: impl FnOnce() -> Result<([u32; 2], Vec<u8>), LibraryError> + Send,
) -> PyResult<Picture<'py>> {
    let drawn = py.detach(|| {
        let (size, pixels) = draw()?;
        Ok((size, pixels.as_chunks::<3>().0.iter().flat_map(|[r, g, b]| [*r, *g, *b, u8::MAX]).collect()))
    });
    let ([width, height], pixels) = drawn.map_err(|error| errors::raise(py, error))?;
    arrays::array(py, pixels, [height as usize, width as usize, 4])
}

/// Renders a picture of a file or an OME-Zarr folder by the flags of `render`.
#[pyfunction]
#[pyo3(signature = (path, weights, keywords))]
pub(crate) fn picture(
    py: Python<'_>,
    path: PathBuf,
    weights: Option<PathBuf>,
    keywords: Pairs,
) -> PyResult<Picture<'_>> {
    drawn(py, || picture_of_file(&path, weights.as_deref(), &keywords))
}

/// Renders part `part`, from 1, of `parts` of a picture of an OME-Zarr folder to a message.
#[pyfunction]
#[pyo3(signature = (path, part, parts, fold, keywords))]
pub(crate) fn render_part(
    py: Python<'_>,
    path: PathBuf,
    part: u64,
    parts: u64,
    fold: bool,
    keywords: Pairs,
) -> PyResult<Bound<'_, PyBytes>> {
    let message = py.detach(|| picture_part(&path, (part, parts), fold, &keywords));
    message.map(|bytes| PyBytes::new(py, &bytes)).map_err(|error| errors::raise(py, error))
}

/// Makes the picture of an OME-Zarr folder of the messages of all its parts.
#[pyfunction]
#[pyo3(signature = (path, messages, keywords))]
pub(crate) fn composite(
    py: Python<'_>,
    path: PathBuf,
    messages: Vec<PyBackedBytes>,
    keywords: Pairs,
) -> PyResult<Picture<'_>> {
    drawn(py, || picture_of_parts(&path, messages, &keywords))
}
