//! Volumes and sweeps to DICOM: what a picture archive takes.
//!
//! - [`volume`]: a volume as Enhanced US Volume Storage, a plane a frame, each with its place in the volume's frame of reference.
//! - [`sweep`]: a sweep as Ultrasound Multi-frame Image Storage, with the time of each frame, and its pose in a private element.
//! - [`identifiers`]: who and what it is of: what is given, and else nothing.
//! - `uid`: unique identifiers, from what is written.
//! - `dataset`: the modules that both have, and how a file is written.
//!
//! Pixels are not compressed, and numbers are little-endian with their types in the file (Explicit VR Little Endian). The same input and identifiers give the same
//! bytes: there is no clock in them, and unique identifiers are 2.25 and a UUID of the content's SHA-256.
//!
//! **Where nothing is known.** The standard has attributes that must have a value. Where the recording has none they are: date and time of acquisition 1900-01-01
//! 00:00:00, unless one is given; mechanical and thermal indices, depth of focus and depth of field 0; geometry, steering and application of the transducer, and the
//! view, the code 261665006 "Unknown" of SNOMED CT; the body part its code 123037004 "Body structure"; the matrix from the volume to a transducer that is moved by hand
//! (relationship VARIABLE), the identity.
//!
//! **What was not seen.** DICOM has no weights. Voxels that were not seen have the value that the export gives them (0 unless another is asked for), and the image's
//! comments say so. There is no pixel padding value, because seen voxels may have that value, too.
//!
//! The volume's frame of reference is the world of the recording (Reference, else Tracker) in mm: it is not a patient's.

pub mod identifiers;
pub mod sweep;
pub mod volume;

mod dataset;
mod uid;

use std::path::PathBuf;

pub use identifiers::Identifiers;

/// Bytes of pixels that an image may have: its length is an even number of 32 bits.
pub const MOST_BYTES: u64 = 0xffff_fffe;

/// Why there is no file.
#[derive(Debug, thiserror::Error)]
pub enum DicomError {
    /// A text or a number that the standard does not allow.
    #[error("{what} {given:?}: {problem}")]
    Identifier {
        /// Which.
        what: &'static str,
        /// As given.
        given: String,
        /// What is wrong, and what is right.
        problem: &'static str,
    },
    /// Voxels or pixels of a type that such images do not have.
    #[error("{0}")]
    Scalar(String),
    /// Too many pixels.
    #[error("{bytes} bytes of pixels are more than the {MOST_BYTES} that a DICOM image can have: {remedy}")]
    TooLarge {
        /// How many.
        bytes: u64,
        /// What to do.
        remedy: &'static str,
    },
    /// An edge that is too long.
    #[error("{pixels} pixels along an edge are more than the 65535 that a DICOM image can have: {remedy}")]
    TooLong {
        /// How many.
        pixels: u64,
        /// What to do.
        remedy: &'static str,
    },
    /// Nothing to write.
    #[error("there is no frame to write")]
    Empty,
    /// The file.
    #[error("{path}: writing the DICOM file failed: {source}", path = path.display())]
    Io {
        /// The file; it is as it was before.
        path: PathBuf,
        /// The system's reason.
        #[source]
        source: std::io::Error,
    },
}

/// The edges of an image in the numbers that it has.
fn edges(edges: [u64; 2], remedy: &'static str) -> Result<[u16; 2], DicomError> {
    let edge = |pixels: u64| u16::try_from(pixels).map_err(|_| DicomError::TooLong { pixels, remedy });
    Ok([edge(edges[0])?, edge(edges[1])?])
}

/// Bytes of all frames, if an image can have as many.
fn bytes(frames: u64, edges: [u16; 2], each: u64, remedy: &'static str) -> Result<usize, DicomError> {
    let area = u64::from(edges[0]) * u64::from(edges[1]) * each;
    let bytes = frames.saturating_mul(area);
    // A number of frames is signed.
    if bytes > MOST_BYTES || frames > i32::MAX as u64 {
        return Err(DicomError::TooLarge { bytes, remedy });
    }
    usize::try_from(bytes).map_err(|_| DicomError::TooLarge { bytes, remedy })
}

#[cfg(test)]
mod tests;
