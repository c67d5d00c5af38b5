//! Binary STL: a header of 80 bytes, the number of triangles, and 50 bytes for each.

use std::io::{self, Write};

use glam::Vec3;

use crate::mesh::Mesh;

/// Bytes of the header.
const HEADER: usize = 80;
/// Begins the header. A file that begins with "solid" is taken for STL as text.
const UNIT: &str = "STL in mm";

/// Writes a mesh. The header holds the beginning of the provenance.
pub(super) fn write(
    mesh: &Mesh,
    lines: impl Iterator<Item = String>,
    to: &mut (impl Write + ?Sized),
) -> io::Result<()> {
    to.write_all(&header(lines))?;
    to.write_all(&(mesh.triangles.len() as u32).to_le_bytes())?;
    for triangle in &mesh.triangles {
        let corners = triangle.map(|vertex| Vec3::from_array(mesh.vertices[vertex as usize]));
        let [a, b, c] = corners.map(Vec3::as_dvec3);
        let normal = (b - a).cross(c - a).normalize_or_zero().as_vec3();
        let mut record = [0; 50];
        let numbers = [normal, corners[0], corners[1], corners[2]].into_iter().flat_map(|v| v.to_array());
        for (bytes, number) in record.chunks_exact_mut(4).zip(numbers) {
            bytes.copy_from_slice(&number.to_le_bytes());
        }
        to.write_all(&record)?;
    }
    Ok(())
}

/// Returns the header, filled with spaces. Characters outside ASCII become `?`.
fn header(lines: impl Iterator<Item = String>) -> [u8; HEADER] {
    let text = lines.fold(UNIT.to_owned(), |text, line| text + "; " + &line);
    let mut header = [b' '; HEADER];
    for (byte, c) in header.iter_mut().zip(text.chars()) {
        *byte = if c.is_ascii() { c as u8 } else { b'?' };
    }
    header
}
