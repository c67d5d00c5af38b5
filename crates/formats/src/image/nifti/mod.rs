//! NIfTI-1 volumes in one file (`.nii`, `.nii.gz`): `read`, `write`, `affine` (position in
//! space), `field` (offsets in the header).
//!
//! In NIfTI, x and y point to the right and to the front; everywhere else here, to the left and
//! to the back. Both change signs on conversion, so that other programs show a volume at the
//! same place in every format. The header stores the position in single precision. Fields that
//! NIfTI lacks go into a text extension, one line each. The crate nifti writes from ndarray only,
//! reads without limits of memory, and its errors name no field.

mod affine;
mod field;
pub(crate) mod read;
pub(crate) mod write;
