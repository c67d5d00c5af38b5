//! V4L2: Linux's interface to video devices.
//!
//! - [`kernel`]: the calls themselves.
//! - [`stream`]: buffers shared with the kernel.
//! - [`choose`]: which format, size and rate to ask for, of what is offered.
//! - [`setup`]: input, standard or timings, format and rate put in force.

pub(crate) mod choose;
pub(crate) mod kernel;
pub(crate) mod setup;
pub(crate) mod stream;
