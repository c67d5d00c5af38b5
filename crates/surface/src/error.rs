//! Errors of surfaces.

use std::path::PathBuf;

/// Reasons why there is no surface, no volume of it, or no file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SurfaceError {
    /// A grey value that is NaN or infinite.
    #[error("grey value {iso} of the surface must be a finite number")]
    Iso {
        /// The grey value.
        iso: f32,
    },
    /// More memory than allowed.
    #[error(
        "the surface takes {} MiB of memory or more, of which {} may be taken: crop the volume, smooth it, choose another grey value, or raise the limit",
        mib(*needed_bytes), mib(*limit_bytes)
    )]
    Memory {
        /// Memory needed for the part that was meshed, bytes.
        needed_bytes: u64,
        /// Memory allowed, bytes.
        limit_bytes: u64,
    },
    /// More vertices than indices of 32 bits.
    #[error(
        "the surface has {count} vertices, more than a file can number: crop the volume, or choose another grey value"
    )]
    Vertices {
        /// Number of vertices.
        count: u64,
    },
    /// No triangle.
    #[error("no surface lies at this grey value: choose one between those of the body and of its surroundings")]
    Empty,
    /// A mesh with open edges.
    #[error(
        "the surface is open at {open_edges} edges, as coverage ends there, and encloses no volume: scan the whole body, or crop to one that was"
    )]
    Open {
        /// Edges with triangles on one side only.
        open_edges: u64,
    },
    /// A variance that is negative, or not finite.
    #[error("variance of the blur must be 0 mm² or more and finite, not {blur_mm2}")]
    Blur {
        /// The variance, mm².
        blur_mm2: f64,
    },
    /// A blur over too many voxels.
    #[error("a blur of {sigma_mm} mm spans {voxels} voxels, of at most {most}: take larger voxels")]
    WideBlur {
        /// Standard deviation, mm.
        sigma_mm: f64,
        /// Voxels on each side.
        voxels: u64,
        /// The limit.
        most: u64,
    },
    /// A file name without a known extension.
    #[error("{path}: the name of a surface's file must end in .stl, .ply, .obj or .glb", path = path.display())]
    Extension {
        /// The file.
        path: PathBuf,
    },
    /// A mesh that does not fit the file's numbers of 32 bits.
    #[error("a file of {format} cannot hold {triangles} triangles: choose PLY or OBJ, or crop the volume")]
    FileTooLarge {
        /// The format.
        format: &'static str,
        /// Number of triangles.
        triangles: u64,
    },
}

fn mib(bytes: u64) -> u64 {
    bytes.div_ceil(1 << 20)
}
