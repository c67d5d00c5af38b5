//! The native part of `Volume`.

use std::ops::Range;
use std::path::PathBuf;

use numpy::{PyArrayDyn, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;

use sonoweave::library::{Keyword, Keywords, LibraryVolume, MemorySlices, VoxelBox};

use crate::reconstruction::json;
use crate::{arrays, errors, pictures};

/// A volume.
#[pyclass(frozen, name = "Volume", module = "sonoweave._sonoweave")]
pub(crate) struct PyVolume(pub(crate) LibraryVolume);

#[pymethods]
impl PyVolume {
    /// Opens a file or an OME-Zarr folder.
    #[staticmethod]
    #[pyo3(signature = (path, weights, keywords))]
    fn open(py: Python<'_>, path: PathBuf, weights: Option<PathBuf>, keywords: Vec<Keyword>) -> PyResult<Self> {
        let opened = py.detach(|| LibraryVolume::open(&path, weights.as_deref(), &Keywords::new(keywords)?));
        Ok(Self(opened.map_err(|error| errors::raise(py, error))?))
    }

    /// Takes values and weights, (z, y, x), with spacing, origin and axes in x, y, z.
    #[staticmethod]
    #[pyo3(signature = (values, weights, spacing, origin, axes, fields))]
    fn of_arrays(
        py: Python<'_>,
        values: PyReadonlyArrayDyn<'_, f32>,
        weights: Option<PyReadonlyArrayDyn<'_, f32>>,
        spacing: [f64; 3],
        origin: [f64; 3],
        axes: [[f64; 3]; 3],
        fields: Vec<(String, String)>,
    ) -> PyResult<Self> {
        let wrong = || errors::input(py, "values, weights: must be C-contiguous arrays (z, y, x) of one shape".into());
        let &[nz, ny, nx] = values.shape() else { return Err(wrong()) };
        if weights.as_ref().is_some_and(|weights| weights.shape() != values.shape()) {
            return Err(wrong());
        }
        let mut size = [0; 3];
        for (size, n) in size.iter_mut().zip([nx, ny, nz]) {
            *size = u32::try_from(n).map_err(|_| wrong())?;
        }
        let place = (spacing, origin, axes);
        let slices = MemorySlices::new(size, place, values.as_slice().map_err(|_| wrong())?, fields);
        let of_weights = match &weights {
            Some(weights) => Some(MemorySlices::new(size, place, weights.as_slice().map_err(|_| wrong())?, Vec::new())),
            None => None,
        };
        let taken = LibraryVolume::of_slices(slices, of_weights);
        Ok(Self(taken.map_err(|error| errors::raise(py, error))?))
    }

    /// Voxels along z, y, x.
    #[getter]
    fn shape(&self) -> [u64; 3] {
        let [nx, ny, nz] = self.0.grid().size;
        [nz, ny, nx]
    }

    /// Distance between voxels along x, y, z, mm.
    #[getter]
    fn spacing(&self) -> [f64; 3] {
        self.0.grid().spacing.to_array()
    }

    /// Position of the first voxel's centre, x, y, z, mm.
    #[getter]
    fn origin(&self) -> [f64; 3] {
        self.0.grid().origin.to_array()
    }

    /// Directions of the axes x, y, z.
    #[getter]
    fn axes(&self) -> [[f64; 3]; 3] {
        let direction = self.0.grid().direction;
        [direction.x_axis, direction.y_axis, direction.z_axis].map(|axis| axis.to_array())
    }

    /// Values of black and white.
    #[getter]
    fn range(&self) -> [f32; 2] {
        self.0.range()
    }

    /// Header fields of a file.
    #[getter]
    fn fields(&self) -> Vec<(String, String)> {
        self.0.fields()
    }

    /// Notes for the user.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.0.notes()
    }

    /// The recording that it was made of.
    #[getter]
    fn recording(&self) -> Option<PathBuf> {
        self.0.recording()
    }

    /// Account of its frames, as JSON; `None` for a file.
    fn ledger(&self, py: Python<'_>) -> PyResult<Option<String>> {
        py.detach(|| self.0.ledger()).map(|ledger| json(py, &ledger)).transpose()
    }

    /// Reads values, or weights, of a box: first and end along z, y, x.
    fn read<'py>(
        &self,
        py: Python<'py>,
        ranges: [[usize; 2]; 3],
        weights: bool,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let shape = self.shape();
        if (0..3).any(|a| ranges[a][0] > ranges[a][1] || ranges[a][1] as u64 > shape[a]) {
            return Err(errors::input(
                py,
                format!("the box {ranges:?} exceeds the volume of {shape:?} voxels (z, y, x)"),
            ));
        }
        let [zs, ys, xs] = ranges.map(|[first, end]| first..end);
        let voxels: VoxelBox = [xs, ys, zs];
        let [nx, ny, nz] = [0, 1, 2].map(|a| voxels[a].len());
        let read = py.detach(|| {
            let count: usize = voxels.iter().map(Range::len).product();
            let mut read = vec![0.0; count];
            let (values, weights) = if weights { (None, Some(&mut *read)) } else { (Some(&mut *read), None) };
            self.0.read(&voxels, values, weights);
            read
        });
        arrays::array(py, read, [nz, ny, nx])
    }

    /// Renders a picture by the flags of `render`: red, green, blue, opacity, (height, width, 4).
    fn picture<'py>(&self, py: Python<'py>, keywords: Vec<Keyword>) -> PyResult<Bound<'py, PyArrayDyn<u8>>> {
        pictures::drawn(py, || self.0.picture(&keywords))
    }

    /// Writes the volume. Returns the report, as JSON, of a reconstruction.
    #[pyo3(signature = (path, keywords, weights))]
    fn write(
        &self,
        py: Python<'_>,
        path: PathBuf,
        keywords: Vec<Keyword>,
        weights: Option<PathBuf>,
    ) -> PyResult<Option<String>> {
        let written = py.detach(|| self.0.write(&path, &Keywords::new(keywords)?, weights.as_deref()));
        written.map_err(|error| errors::raise(py, error))
    }
}
