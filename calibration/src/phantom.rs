//! Geometry of a wire phantom: wires between known points and landmarks to be touched, in the
//! phantom's own frame ([`Phantom`](sonoweave_core::frames::Phantom)).
//!
//! A wire appears as a dot in the image plane that cuts it. The dots of parallel wires are an
//! affine image of the wires' arrangement, for any plane. Slanted wires between them determine
//! the plane's position. The minimum is an [`Nwire`]: two parallel wires and one that leads
//! from one to the other. Its dot divides the distance of the other two dots as in the phantom
//! (Pagoulatos, Haynor and Kim, Ultrasound in Medicine and Biology 27, 2001).
//!
//! - [`file`](mod@file): this program's file format of it.
//! - [`Geometry`]: its wires and landmarks.
//! - [`find_nwires`]: the N's among its wires.
//! - [`plates`]: its construction from two plates with holes.

pub mod file;
pub mod find_nwires;
pub(crate) mod geometry;
pub mod plates;
mod wire;

pub use find_nwires::Nwire;
pub use geometry::{Geometry, Landmark};
pub use plates::Plates;
pub use wire::Wire;
