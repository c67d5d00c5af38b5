//! Wavefront OBJ, as text. Numbers read back as the same bits.

use std::io::{self, Write};

use crate::mesh::Mesh;

/// Writes a mesh, the provenance as comments.
pub(super) fn write(
    mesh: &Mesh,
    lines: impl Iterator<Item = String>,
    to: &mut (impl Write + ?Sized),
) -> io::Result<()> {
    writeln!(to, "# unit: mm")?;
    for line in lines {
        writeln!(to, "# {line}")?;
    }
    for [x, y, z] in &mesh.vertices {
        writeln!(to, "v {x} {y} {z}")?;
    }
    for [x, y, z] in &mesh.normals {
        writeln!(to, "vn {x} {y} {z}")?;
    }
    for triangle in &mesh.triangles {
        // Indices begin at 1.
        let [a, b, c] = triangle.map(|vertex| u64::from(vertex) + 1);
        writeln!(to, "f {a}//{a} {b}//{b} {c}//{c}")?;
    }
    Ok(())
}
