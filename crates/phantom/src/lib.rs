//! Phantoms: scans of scenes with known truth, for demonstration, tests and benches.
//!
//! A [`Scene`] gives a grey level to every point of the world. A [`Trajectory`] moves the image
//! plane through it. A [`Scan`] paints the frames that the scanner would show, with noise and a
//! fan. [`truth`] computes the volume of a perfect reconstruction.
//!
//! - [`scene`]: scenes, with closed forms under Gaussian blur.
//! - [`trajectory`]: the pose of the image plane at each frame.
//! - [`paint`]: a scene's grey levels over a flat lattice, fast.
//! - [`body`]: objects for a simulated ultrasound scanner: a doll in a water tank, a thigh,
//!   phantoms for calibration.
//! - [`bmode`]: the scanner's images of them.
//! - [`scan`]: composes the parts into posed slices, and into the records of a tracked
//!   sequence.
//! - [`named`]: scenes, trajectories and scanners by name.
//! - [`bedside`]: the same scan over time, for virtual devices that observe it.
//! - [`truth`]: the scene on a volume's lattice, and the voxels that a scan can know.
//! - [`blur`]: the truth under a reconstruction's kernel.
//! - [`error`]: errors of a volume against the truth.
//!
//! One seed determines every bit, on every machine and for any number of threads. Random
//! numbers are counted per purpose and frame. The elementary functions are this module's own,
//! because the platform's differ in the last bit. Only the fan's edges use the platform's
//! functions; their slack of 1e-9 pixel is far wider than the platforms' differences.

pub mod bedside;
pub mod blur;
pub mod bmode;
pub mod body;
mod complex;
mod elementary;
pub mod error;
mod grid;
pub mod named;
pub mod paint;
mod random;
pub mod scan;
pub mod scene;
#[cfg(test)]
mod tests {
    pub(crate) mod quadrature;
}
pub mod trajectory;
pub mod truth;

use calibration::error::CalibrationError;

pub use bedside::Bedside;
pub use blur::EffectiveKernel;
pub use bmode::Scanner;
pub use body::Body;
pub use error::Errors;
pub use scan::{Scan, ScanSettings, TrackerNoise};
pub use scene::Scene;
pub use trajectory::{Motion, Trajectory};

/// Reasons why a phantom cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PhantomError {
    /// No frames, or too many.
    #[error("a scan of {frames} frames cannot be made; ask for 1 to {limit}")]
    Frames {
        /// The requested number.
        frames: u32,
        /// The largest number.
        limit: u32,
    },
    /// Zero, negative, infinite or not a number.
    #[error("{what} is {mm} mm; it must be a positive, finite length")]
    Length {
        /// Name of the length.
        what: &'static str,
        /// The given value.
        mm: f64,
    },
    /// An image without pixels, or larger than memory.
    #[error(
        "a picture of {width}×{height} pixels cannot be painted; both sides must be at least 1 and the product at most {limit}"
    )]
    PictureSize {
        /// Pixels along u.
        width: u32,
        /// Pixels along v.
        height: u32,
        /// Largest number of pixels.
        limit: u64,
    },
    /// Negative or not a number.
    #[error("the noise has a standard deviation of {sd} grey levels; it must be zero or more, and finite")]
    Noise {
        /// The given value.
        sd: f64,
    },
    /// Negative or not a number.
    #[error("the tracker's noise is {mm} mm and {degrees}°; both must be zero or more, finite, and at most {limit}")]
    TrackerNoise {
        /// The given position noise, mm.
        mm: f64,
        /// The given rotation noise, degrees.
        degrees: f64,
        /// The limit of each.
        limit: f64,
    },
    /// No frames are left for the motion.
    #[error(
        "a dwell of {dwell} frames leaves nothing of {frames} frames to move with; give more frames or a shorter dwell"
    )]
    Dwell {
        /// Frames of the dwell.
        dwell: u32,
        /// Total number of frames.
        frames: u32,
    },
    /// The rotation would return to where it began.
    #[error(
        "the picture would turn by {degrees:.0}°, more than a whole turn; ask for fewer frames, a smaller gap or a larger radius"
    )]
    TurnsOver {
        /// Angle from the first to the last frame.
        degrees: f64,
    },
    /// The blur would need too much memory.
    #[error(
        "so thin a kernel, or so fine a scene, needs {points:.1e} points at once for the blurred truth, more than {limit}; give a larger smallest σ or a smaller scan"
    )]
    KernelTooThin {
        /// Points of the lattice for one layer of voxels.
        points: f64,
        /// Largest number of points.
        limit: u64,
    },
    /// The fan would turn to the other side.
    #[error(
        "the fan would turn by {degrees:.0}°, more than half a turn; ask for fewer frames, a smaller gap or a farther axis"
    )]
    FanTurnsOver {
        /// Angle from the first to the last frame.
        degrees: f64,
    },
    /// A fan beside the image.
    #[error(
        "the fan leaves no pixel of a picture of {width}×{height} pixels; give its numbers in pixels of that picture"
    )]
    EmptyFan {
        /// Pixels along u.
        width: u32,
        /// Pixels along v.
        height: u32,
    },
    /// A scanner's number out of range.
    #[error("{what} is {value}; it must lie between {low} and {high}")]
    Scanner {
        /// Name of the number.
        what: &'static str,
        /// The given value.
        value: f64,
        /// Lower limit.
        low: f64,
        /// Upper limit.
        high: f64,
    },
    /// Pixels in which the field would not be a fan.
    #[error(
        "a curvilinear transducer's field is a fan in square pixels only, not in pixels of {} mm; give one size", pixel_mm.map(|mm| mm.to_string()).join("×")
    )]
    OblongPixels {
        /// Pixel spacing along u and v, mm.
        pixel_mm: [f64; 2],
    },
    /// A scanner without a body, or a body without a scanner.
    #[error("{0}")]
    NoEchoes(&'static str),
    /// A motion that an arm cannot follow.
    #[error(
        "frame {frame} of the sweep cannot be made by an arm: {why}; choose a motion in a plane (arm, parallel, jittered, fan, rotation)"
    )]
    NotPlanar {
        /// The frame, from 0.
        frame: u32,
        /// The deviation from the arm's plane.
        why: CalibrationError,
    },
    /// A motion out of an arm's reach.
    #[error("frame {frame} of the sweep cannot be made by this arm: {why}")]
    Unreachable {
        /// The frame, from 0.
        frame: u32,
        /// The missing distance.
        why: CalibrationError,
    },
    /// Too many voxels for a truth volume.
    #[error("a truth volume of {} voxels is larger than the limit of {limit} voxels; choose a coarser spacing", size.map(|n| n.to_string()).join("×"))]
    VolumeSize {
        /// Voxels along x, y, z.
        size: [u64; 3],
        /// Largest number of voxels.
        limit: u64,
    },
}

impl PhantomError {
    /// Requires a positive, finite length.
    fn check_length(what: &'static str, mm: f64) -> Result<(), Self> {
        if mm.is_finite() && mm > 0.0 { Ok(()) } else { Err(Self::Length { what, mm }) }
    }
}
