//! Volumes and sweeps to DICOM, for picture archives.
//!
//! - [`volume`]: a volume as Enhanced US Volume Storage, a plane a frame, each with its place in
//!   the volume's frame of reference.
//! - [`sweep`]: a sweep as Ultrasound Multi-frame Image Storage, with the time of each frame,
//!   and its pose in a private element.
//! - [`segmentation`]: a region as a binary Segmentation, a plane a frame.
//! - `block`: our private elements, which `formats` reads.
//! - [`identifiers`]: identifiers of the patient and the study: only what the user gives.
//! - `uid`: unique identifiers, derived from the content.
//! - `dataset`: modules common to both, and the writing of files.
//!
//! Pixels are not compressed, and numbers are little-endian with their types in the file
//! (Explicit VR Little Endian). The same input and identifiers give the same bytes: the file
//! holds no clock time, and unique identifiers are 2.25 and a UUID of the content's SHA-256.
//!
//! **Unknown values.** The standard requires values for some attributes. If the recording has
//! none, these are written:
//! - Date and time of acquisition: 1900-01-01 00:00:00, unless one is given.
//! - Mechanical and thermal indices, depth of focus and depth of field: 0.
//! - Geometry, steering and application of the transducer, and the view: the SNOMED CT code
//!   261665006 "Unknown".
//! - Body part: the SNOMED CT code 123037004 "Body structure".
//! - Matrix from the volume to a transducer moved by hand (relationship VARIABLE): the identity.
//!
//! **Purpose.** Every file has Content Qualification (0018,9004) RESEARCH, an attribute of the SOP
//! common module, so that an archive can filter by it. Image Comments (0020,4000) give the
//! program's notice in words, which viewers show. Both are optional attributes of all images.
//!
//! **Read back.** Private elements hold what the standard's attributes would round: poses, times
//! and the volume's place as doubles, the status of poses, and the volume's numeric fields.
//!
//! **Unseen voxels.** DICOM has no weights. Unseen voxels have the value that the export gives
//! them (0 by default), and the image's comments give it. There is no pixel padding value,
//! because seen voxels can have that value, too.
//!
//! The volume's frame of reference is the world of the recording (Reference, else Tracker) in
//! mm: it is not a patient's.

pub mod identifiers;
pub mod segmentation;
pub mod sweep;
pub mod volume;

mod block;
mod dataset;
mod uid;

use super::ExportError;
pub use identifiers::Identifiers;

/// Largest number of pixel bytes in an image: the length is an even number of 32 bits.
pub const MOST_BYTES: u64 = 0xffff_fffe;

/// Converts the edges of an image to its number type.
fn edges(edges: [u64; 2], remedy: &'static str) -> Result<[u16; 2], ExportError> {
    let edge = |pixels: u64| u16::try_from(pixels).map_err(|_| ExportError::DicomTooLong { pixels, remedy });
    Ok([edge(edges[0])?, edge(edges[1])?])
}

/// Returns the bytes of all frames, if an image can hold them.
fn bytes(frames: u64, edges: [u16; 2], each: u64, remedy: &'static str) -> Result<usize, ExportError> {
    let area = u64::from(edges[0]) * u64::from(edges[1]) * each;
    let bytes = frames.saturating_mul(area);
    // The number of frames is a signed integer.
    if bytes > MOST_BYTES || frames > i32::MAX as u64 {
        return Err(ExportError::DicomTooLarge { bytes, remedy });
    }
    usize::try_from(bytes).map_err(|_| ExportError::DicomTooLarge { bytes, remedy })
}

#[cfg(test)]
mod tests;
