//! Phantoms: scans of scenes whose truth is known, for demonstration, tests and benches.
//!
//! A [`Scene`] gives a grey level to every point of the world, a [`Trajectory`] moves the picture through it, a [`Scan`] paints what the scanner would
//! show at each frame, with noise and a fan, and [`truth`] says what a perfect reconstruction would hold.
//!
//! - [`scene`]: what is there, with closed forms under Gaussian blur.
//! - [`trajectory`]: where the picture lies at each frame.
//! - [`paint`]: a scene's grey levels over a flat lattice, fast.
//! - [`body`]: what an ultrasound scanner looks into: a doll in a water tank, a thigh, phantoms for calibration.
//! - [`bmode`]: what the scanner shows of it.
//! - [`scan`]: the pieces composed into posed slices and into what a tracked sequence records.
//! - [`named`]: scenes, trajectories and scanners by name.
//! - [`bedside`]: the same scan as it goes on in time, for virtual devices that measure and see it.
//! - [`truth`]: the scene on a volume's lattice, and which voxels a scan can know.
//! - [`blur`]: the same under a reconstruction's kernel.
//! - [`error`]: how far a volume is from it.
//!
//! One seed determines every bit, on every machine and for any number of threads: random numbers are counted per purpose and frame, and the
//! elementary functions are our own, because the platform's differ in the last bit. The fan's edges alone are the platform's; their slack of 1e-9 pixel
//! is far wider than what platforms differ by.

pub mod bedside;
pub mod blur;
pub mod bmode;
pub mod body;
mod complex;
mod elementary;
pub mod error;
pub mod named;
pub mod paint;
#[cfg(test)]
mod quadrature;
mod random;
pub mod scan;
pub mod scene;
pub mod trajectory;
pub mod truth;

use calibration::arm::{NotPlanar, Unreachable};

pub use bedside::Bedside;
pub use blur::EffectiveKernel;
pub use bmode::Scanner;
pub use body::Body;
pub use error::Errors;
pub use scan::{Scan, ScanSettings, TrackerNoise};
pub use scene::Scene;
pub use trajectory::{Motion, Trajectory};

/// Why a phantom cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PhantomError {
    /// None, or absurdly many.
    #[error("a scan of {frames} frames cannot be made; ask for 1 to {limit}")]
    Frames {
        /// As asked.
        frames: u32,
        /// The most there may be.
        limit: u32,
    },
    /// Zero, negative, infinite or not a number.
    #[error("{what} is {mm} mm; it must be a positive, finite length")]
    Length {
        /// Which length.
        what: &'static str,
        /// As given.
        mm: f64,
    },
    /// A picture without pixels, or more of them than memory holds.
    #[error(
        "a picture of {width}×{height} pixels cannot be painted; both sides must be at least 1 and the product at most {limit}"
    )]
    PictureSize {
        /// Pixels along u.
        width: u32,
        /// Pixels along v.
        height: u32,
        /// The most pixels there may be.
        limit: u64,
    },
    /// Negative or not a number.
    #[error("the noise has a standard deviation of {sd} grey levels; it must be zero or more, and finite")]
    Noise {
        /// As given.
        sd: f64,
    },
    /// Negative or not a number.
    #[error("the tracker's noise is {mm} mm and {degrees}°; both must be zero or more, finite, and at most {limit}")]
    TrackerNoise {
        /// As given, mm.
        mm: f64,
        /// As given, degrees.
        degrees: f64,
        /// The most that either may be.
        limit: f64,
    },
    /// Nothing left to move with.
    #[error(
        "a dwell of {dwell} frames leaves nothing of {frames} frames to move with; give more frames or a shorter dwell"
    )]
    Dwell {
        /// Frames of the dwell.
        dwell: u32,
        /// Frames in all.
        frames: u32,
    },
    /// The picture would come round to where it began.
    #[error(
        "the picture would turn by {degrees:.0}°, more than a whole turn; ask for fewer frames, a smaller gap or a larger radius"
    )]
    TurnsOver {
        /// From the first to the last frame.
        degrees: f64,
    },
    /// A blur that would take too much memory.
    #[error(
        "so thin a kernel, or so fine a scene, needs {points:.1e} points at once for the blurred truth, more than {limit}; give a larger smallest σ or a smaller scan"
    )]
    KernelTooThin {
        /// Points of the lattice for one layer of voxels.
        points: f64,
        /// The most there may be.
        limit: u64,
    },
    /// The sweep would come round to the other side.
    #[error(
        "the fan would turn by {degrees:.0}°, more than half a turn; ask for fewer frames, a smaller gap or a farther axis"
    )]
    FanTurnsOver {
        /// From the first to the last frame.
        degrees: f64,
    },
    /// A fan beside the picture.
    #[error(
        "the fan leaves no pixel of a picture of {width}×{height} pixels; its numbers are in pixels of that picture"
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
        /// Which number.
        what: &'static str,
        /// As given.
        value: f64,
        /// The least.
        low: f64,
        /// The most.
        high: f64,
    },
    /// A fan that would be none.
    #[error(
        "a curvilinear transducer's field is a fan in square pixels only, not in pixels of {pixel_mm:?} mm; give one size"
    )]
    OblongPixels {
        /// Along u and v, mm.
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
        /// Which, from 0.
        frame: u32,
        /// How far it leaves the arm's plane.
        why: NotPlanar,
    },
    /// A motion beyond an arm's links.
    #[error("frame {frame} of the sweep cannot be made by this arm: {why}")]
    Unreachable {
        /// Which, from 0.
        frame: u32,
        /// By how much it is missed.
        why: Unreachable,
    },
    /// More voxels than a truth volume may have.
    #[error("a truth volume of {size:?} voxels is larger than the limit of {limit} voxels; choose a coarser spacing")]
    VolumeSize {
        /// Voxels along x, y, z.
        size: [u64; 3],
        /// The most voxels there may be.
        limit: u64,
    },
}

impl PhantomError {
    /// Refuses what is no positive, finite length.
    fn check_length(what: &'static str, mm: f64) -> Result<(), Self> {
        if mm.is_finite() && mm > 0.0 { Ok(()) } else { Err(Self::Length { what, mm }) }
    }
}
