//! The Python module `_sonoweave`: it converts arguments and results, lets other threads of Python
//! run meanwhile, and maps errors. The work is done by [`sonoweave::library`]. Public names and
//! their documentation are in the Python package around it.

mod arrays;
mod calibration;
mod errors;
mod pictures;
mod process;
mod reconstruction;
mod recording;
mod volume;

use pyo3::prelude::*;

#[pymodule]
mod _sonoweave {
    #[pymodule_export]
    use super::calibration::PyCalibration;
    #[pymodule_export]
    use super::pictures::{composite, picture, render_part};
    #[pymodule_export]
    use super::reconstruction::PyReconstruction;
    #[pymodule_export]
    use super::recording::PyRecording;
    #[pymodule_export]
    use super::volume::PyVolume;

    /// Version of the program.
    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");
}
