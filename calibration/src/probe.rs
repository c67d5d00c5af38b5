//! The probe's calibration: where the pixels of the picture lie in the frame of the sensor on the transducer.
//!
//! From a scan of something that rests and whose place is found with the rest ([`target`]), or from one of a phantom of wires ([`crate::phantom`]), whose poses are known:
//!
//! - [`dots`]: bright spots of a picture.
//! - [`layout`], [`matching`]: which of them is which wire's.
//! - [`sighting`], [`track`]: recognised pictures, and poses between poses.
//! - [`plane`], [`linear`]: the plane from dots and poses, where the rest begins.
//! - [`refine`](mod@refine), [`scatter`]: the plane that explains all dots best, the tracker's lag, and how sure they are.
//! - `unknown`: the plane as parameters.
//! - [`errors`]: how far it is off, by PLUS's definition and by ours, on pictures that had no part in it.
//! - [`next`]: which view to take next.
//! - [`calibrate`](mod@calibrate), [`refused`]: all of it in turn, or the reason why there is none.

pub mod calibrate;
pub mod dots;
pub mod errors;
pub mod layout;
pub mod linear;
pub mod matching;
pub mod next;
pub mod plane;
pub mod refine;
pub mod refused;
mod reread;
pub mod scatter;
pub mod sighting;
#[cfg(test)]
mod simulated;
pub mod target;
pub mod track;
mod unknown;

pub use calibrate::{Calibration, Observation, Recording, calibrate};
pub use dots::DotFinder;
pub use layout::Layout;
pub use matching::Matcher;
pub use next::{NextView, next_view};
pub use refused::Refused;
