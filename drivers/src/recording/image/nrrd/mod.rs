//! NRRD, as teem, ITK, PLUS (`.igs.nrrd`) and 3D Slicer (`.seq.nrrd`) write it: `grammar` (lines to fields), `claims` (what they say of the pixels), `place`
//! (where a volume lies), `index` (times by the list's axis), `text` (headers to be
//! written).
//!
//! Read: versions 1 to 5; header and data in one file, or the data in one file beside the header; raw, gzip and text. Not read, and said so: data in several
//! files (`LIST` and numbered names), bzip2 and hexadecimal digits, blocks.

mod claims;
pub(crate) mod grammar;
mod index;
mod place;
pub(crate) mod text;
