//! Poses of a stylus from a recording.

mod options;
mod samples;
mod sequence;
mod session;

pub use options::{Recording, Source};
pub(super) use samples::Taken;
pub use samples::{Counts, Poses};
pub(super) use session::{check, poses};

use crate::failure::Failure;

impl Recording {
    /// Reads the poses.
    ///
    /// # Errors
    /// [`Failure`] when the recording cannot be read, does not name the stylus, or has no way
    /// from it to the reference.
    pub fn read(&self) -> Result<Poses, Failure> {
        match &self.source.session {
            Some(path) => session::read(self, path),
            None => sequence::read(self, self.path()),
        }
    }
}
