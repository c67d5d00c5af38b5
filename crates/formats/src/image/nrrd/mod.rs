//! NRRD, as written by teem, ITK, PLUS (`.igs.nrrd`) and 3D Slicer (`.seq.nrrd`). Modules:
//! `grammar` (lines to fields), `claims` (description of the pixels), `place` (position of a
//! volume), `index` (times along the list axis), `write` (headers to be written).
//!
//! Supported: versions 1 to 5; header and data in one file, or the data in one separate file
//! beside the header; raw, gzip and text. Refused with an error: data in several files (`LIST`
//! and numbered names), bzip2, hexadecimal digits, blocks.

mod claims;
pub(crate) mod grammar;
mod index;
mod place;
pub(crate) mod write;
