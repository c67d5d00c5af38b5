//! Recorded sweeps to volumes and their other outputs.

pub(crate) mod beside;
pub(crate) mod filling;
pub(crate) mod first_moment;
pub(crate) mod leave_one_out;
pub(crate) mod origin;
pub(crate) mod outputs;
pub(crate) mod regions;
pub(crate) mod several;
pub(crate) mod standard_error;
pub(crate) mod sweep;
pub(crate) mod zarr;
