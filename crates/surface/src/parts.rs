//! Parts of a mesh that share no vertex.

use crate::mesh::Mesh;

/// Splits a mesh into its parts, that with the most triangles first, and equal ones in the order of
/// their vertices. Vertices without triangles are in none.
pub fn parts(mesh: &Mesh) -> Vec<Mesh> {
    let parts = Parts::new(mesh);
    let mut meshes = vec![Mesh::default(); parts.count() as usize];
    let mut moved = vec![0; mesh.vertices.len()];
    for (vertex, part) in parts.of_vertex.iter().enumerate() {
        if let Some(part) = part {
            let part = &mut meshes[*part as usize];
            moved[vertex] = part.vertices.len() as u32;
            part.vertices.push(mesh.vertices[vertex]);
            part.normals.push(mesh.normals[vertex]);
        }
    }
    for triangle in &mesh.triangles {
        if let Some(part) = parts.of_vertex[triangle[0] as usize] {
            meshes[part as usize].triangles.push(triangle.map(|vertex| moved[vertex as usize]));
        }
    }
    meshes.sort_by_key(|part| std::cmp::Reverse(part.triangles.len()));
    meshes
}

/// The part of each vertex.
pub(crate) struct Parts {
    /// Number of the part, in the order of their first vertices; `None` without triangles.
    of_vertex: Vec<Option<u32>>,
}

impl Parts {
    /// Finds the parts of a mesh.
    pub(crate) fn new(mesh: &Mesh) -> Self {
        let mut is_used = vec![false; mesh.vertices.len()];
        // The parent of a vertex is one of lower index, or itself.
        let mut parent: Vec<u32> = (0..mesh.vertices.len() as u32).collect();
        for &[a, b, c] in &mesh.triangles {
            [a, b, c].iter().for_each(|vertex| is_used[*vertex as usize] = true);
            unite(&mut parent, a, b);
            unite(&mut parent, a, c);
        }
        let mut of_vertex = vec![None; mesh.vertices.len()];
        let mut next = 0..;
        for vertex in (0..parent.len()).filter(|vertex| is_used[*vertex]) {
            let above = parent[vertex] as usize;
            of_vertex[vertex] = if above == vertex { next.next() } else { of_vertex[above] };
        }
        Self { of_vertex }
    }

    /// Number of parts.
    pub(crate) fn count(&self) -> u64 {
        self.of_vertex.iter().flatten().max().map_or(0, |last| u64::from(*last) + 1)
    }

    /// Number of vertices with triangles.
    pub(crate) fn vertices(&self) -> u64 {
        self.of_vertex.iter().flatten().count() as u64
    }
}

/// Joins the sets of two vertices, which have the lowest vertex as their root.
fn unite(parent: &mut [u32], a: u32, b: u32) {
    let (a, b) = (root(parent, a), root(parent, b));
    parent[a.max(b) as usize] = a.min(b);
}

fn root(parent: &mut [u32], mut vertex: u32) -> u32 {
    while parent[vertex as usize] != vertex {
        let next = parent[parent[vertex as usize] as usize];
        parent[vertex as usize] = next;
        vertex = next;
    }
    vertex
}
