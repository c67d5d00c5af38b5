//! Pieces of bricks to a mesh: the quads around the edges between voxels, each as two triangles.

use std::collections::BTreeMap;

use rayon::prelude::*;

use volume::brick::{BrickIndex, EDGE};

use crate::error::SurfaceError;
use crate::mesh::Mesh;
use crate::piece::Piece;

/// Joins pieces in the order of their bricks. `is_mirrored` tells whether the map of voxels to the
/// world mirrors.
///
/// # Errors
/// [`SurfaceError::Vertices`] if indices of 32 bits do not suffice.
pub(crate) fn join(pieces: &BTreeMap<BrickIndex, Piece>, is_mirrored: bool) -> Result<Mesh, SurfaceError> {
    let count = pieces.values().map(|piece| piece.vertices.len() as u64).sum::<u64>();
    if count > u64::from(u32::MAX) {
        return Err(SurfaceError::Vertices { count });
    }
    let mut first = 0;
    let placed: Vec<Placed> = pieces
        .iter()
        .map(|(brick, piece)| {
            let placed = Placed { brick: *brick, piece, first };
            first += piece.vertices.len() as u32;
            placed
        })
        .collect();
    let gather =
        |of: fn(&Piece) -> &[[f32; 3]]| placed.iter().map(|placed| of(placed.piece)).collect::<Vec<_>>().concat();
    let vertices = gather(|piece| &piece.vertices);
    let triangles: Vec<Vec<[u32; 3]>> = (0..placed.len())
        .into_par_iter()
        .map(|at| triangles(&Neighbourhood::new(&placed, at), &vertices, is_mirrored))
        .collect();
    Ok(Mesh { normals: gather(|piece| &piece.normals), vertices, triangles: triangles.concat() })
}

/// A brick's piece, and the index of its first vertex in the mesh.
#[derive(Clone, Copy)]
struct Placed<'a> {
    brick: BrickIndex,
    piece: &'a Piece,
    first: u32,
}

/// A piece and those beside it, by the axes along which they are lower, as bits.
struct Neighbourhood<'a>([Option<Placed<'a>>; 8], &'a Piece);

impl<'a> Neighbourhood<'a> {
    fn new(placed: &[Placed<'a>], at: usize) -> Self {
        let Placed { brick, piece, .. } = placed[at];
        let find = |lower: usize| {
            let other: BrickIndex = [0, 1, 2].map(|a| brick[a].saturating_sub(((lower >> a) & 1) as i32));
            placed[..=at].binary_search_by_key(&other, |placed| placed.brick).ok().map(|found| placed[found])
        };
        Self(std::array::from_fn(find), piece)
    }

    /// Returns the mesh's vertex in a cell, for the sheet that crosses an edge of it. Coordinates
    /// of the cell may be −1.
    fn vertex(&self, cell: [i32; 3], edge: usize) -> Option<u32> {
        let edge_voxels = EDGE as i32;
        let lower = (0..3).fold(0, |lower, a| lower | (usize::from(cell[a] < 0) << a));
        let [x, y, z] = cell.map(|at| at.rem_euclid(edge_voxels) as usize);
        let Placed { piece, first, .. } = self.0[lower]?;
        piece.vertex((z * EDGE + y) * EDGE + x, edge).map(|vertex| first + vertex as u32)
    }
}

/// Returns the triangles around those edges that begin at a voxel of a brick. Each edge is that of
/// the lowest corner of a cell, and the quad around it has a vertex in each of the four cells.
fn triangles(around: &Neighbourhood, vertices: &[[f32; 3]], is_mirrored: bool) -> Vec<[u32; 3]> {
    let mut triangles = Vec::with_capacity(around.1.most_triangles() as usize);
    for (number, inside) in around.1.cells() {
        let cell = [number % EDGE, number / EDGE % EDGE, number / (EDGE * EDGE)].map(|at| at as i32);
        let is_inside = |corner: usize| (inside >> corner) & 1 == 1;
        for axis in (0..3).filter(|axis| is_inside(0) != is_inside(1 << axis)) {
            let Some(quad) = quad(around, cell, axis) else { continue };
            let [a, b, c, d] = quad;
            let quad = if is_inside(0) == is_mirrored { [a, d, c, b] } else { quad };
            triangles.extend(split(quad, vertices));
        }
    }
    triangles
}

/// Returns the vertices around the edge along `axis` from a cell's lowest corner, counter-clockwise
/// as seen from the edge's end; `None` if a cell has none, as one of its corners is unseen.
fn quad(around: &Neighbourhood, cell: [i32; 3], axis: usize) -> Option<[u32; 4]> {
    // Bit 0 is a step down along the next axis, bit 1 along the one after it.
    let vertex = |steps: usize| {
        let mut cell = cell;
        cell[(axis + 1) % 3] -= (steps & 1) as i32;
        cell[(axis + 2) % 3] -= (steps >> 1) as i32;
        around.vertex(cell, 4 * axis + steps)
    };
    Some([vertex(0)?, vertex(1)?, vertex(3)?, vertex(2)?])
}

/// Splits a quad along its shorter diagonal; along the first if both are equal.
fn split([a, b, c, d]: [u32; 4], vertices: &[[f32; 3]]) -> [[u32; 3]; 2] {
    let distance = |p: u32, q: u32| {
        let (p, q) = (vertices[p as usize], vertices[q as usize]);
        (0..3).map(|k| (f64::from(p[k]) - f64::from(q[k])).powi(2)).sum::<f64>()
    };
    if distance(b, d) < distance(a, c) { [[a, b, d], [b, c, d]] } else { [[a, b, c], [a, c, d]] }
}
