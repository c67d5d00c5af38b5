//! Isosurfaces of a volume: the mesh between the voxels above and below a grey value, its area and
//! volume, and its files.
//!
//! - [`mesh`]: vertices, normals and triangles.
//! - [`surface_nets`]: the surface, kept by brick and updated where the volume changed.
//! - [`closed`]: whether a mesh is closed, its components and its Euler number.
//! - [`parts`]: bodies apart from each other.
//! - [`measure`]: area and enclosed volume.
//! - [`compensation`]: moves vertices back to where they were before kernel and point spread.
//! - [`files`]: STL, PLY, OBJ and GLB.
//! - `cell`: a cube of eight voxels, and the sheets of a surface in it.
//! - `piece`: the vertices of one brick.
//! - `join`: pieces to a mesh.
//! - `layers`: ranges of grey values of a brick, by which bricks are skipped.
//! - [`block`]: a cube of voxels, read from the volume.
//! - `smoothing`: smoothed derivatives of the volume.

pub mod block;
mod cell;
pub mod closed;
pub mod compensation;
mod error;
pub mod files;
mod join;
mod layers;
pub mod measure;
pub mod mesh;
pub mod parts;
mod piece;
mod smoothing;
pub mod surface_nets;
#[cfg(test)]
mod tests;
mod work;

pub use closed::Topology;
pub use compensation::{Compensation, compensate};
pub use error::SurfaceError;
pub use files::Format;
pub use mesh::Mesh;
pub use surface_nets::{IncrementalSurface, extract};
pub use work::SurfaceWork;
