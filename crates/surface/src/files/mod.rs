//! Files of meshes, in world mm: STL, PLY, OBJ and GLB.

mod glb;
mod obj;
mod ply;
mod stl;

use std::io::{self, Write};
use std::path::Path;

use crate::error::SurfaceError;
use crate::mesh::Mesh;

/// Format of a mesh's file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Binary STL: triangles without shared vertices, for printers and CAD.
    Stl,
    /// Binary PLY, little-endian, with normals.
    Ply,
    /// Wavefront OBJ, with normals.
    Obj,
    /// Binary glTF 2.0, with normals. Programs show it in metres.
    Glb,
}

impl Format {
    /// Returns the format that a file's extension names.
    ///
    /// # Errors
    /// [`SurfaceError::Extension`] for any other.
    pub fn of(path: &Path) -> Result<Self, SurfaceError> {
        let extension = path.extension().and_then(|extension| extension.to_str()).map(str::to_ascii_lowercase);
        match extension.as_deref() {
            Some("stl") => Ok(Self::Stl),
            Some("ply") => Ok(Self::Ply),
            Some("obj") => Ok(Self::Obj),
            Some("glb") => Ok(Self::Glb),
            _ => Err(SurfaceError::Extension { path: path.to_owned() }),
        }
    }

    /// Writes a mesh. `provenance` is free text in lines; STL has room for its beginning only.
    ///
    /// # Errors
    /// Errors of `to`. The others are those of kind [`io::ErrorKind::InvalidInput`]:
    /// [`SurfaceError::Empty`] for a mesh without triangles, and [`SurfaceError::FileTooLarge`].
    pub fn write(self, mesh: &Mesh, provenance: &str, to: &mut (impl Write + ?Sized)) -> io::Result<()> {
        let refuse = |error: SurfaceError| Err(io::Error::new(io::ErrorKind::InvalidInput, error));
        let triangles = mesh.triangles.len() as u64;
        match self {
            _ if mesh.is_empty() => refuse(SurfaceError::Empty),
            Self::Stl if triangles > u64::from(u32::MAX) => {
                refuse(SurfaceError::FileTooLarge { format: "STL", triangles })
            }
            Self::Glb if mesh.bytes() > glb::MOST_BYTES => {
                refuse(SurfaceError::FileTooLarge { format: "GLB", triangles })
            }
            Self::Stl => stl::write(mesh, lines(provenance), to),
            Self::Ply => ply::write(mesh, lines(provenance), to),
            Self::Obj => obj::write(mesh, lines(provenance), to),
            Self::Glb => glb::write(mesh, lines(provenance), to),
        }
    }
}

/// Returns the lines of a text that are not empty, without control characters.
fn lines(text: &str) -> impl Iterator<Item = String> {
    let lines = text.lines().map(|line| line.chars().filter(|c| !c.is_control()).collect::<String>());
    lines.map(|line| line.trim().to_owned()).filter(|line| !line.is_empty())
}
