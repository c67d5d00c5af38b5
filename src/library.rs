//! The work of the commands for programs that call it, such as the Python module: the same code,
//! settings and defaults as the command line's.
//!
//! - [`Keywords`]: the flags of `reconstruct`, by their names.
//! - [`Recording`]: a tracked sequence or session, from a file or from memory.
//! - [`Reconstruction`]: a volume that grows by recordings and by single frames.
//! - [`LibraryVolume`]: a volume in memory: the present state of a reconstruction, or a file's.
//! - [`picture_of_file`]: a picture of a volume on the disk; [`picture_part`] and
//!   [`picture_of_parts`]: the same by several processes.
//! - [`LibraryCalibration`]: a calibration file, and the commands that make one.
//! - [`LibraryError`]: the reason why something failed, by kind.

mod calibration;
mod error;
mod keywords;
mod pictures;
mod reconstruction;
mod recording;
mod session;
mod slices;
mod volume;

pub use calibration::LibraryCalibration;
pub use error::LibraryError;
pub use keywords::{Keyword, Keywords};
pub use pictures::{picture_of_file, picture_of_parts, picture_part};
pub use reconstruction::Reconstruction;
pub use recording::{Picture, Poses, Recording};
pub use slices::MemorySlices;
pub use volume::{LibraryVolume, VoxelBox};

pub use pipeline::session::{Inserted, PosedFrames};
pub use sonoweave_core::ledger::Ledger;
pub use sonoweave_core::reading::PixelType;
pub use sonoweave_core::slice::Pixels;
