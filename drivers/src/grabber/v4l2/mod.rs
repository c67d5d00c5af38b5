//! V4L2: Linux's interface to video devices.
//!
//! - [`system_calls`]: the system calls.
//! - [`buffers`]: buffers shared with the kernel.
//! - [`choose`]: choice of format, size and rate from the offers.
//! - [`setup`]: sets input, standard or timings, format and rate; [`setup_error`]: why it cannot.

pub(crate) mod buffers;
pub(crate) mod choose;
pub(crate) mod setup;
pub(crate) mod setup_error;
pub(crate) mod system_calls;
