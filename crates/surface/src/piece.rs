//! The part of a surface in one brick: its vertices, and the cells that they lie in.

use glam::{DAffine3, DMat3, DVec3};

use volume::brick::{BrickIndex, EDGE, VOXELS};

use crate::cell::{Trilinear, sheets};

/// Voxels along the edge of a brick's cells: its own, and the first of the next brick.
const CORNERS: usize = EDGE + 1;

/// A cell that the surface crosses.
#[derive(Debug, Clone, Copy)]
struct Cell {
    /// Bit k tells whether corner k is inside.
    inside: u8,
    /// Index of its first vertex; one follows for each sheet.
    first: u16,
}

/// Vertices of the cells of a brick, in the order of the cells, x fastest.
#[derive(Debug, Default)]
pub(crate) struct Piece {
    /// A bit for each cell: whether the surface crosses it.
    crossed: [u64; VOXELS / 64],
    /// Number of crossed cells before each word of `crossed`.
    before: [u16; VOXELS / 64],
    cells: Vec<Cell>,
    /// Crossed edges from the lowest corners of the cells: most quads of the brick.
    quads: u32,
    /// Positions in the world, mm.
    pub(crate) vertices: Vec<[f32; 3]>,
    /// Directions to lower grey values.
    pub(crate) normals: Vec<[f32; 3]>,
}

/// Maps of vertices and gradients to the world.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ToWorld {
    world_from_lattice: DAffine3,
    /// Gradients per voxel to gradients per mm.
    gradient: DMat3,
}

impl ToWorld {
    /// Derives both from the map of voxel indices to world mm.
    pub(crate) fn new(world_from_lattice: DAffine3) -> Self {
        Self { world_from_lattice, gradient: world_from_lattice.matrix3.inverse().transpose() }
    }

    fn position(&self, place: DVec3) -> [f32; 3] {
        self.world_from_lattice.transform_point3(place).as_vec3().to_array()
    }

    /// Returns the direction to lower values; along z where values do not change.
    fn normal(&self, gradient: DVec3) -> [f32; 3] {
        (-(self.gradient * gradient)).normalize_or(DVec3::Z).as_vec3().to_array()
    }
}

/// Cells along x that the surface crosses: one bit each, from rows of voxels.
#[derive(Debug, Clone, Copy, Default)]
struct Row {
    seen: u16,
    inside: u16,
}

impl Row {
    fn of(values: &[f32; CORNERS], iso: f32) -> Self {
        let bits = |is: fn(f32, f32) -> bool| {
            let bit = |x: usize| if is(values[x], iso) { 1 << x } else { 0 };
            std::array::from_fn::<u16, CORNERS, _>(bit).into_iter().fold(0, |bits, bit| bits | bit)
        };
        Self { seen: bits(|value, _| !value.is_nan()), inside: bits(|value, iso| value >= iso) }
    }
}

impl Piece {
    /// Meshes the cells of a brick from the values of its 9³ voxels, x fastest, NaN where unseen.
    pub(crate) fn new(brick: BrickIndex, values: &[f32], iso: f32, to_world: &ToWorld) -> Self {
        let mut rows = [Row::default(); CORNERS * CORNERS];
        for (row, values) in rows.iter_mut().zip(values.as_chunks().0) {
            *row = Row::of(values, iso);
        }
        let around =
            |y: usize, z: usize| [(y, z), (y + 1, z), (y, z + 1), (y + 1, z + 1)].map(|(y, z)| rows[z * CORNERS + y]);
        let lines: [u16; EDGE * EDGE] = std::array::from_fn(|line| crossed_cells(&around(line % EDGE, line / EDGE)));
        let cells = lines.iter().map(|crossed| crossed.count_ones() as usize).sum();
        let mut piece = Self {
            cells: Vec::with_capacity(cells),
            vertices: Vec::with_capacity(cells),
            normals: Vec::with_capacity(cells),
            ..Self::default()
        };
        let low = DVec3::from_array(brick.map(|b| f64::from(b) * EDGE as f64));
        for (line, mut crossed) in lines.into_iter().enumerate().filter(|(_, crossed)| *crossed != 0) {
            let (y, z) = (line % EDGE, line / EDGE);
            let around = around(y, z);
            while crossed != 0 {
                let x = crossed.trailing_zeros() as usize;
                crossed &= crossed - 1;
                let inside =
                    (0..8).fold(0, |inside, k| inside | (((around[k / 2].inside >> (x + k % 2)) & 1) << k)) as u8;
                let corner = |k: usize| values[((z + k / 4) * CORNERS + y + k / 2 % 2) * CORNERS + x + k % 2];
                let corners = Trilinear(std::array::from_fn(|k| f64::from(corner(k))));
                let place = low + DVec3::new(x as f64, y as f64, z as f64);
                piece.push(line * EDGE + x, inside, &corners, f64::from(iso), place, to_world);
            }
        }
        let mut before = 0;
        for (word, crossed) in piece.before.iter_mut().zip(piece.crossed) {
            *word = before;
            before += crossed.count_ones() as u16;
        }
        piece
    }

    fn push(&mut self, cell: usize, inside: u8, corners: &Trilinear, iso: f64, place: DVec3, to_world: &ToWorld) {
        self.crossed[cell / 64] |= 1 << (cell % 64);
        let next = [inside >> 1, inside >> 2, inside >> 4];
        self.quads += next.into_iter().map(|next| u32::from((inside ^ next) & 1)).sum::<u32>();
        self.cells.push(Cell { inside, first: self.vertices.len() as u16 });
        let sheets = sheets(inside);
        for sheet in 0..sheets.count {
            let (vertex, gradient) = corners.vertex(sheets.edges(sheet), iso);
            self.vertices.push(to_world.position(place + vertex));
            self.normals.push(to_world.normal(gradient));
        }
    }

    /// Returns the crossed cells and their corners inside, as bits, in order.
    pub(crate) fn cells(&self) -> impl Iterator<Item = (usize, u8)> {
        let bits = self.crossed.iter().enumerate().flat_map(|(word, crossed)| {
            let after = |crossed: &u64| Some(crossed & (crossed - 1)).filter(|rest| *rest != 0);
            let rests = std::iter::successors(Some(*crossed).filter(|crossed| *crossed != 0), after);
            rests.map(move |rest| word * 64 + rest.trailing_zeros() as usize)
        });
        bits.zip(self.cells.iter().map(|cell| cell.inside))
    }

    /// Returns the index of the vertex whose sheet crosses an edge of a cell; `None` if there is
    /// none.
    pub(crate) fn vertex(&self, cell: usize, edge: usize) -> Option<usize> {
        let (word, bit) = (cell / 64, cell % 64);
        if (self.crossed[word] >> bit) & 1 == 0 {
            return None;
        }
        let below = self.crossed[word] & ((1 << bit) - 1);
        let Cell { inside, first } = self.cells[usize::from(self.before[word]) + below.count_ones() as usize];
        sheets(inside).of_edge(edge).map(|sheet| usize::from(first) + usize::from(sheet))
    }

    /// Largest number of triangles of the brick's edges.
    pub(crate) fn most_triangles(&self) -> u64 {
        2 * u64::from(self.quads)
    }

    /// Bytes used.
    pub(crate) fn bytes(&self) -> u64 {
        let held = size_of::<Self>()
            + self.cells.capacity() * size_of::<Cell>()
            + (self.vertices.capacity() + self.normals.capacity()) * size_of::<[f32; 3]>();
        held as u64
    }
}

/// Returns the cells between four rows whose corners are all seen, some inside and some not.
fn crossed_cells(around: &[Row; 4]) -> u16 {
    let [mut seen, mut all, mut any] =
        around.iter().fold([!0, !0, 0], |[seen, all, any], row| [seen & row.seen, all & row.inside, any | row.inside]);
    seen &= seen >> 1;
    all &= all >> 1;
    any |= any >> 1;
    seen & any & !all & ((1 << EDGE) - 1)
}
