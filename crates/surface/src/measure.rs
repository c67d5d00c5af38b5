//! Area of a mesh, and the volume that it encloses.

use glam::DVec3;

use crate::closed::Topology;
use crate::error::SurfaceError;
use crate::mesh::Mesh;

/// Returns the area of the triangles, mm².
pub fn area_mm2(mesh: &Mesh) -> f64 {
    corners(mesh).map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).sum()
}

/// Returns the enclosed volume, mm³, by the divergence theorem. It is negative if the enclosed
/// grey values are lower than those around them, as in a cyst.
///
/// # Errors
/// [`SurfaceError::Empty`] without triangles; [`SurfaceError::Open`] for an open mesh, which has
/// no volume.
pub fn volume_mm3(mesh: &Mesh, topology: &Topology) -> Result<f64, SurfaceError> {
    if mesh.is_empty() {
        return Err(SurfaceError::Empty);
    }
    if !topology.is_closed() {
        return Err(SurfaceError::Open { open_edges: topology.open_edges });
    }
    // Positions relative to a vertex of the mesh keep the digits that a distant origin would take.
    let origin = position(mesh, mesh.triangles[0][0]);
    Ok(corners(mesh).map(|[a, b, c]| (a - origin).dot((b - origin).cross(c - origin)) / 6.0).sum())
}

/// Returns the corners of the triangles, mm.
pub(crate) fn corners(mesh: &Mesh) -> impl Iterator<Item = [DVec3; 3]> {
    mesh.triangles.iter().map(|triangle| triangle.map(|vertex| position(mesh, vertex)))
}

fn position(mesh: &Mesh, vertex: u32) -> DVec3 {
    DVec3::from_array(mesh.vertices[vertex as usize].map(f64::from))
}
