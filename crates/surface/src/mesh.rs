//! A mesh of triangles in the world.

/// Bytes of a vertex with its normal.
pub(crate) const VERTEX_BYTES: u64 = size_of::<[[f32; 3]; 2]>() as u64;
/// Bytes of a triangle.
pub(crate) const TRIANGLE_BYTES: u64 = size_of::<[u32; 3]>() as u64;

/// Triangles between shared vertices. The order of both depends on the volume alone.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    /// Positions in the world, mm.
    pub vertices: Vec<[f32; 3]>,
    /// Direction of each vertex from higher to lower grey values, of length 1.
    pub normals: Vec<[f32; 3]>,
    /// Indices of vertices, counter-clockwise as seen from the lower grey values.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Whether it has no triangle.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Bytes that vertices, normals and triangles take.
    pub fn bytes(&self) -> u64 {
        self.vertices.len() as u64 * VERTEX_BYTES + self.triangles.len() as u64 * TRIANGLE_BYTES
    }

    /// Returns the lowest and the highest coordinate along each axis, mm; `None` without vertices.
    pub fn bounds(&self) -> Option<[[f32; 3]; 2]> {
        let first = *self.vertices.first()?;
        Some(self.vertices.iter().fold([first; 2], |[low, high], vertex| {
            [[0, 1, 2].map(|a| low[a].min(vertex[a])), [0, 1, 2].map(|a| high[a].max(vertex[a]))]
        }))
    }
}
