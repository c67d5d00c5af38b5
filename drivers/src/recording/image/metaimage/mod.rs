//! MetaImage, as ITK, PLUS and 3D Slicer write it: `grammar` (lines to fields), `claims` (what they say of the pixels), `place` (where a volume lies), `text`
//! (headers to be written).

mod claims;
pub(crate) mod grammar;
mod place;
pub(crate) mod text;
