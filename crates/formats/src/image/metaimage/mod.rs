//! MetaImage, as written by ITK, PLUS and 3D Slicer: `grammar` (lines to fields), `claims`
//! (description of the pixels), `place` (position of a volume), `write` (headers to be written).

mod claims;
pub(crate) mod grammar;
mod place;
pub(crate) mod write;
