//! Topology of a mesh: whether it is closed, its components, and its Euler number.

use crate::mesh::Mesh;
use crate::parts::Parts;

/// Counts of a mesh, from which follows whether it is closed. Vertices without triangles do not
/// count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Topology {
    /// Vertices of triangles.
    pub vertices: u64,
    /// Edges between two vertices.
    pub edges: u64,
    /// Triangles.
    pub triangles: u64,
    /// Parts that are not joined by a triangle's edge or corner.
    pub components: u64,
    /// Edges with more triangles on one side than on the other; most have one, and end the mesh.
    pub open_edges: u64,
    /// Edges of more than two triangles, as many in either direction: there, a body touches itself
    /// or another.
    pub non_manifold_edges: u64,
}

impl Topology {
    /// Counts a mesh.
    pub fn of(mesh: &Mesh) -> Self {
        let mut topology = Self {
            vertices: 0,
            edges: 0,
            triangles: mesh.triangles.len() as u64,
            components: 0,
            open_edges: 0,
            non_manifold_edges: 0,
        };
        let parts = Parts::new(mesh);
        (topology.vertices, topology.components) = (parts.vertices(), parts.count());
        for edges in SortedEdges::new(mesh).iter().flat_map(|edges| edges.chunk_by(|a, b| a.to == b.to)) {
            let forward = edges.iter().filter(|edge| edge.is_forward).count();
            topology.edges += 1;
            topology.open_edges += u64::from(2 * forward != edges.len());
            topology.non_manifold_edges += u64::from(2 * forward == edges.len() && edges.len() > 2);
        }
        topology
    }

    /// Whether each edge has as many triangles in one direction as in the other, one of each unless
    /// the edge is no manifold. Such a mesh encloses a volume.
    pub fn is_closed(&self) -> bool {
        self.open_edges == 0
    }

    /// Vertices − edges + triangles: 2 for each sphere, 0 for each torus.
    pub fn euler_number(&self) -> i64 {
        self.vertices as i64 - self.edges as i64 + self.triangles as i64
    }
}

/// A triangle's edge, from the vertex with the lower index.
#[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
struct Edge {
    to: u32,
    /// Whether the triangle runs along it in this direction.
    is_forward: bool,
}

/// The edges of all triangles, sorted by both vertices.
struct SortedEdges {
    edges: Vec<Edge>,
    /// For each vertex, the end of its edges.
    ends: Vec<usize>,
}

impl SortedEdges {
    fn new(mesh: &Mesh) -> Self {
        let all = || {
            let edge = |a: u32, b: u32| (a.min(b) as usize, Edge { to: a.max(b), is_forward: a < b });
            mesh.triangles.iter().flat_map(move |&[a, b, c]| [edge(a, b), edge(b, c), edge(c, a)])
        };
        let mut ends = vec![0; mesh.vertices.len()];
        all().for_each(|(from, _)| ends[from] += 1);
        let mut next = 0;
        for end in &mut ends {
            next += std::mem::replace(end, next);
        }
        // Each end is the beginning until its edges are placed.
        let mut edges = vec![Edge::default(); next];
        for (from, edge) in all() {
            edges[ends[from]] = edge;
            ends[from] += 1;
        }
        let mut sorted = Self { edges, ends };
        for vertex in 0..sorted.ends.len() {
            let range = sorted.range(vertex);
            sorted.edges[range].sort_unstable();
        }
        sorted
    }

    fn range(&self, vertex: usize) -> std::ops::Range<usize> {
        vertex.checked_sub(1).map_or(0, |before| self.ends[before])..self.ends[vertex]
    }

    /// Returns the edges of each vertex.
    fn iter(&self) -> impl Iterator<Item = &[Edge]> {
        (0..self.ends.len()).map(|vertex| &self.edges[self.range(vertex)])
    }
}
