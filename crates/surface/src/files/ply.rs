//! Binary PLY, little-endian: vertices with normals, and triangles.

use std::io::{self, Write};

use crate::mesh::Mesh;

/// Writes a mesh, the provenance as comments.
pub(super) fn write(
    mesh: &Mesh,
    lines: impl Iterator<Item = String>,
    to: &mut (impl Write + ?Sized),
) -> io::Result<()> {
    writeln!(to, "ply\nformat binary_little_endian 1.0\ncomment unit: mm")?;
    for line in lines {
        writeln!(to, "comment {line}")?;
    }
    writeln!(to, "element vertex {}", mesh.vertices.len())?;
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        writeln!(to, "property float {name}")?;
    }
    writeln!(to, "element face {}\nproperty list uchar uint vertex_indices\nend_header", mesh.triangles.len())?;
    for (position, normal) in mesh.vertices.iter().zip(&mesh.normals) {
        let mut record = [0; 24];
        for (bytes, number) in record.chunks_exact_mut(4).zip(position.iter().chain(normal)) {
            bytes.copy_from_slice(&number.to_le_bytes());
        }
        to.write_all(&record)?;
    }
    for triangle in &mesh.triangles {
        let mut record = [3; 13];
        for (bytes, vertex) in record[1..].chunks_exact_mut(4).zip(triangle) {
            bytes.copy_from_slice(&vertex.to_le_bytes());
        }
        to.write_all(&record)?;
    }
    Ok(())
}
