//! Image files: tracked sequences as written by PLUS and 3D Slicer, and volumes.
//!
//! The header's meaning is implemented once; each format adds a grammar in front of it. In the
//! order of the data flow:
//!
//! - `open`: opens a file and checks its header.
//! - `header`: lines to fields, by the format's grammar.
//! - `layout`: shape and packing of the pixel data, and whether they are possible.
//! - `sequence`: meaning of the per-frame fields.
//! - `stream`: pixels, frame by frame.
//! - `volume`: a volume, slice by slice.
//! - [`write`](mod@write): writing files.
//!
//! Formats: `metaimage`, `nrrd`, `nifti` (volumes), and [`dicom`] (only read). Reading needs memory
//! for the header and one frame, whatever the file's length. The exception is interleaved frames
//! (`transposed`), which are all kept in memory.

mod about;
mod container;
mod data;
pub mod dicom;
mod digits;
mod fault;
pub(crate) mod header;
pub mod layout;
mod metaimage;
mod nifti;
mod nrrd;
pub(crate) mod numbers;
mod open;
mod place;
mod scaling;
pub mod sequence;
mod sequence_header;
pub(crate) mod spacing;
pub mod stream;
pub mod transposed;
mod volume;
mod volume_header;
pub mod write;

pub use about::{About, content};
pub use container::Container;
pub use data::BUFFER;
pub use layout::Content;
pub use open::{Opened, open_sequence};
pub use spacing::ELEMENT_SPACING;
pub use transposed::OnRows;
pub use volume::{VolumeReader, VolumeSlices};
pub use volume_header::VolumeHeader;
