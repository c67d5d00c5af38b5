//! Errors of exports.

use std::path::PathBuf;

use sonoweave_core::reading::PixelType;

/// Reasons why something cannot be exported. Files that exist stay unchanged.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// More voxels than a file may have.
    #[error(
        "the volume would have {} voxels, more than {most}; crop the volume, choose a coarser spacing, or check the \
        poses for strays",
        size.map(|n| n.to_string()).join("×")
    )]
    VolumeTooLarge {
        /// Voxels along x, y, z.
        size: [u64; 3],
        /// The limit of all voxels.
        most: u64,
    },
    /// An error of the file format.
    #[error(transparent)]
    File(#[from] formats::Error),
    /// A file system error.
    #[error("cannot write {path}: {source}", path = path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A radius of the filling that reaches no voxel.
    #[error(
        "the filling's radius of {radius_mm} mm reaches no voxel: the nearest are {nearest_mm} mm apart; choose a \
        larger radius"
    )]
    RadiusTooSmall {
        /// The given radius.
        radius_mm: f64,
        /// The smallest spacing.
        nearest_mm: f64,
    },
    /// A radius of the filling that is too large.
    #[error(
        "the filling's radius of {radius_mm} mm is more than {most} voxels of {nearest_mm} mm; choose a smaller \
        radius, or a coarser spacing"
    )]
    RadiusTooLarge {
        /// The given radius.
        radius_mm: f64,
        /// The smallest spacing.
        nearest_mm: f64,
        /// The limit, voxels.
        most: usize,
    },
    /// The filled voxels need more memory than allowed.
    #[error(
        "the filled voxels need more than the volume's limit of {limit_mib} MiB; choose a smaller radius, crop the \
        volume, or raise the limit"
    )]
    Memory {
        /// Limit, MiB.
        limit_mib: u64,
    },
    /// The system cannot start the threads of the filling.
    #[error("cannot start {threads} threads to fill holes: {reason}; choose fewer threads")]
    Threads {
        /// Requested number.
        threads: usize,
        /// The system's reason.
        reason: String,
    },
    /// A text or a number that DICOM does not allow.
    #[error("{what} {given:?}: {problem}")]
    Identifier {
        /// Name of the text or number.
        what: &'static str,
        /// The given value.
        given: String,
        /// The problem and its correction.
        problem: &'static str,
    },
    /// Floating point voxels, which DICOM's volumes do not have.
    #[error("DICOM's ultrasound volumes have no floating point; choose u8 or u16, and a window of grey levels")]
    FloatingPoint,
    /// More pixel bytes than a DICOM image can have.
    #[error("{bytes} bytes of pixels are more than the 4 GiB that a DICOM image can have; {remedy}")]
    DicomTooLarge {
        /// Number of bytes.
        bytes: u64,
        /// Advice to the user.
        remedy: &'static str,
    },
    /// An edge that is too long for DICOM.
    #[error("{pixels} pixels along an edge are more than the 65535 that a DICOM image can have; {remedy}")]
    DicomTooLong {
        /// Number of pixels.
        pixels: u64,
        /// Advice to the user.
        remedy: &'static str,
    },
    /// No frame or plane to write.
    #[error("there is no frame to write; choose other frames, or a larger part of the volume")]
    NoFrame,
    /// A file name that is none of a movie.
    #[error("{path}: is not the name of a movie; give a name that ends in .apng, .gif or .avi", path = path.display())]
    MovieName {
        /// The given name.
        path: PathBuf,
    },
    /// A rate of pictures that a movie's file cannot have.
    #[error("{hz} pictures a second: such a movie can have {least_hz} to {most_hz}; choose one of these")]
    MovieRate {
        /// The given rate.
        hz: f64,
        /// The lowest rate.
        least_hz: f64,
        /// The highest rate of such files.
        most_hz: u16,
    },
    /// A movie without pictures.
    #[error("{path}: there is no picture to write; check that any slice has a pose", path = path.display())]
    NoPicture {
        /// The target file.
        path: PathBuf,
    },
    /// A picture that cannot be encoded.
    #[error("cannot encode {path} as PNG: {source}; choose another size", path = path.display())]
    Encode {
        /// The target file.
        path: PathBuf,
        /// The encoder's reason.
        source: image::ImageError,
    },
    /// Pixels that PNG does not support.
    #[error(
        "cannot write {path}: PNG holds 1 to 4 channels of 8 or 16 bits, not {channels} of {pixel}; write a sequence",
        path = path.display()
    )]
    PixelType {
        /// The target file.
        path: PathBuf,
        /// Their type.
        pixel: PixelType,
        /// Channels of a pixel.
        channels: u32,
    },
    /// An axis without voxels, or an invalid spacing.
    #[error("cannot draw a volume of {} voxels with a spacing of {} mm; both must be above 0", size.map(|n| n.to_string()).join("×"), spacing.map(|mm| mm.to_string()).join("×"))]
    Grid {
        /// Voxels along x, y, z.
        size: [u64; 3],
        /// mm.
        spacing: [f64; 3],
    },
    /// A window without width.
    #[error("the window from {low} to {high} has no grey levels; its second number must be the larger one")]
    Window {
        /// The given value.
        low: f32,
        /// The given value.
        high: f32,
    },
    /// Planes outside the volume.
    #[error("voxel {} of the planes is outside the volume of {} voxels; choose a voxel in it", through.map(|n| n.to_string()).join(","), size.map(|n| n.to_string()).join("×"))]
    Outside {
        /// The given voxel.
        through: [u64; 3],
        /// Voxels along x, y, z.
        size: [u64; 3],
    },
    /// A phantom that fits on no paper.
    #[error(
        "the phantom's plates of {:.0} × {:.0} mm do not fit on A3 at 1:1 with the drawing's text; choose a smaller \
        phantom",
        size_mm[0], size_mm[1]
    )]
    Paper {
        /// Size of the plates, mm.
        size_mm: [f64; 2],
    },
}
