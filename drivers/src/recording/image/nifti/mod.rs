//! NIfTI-1 volumes in one file (`.nii`, `.nii.gz`): `read`, `write`, `affine` (where they lie), `field` (where numbers stand in the header).
//!
//! NIfTI's x and y run to the right and to the front, those of all else here to the left and to the back: both change their signs on the way, so that other
//! programs show a volume at the same place whatever it was written to. Numbers of its header are of single precision, and so is the place. What has no field
//! of its own goes into an extension of text, a line a field.

mod affine;
mod field;
pub(crate) mod read;
pub(crate) mod write;
