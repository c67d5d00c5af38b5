//! The result of a session or of a reconstruction.

use glam::DVec3;

use mask::MaskFound;
use reconstruct::PathReconstructor;
use reconstruct::path_choice::Chosen;
use sonoweave_core::ledger::Ledger;

use super::PixelKind;
use super::smoothing::SmoothingStatus;

/// Result of a run.
pub struct Outcome {
    /// The volume and its settings.
    pub reconstructor: PathReconstructor,
    /// The initially chosen path, and the reason; [`PathReconstructor::path`] is the final one.
    pub chosen: Chosen,
    /// The frame ledger.
    pub ledger: Ledger,
    /// Name of the frame in which the volume lies.
    pub world: String,
    /// Description of the transforms from the image to the world.
    pub route: String,
    /// Frames by the smoothing of their poses; `None` if they are used as measured.
    pub smoothing: Option<SmoothingStatus>,
    /// Corrections of a recorded session, by number and kind; `None` if none was applied.
    pub corrections: Option<String>,
    /// Root mean square error of places in the image by the noise of poses, mm; `None` if it is
    /// unknown.
    pub pose_error_mm: Option<f64>,
    /// The frames' data region, as it was last.
    pub mask: MaskFound,
    /// First and last voxel that the slices' data and kernels reach, by the poses known before
    /// the first insertion.
    pub reached: Option<[[i64; 3]; 2]>,
    /// The slices' mean directions of u and v in the world, if they exist.
    pub slice_axes: Option<[DVec3; 2]>,
    /// SHA-256 over the inserted slices: number, time and pose of each, in their order.
    pub slices_sha256: [u8; 32],
    /// Insertion time of each slice, ms, including in-plane filtering.
    pub insert_ms: Vec<f64>,
    /// Voxels that gained weight, summed over slices.
    pub voxels_updated: u64,
    /// Whether the frames had 8 bits, 16 bits, or floating point.
    pub pixels: PixelKind,
    /// Notes for the user, as sentences.
    pub notes: Vec<String>,
}
