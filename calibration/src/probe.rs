//! Probe calibration: the pose of the image's pixels in the frame of the sensor on the
//! transducer.
//!
//! The input is a scan of a static target whose pose is also fitted ([`target`]), or of a wire
//! phantom ([`crate::phantom`]) at a known pose:
//!
//! - [`dots`]: detects bright spots of an image.
//! - [`layout`], [`matching`]: assign them to wires.
//! - [`recording`], [`sighting`], [`track`]: observed and recognised images, and poses between
//!   poses.
//! - [`plane`], [`linear`]: the plane from dots and poses, as the start of the fit.
//! - [`refine`](mod@refine), [`scatter`]: the plane that explains all dots best, the tracker's
//!   lag, and their accuracy.
//! - `unknown`: the plane as parameters; [`plane_covariance`]: their covariance.
//! - [`errors`]: errors by PLUS's definition and by ours, on images that the fit did not use.
//! - [`next`]: the view to take next.
//! - [`calibrate`](mod@calibrate): the whole procedure, or the reason for a refusal.

pub mod calibrate;
pub mod dots;
pub mod errors;
pub mod layout;
pub mod linear;
pub mod matching;
pub mod next;
pub mod plane;
pub mod plane_covariance;
pub mod recording;
pub mod refine;
mod reread;
pub mod scatter;
pub mod sighting;
pub mod target;
pub mod track;
mod unknown;

pub use calibrate::{Calibration, calibrate};
pub use dots::DotFinder;
pub use layout::Layout;
pub use matching::Matcher;
pub use next::{NextView, next_view};
pub use recording::{Dots, Observation, Recording};
