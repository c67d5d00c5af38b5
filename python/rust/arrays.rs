//! Arrays of NumPy to pixels and poses, and back. The package has checked shapes and types.

use std::sync::Arc;

use numpy::{PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;

use sonoweave::library::{Picture, PixelType, Pixels};

use crate::errors;

/// A stack of frames, copied.
pub(crate) struct Frames {
    /// Width and height, pixels.
    pub(crate) size: [u32; 2],
    pub(crate) pixel: PixelType,
    /// Pixels of each frame, in native byte order.
    pub(crate) frames: Vec<Arc<[u8]>>,
}

/// Copies a C-contiguous array of shape (N, height, width), of type uint8, uint16 or float32.
///
/// # Errors
/// Another shape or type.
pub(crate) fn frames(array: &Bound<'_, PyAny>) -> PyResult<Frames> {
    if let Ok(array) = array.extract::<PyReadonlyArrayDyn<'_, u8>>() {
        return copy(&array, PixelType::U8);
    }
    if let Ok(array) = array.extract::<PyReadonlyArrayDyn<'_, u16>>() {
        return copy(&array, PixelType::U16);
    }
    match array.extract::<PyReadonlyArrayDyn<'_, f32>>() {
        Ok(array) => copy(&array, PixelType::F32),
        Err(_) => Err(errors::input(array.py(), "frames: must be an array of uint8, uint16 or float32".into())),
    }
}

fn copy<T: numpy::Element + bytemuck::Pod>(array: &PyReadonlyArrayDyn<'_, T>, pixel: PixelType) -> PyResult<Frames> {
    let wrong = || {
        let shape =
            format!("frames: must be a C-contiguous array (N, height, width); the shape is {:?}", array.shape());
        errors::input(array.py(), shape)
    };
    let &[count, height, width] = array.shape() else { return Err(wrong()) };
    let (Ok(values), Ok(width_px), Ok(height_px)) = (array.as_slice(), u32::try_from(width), u32::try_from(height))
    else {
        return Err(wrong());
    };
    let frame = |at: usize| Arc::from(bytemuck::cast_slice(&values[at * width * height..(at + 1) * width * height]));
    Ok(Frames { size: [width_px, height_px], pixel, frames: (0..count).map(frame).collect() })
}

/// Copies a C-contiguous array of shape (N, 4, 4), row major.
///
/// # Errors
/// Another shape.
pub(crate) fn poses(array: &PyReadonlyArrayDyn<'_, f64>) -> PyResult<Vec<[f64; 16]>> {
    let wrong = || errors::input(array.py(), "world_from_image: must be a C-contiguous array (N, 4, 4)".into());
    let &[_, 4, 4] = array.shape() else { return Err(wrong()) };
    let values = array.as_slice().map_err(|_| wrong())?;
    Ok(values.as_chunks::<16>().0.to_vec())
}

/// Makes an array of a frame, shape (height, width).
pub(crate) fn of_picture(py: Python<'_>, picture: &Picture) -> PyResult<Py<PyAny>> {
    let shape = picture.shape;
    Ok(match &picture.pixels {
        Pixels::U8(pixels) => array(py, pixels.to_vec(), shape)?.into_any().unbind(),
        Pixels::U16(pixels) => array(py, pixels.to_vec(), shape)?.into_any().unbind(),
        Pixels::F32(pixels) => array(py, pixels.to_vec(), shape)?.into_any().unbind(),
    })
}

/// Makes an array of values, without a copy.
pub(crate) fn array<T: numpy::Element, const N: usize>(
    py: Python<'_>,
    values: Vec<T>,
    shape: [usize; N],
) -> PyResult<Bound<'_, PyArrayDyn<T>>> {
    numpy::PyArray1::from_vec(py, values).reshape(shape.to_vec())
}
