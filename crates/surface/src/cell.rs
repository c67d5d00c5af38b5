//! A cell: the cube between eight voxels, and the sheets in which a surface crosses it.
//!
//! Bit a of a corner's number is its place along axis a. Edge 4·a + p runs along axis a; bit 0 of p
//! is its place along the next axis, bit 1 that along the one after it.

use std::sync::LazyLock;

use glam::DVec3;

/// Edges of a cell.
pub(crate) const EDGES: usize = 12;

/// The sheets of a surface in a cell, by its crossings of the edges.
///
/// Two bodies may pass through a cell without touching, and each has a sheet and a vertex of its
/// own. With one vertex for both, four triangles would share an edge.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sheets {
    /// Number of sheets, 0 to 4.
    pub(crate) count: u8,
    /// Edges that each sheet crosses, as bits.
    edges: [u16; 4],
}

impl Sheets {
    /// Returns the edges that a sheet crosses.
    pub(crate) fn edges(&self, sheet: u8) -> impl Iterator<Item = usize> + use<> {
        let mut rest = self.edges[usize::from(sheet)];
        std::iter::from_fn(move || {
            let edge = rest.trailing_zeros() as usize;
            rest &= rest.wrapping_sub(1);
            (edge < EDGES).then_some(edge)
        })
    }

    /// Returns the sheet that crosses an edge; `None` if none does.
    pub(crate) fn of_edge(&self, edge: usize) -> Option<u8> {
        (0..self.count).find(|sheet| (self.edges[usize::from(*sheet)] >> edge) & 1 == 1)
    }
}

/// Returns the sheets of a cell. Bit k of `inside` tells whether corner k is inside.
pub(crate) fn sheets(inside: u8) -> &'static Sheets {
    static ALL: LazyLock<[Sheets; 256]> = LazyLock::new(|| std::array::from_fn(|inside| find_sheets(inside as u8)));
    &ALL[usize::from(inside)]
}

/// Corners of each edge, the lower one first.
const CORNERS: [[usize; 2]; EDGES] = {
    let mut corners = [[0; 2]; EDGES];
    let mut edge = 0;
    while edge < EDGES {
        corners[edge] = corners_of(edge);
        edge += 1;
    }
    corners
};

/// Positions of the corners in their cell.
const PLACES: [DVec3; 8] = {
    let mut places = [DVec3::ZERO; 8];
    let mut corner = 0;
    while corner < 8 {
        places[corner] = DVec3::new((corner & 1) as f64, (corner >> 1 & 1) as f64, (corner >> 2) as f64);
        corner += 1;
    }
    places
};

/// Returns the corners of an edge, the lower one first.
const fn corners_of(edge: usize) -> [usize; 2] {
    let (axis, place) = (edge / 4, edge % 4);
    let low = ((place & 1) << ((axis + 1) % 3)) | ((place >> 1) << ((axis + 2) % 3));
    [low, low | (1 << axis)]
}

/// Follows the surface over the faces: two crossings of a face are ends of one curve. If there
/// are four, a curve cuts off each corner inside, so that diagonal corners remain apart. The cell
/// beyond the face finds the same curves.
fn find_sheets(inside: u8) -> Sheets {
    let is_inside = |corner: usize| (inside >> corner) & 1 == 1;
    let is_crossed = |edge: &usize| {
        let [low, high] = CORNERS[*edge];
        is_inside(low) != is_inside(high)
    };
    let mut group: [usize; EDGES] = std::array::from_fn(|edge| edge);
    let mut unite = |a: usize, b: usize| {
        let (to, from) = (group[a].min(group[b]), group[a].max(group[b]));
        group.iter_mut().filter(|of| **of == from).for_each(|of| *of = to);
    };
    for (corners, edges) in (0..6).map(face) {
        let crossed: Vec<usize> = edges.into_iter().filter(is_crossed).collect();
        match crossed[..] {
            [a, b] => unite(a, b),
            [_, _, _, _] => {
                (0..4).filter(|i| is_inside(corners[*i])).for_each(|i| unite(edges[i], edges[(i + 3) % 4]));
            }
            _ => {}
        }
    }
    let mut sheets = Sheets { count: 0, edges: [0; 4] };
    for lowest in (0..EDGES).filter(|edge| is_crossed(edge) && group[*edge] == *edge) {
        let edges = (0..EDGES).filter(|edge| is_crossed(edge) && group[*edge] == lowest);
        sheets.edges[usize::from(sheets.count)] = edges.fold(0, |edges, edge| edges | (1 << edge));
        sheets.count += 1;
    }
    sheets
}

/// Returns the corners of a face in turn, and the edges from each to the next.
fn face(number: usize) -> ([usize; 4], [usize; 4]) {
    let (axis, side) = (number / 2, number % 2);
    let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
    let corners = [0, 1 << b, (1 << b) | (1 << c), 1 << c].map(|corner| corner | (side << axis));
    let edge_between = |i: usize| {
        let ends = [corners[i], corners[(i + 1) % 4]];
        let ends = [ends[0].min(ends[1]), ends[0].max(ends[1])];
        (0..EDGES).find(|edge| CORNERS[*edge] == ends).unwrap_or(0)
    };
    (corners, std::array::from_fn(edge_between))
}

/// Least distance of a vertex from its cell's border, in edges of the cell.
pub(crate) const BORDER: f64 = 1.0 / 4096.0;

/// Grey values at the corners of a cell, trilinear between them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Trilinear(pub(crate) [f64; 8]);

impl Trilinear {
    /// Returns the value and its gradient at a place in the cell, each coordinate in 0..=1.
    pub(crate) fn at(&self, p: DVec3) -> (f64, DVec3) {
        let c = &self.0;
        let lerp = |a: f64, b: f64, t: f64| a + (b - a) * t;
        let x: [f64; 4] = std::array::from_fn(|i| lerp(c[2 * i], c[2 * i + 1], p.x));
        let dx: [f64; 4] = std::array::from_fn(|i| c[2 * i + 1] - c[2 * i]);
        let y = [lerp(x[0], x[1], p.y), lerp(x[2], x[3], p.y)];
        let along_x = lerp(lerp(dx[0], dx[1], p.y), lerp(dx[2], dx[3], p.y), p.z);
        let along_y = lerp(x[1] - x[0], x[3] - x[2], p.z);
        (lerp(y[0], y[1], p.z), DVec3::new(along_x, along_y, y[1] - y[0]))
    }

    /// Returns the place on an edge where the value is `iso`, which lies between those of its ends.
    pub(crate) fn crossing(&self, edge: usize, iso: f64) -> DVec3 {
        let [low, high] = CORNERS[edge];
        let t = (iso - self.0[low]) / (self.0[high] - self.0[low]);
        PLACES[low] + (PLACES[high] - PLACES[low]) * t
    }

    /// Returns the vertex of the sheet that crosses these edges, and the gradient there.
    ///
    /// It is the mean of the crossings, moved towards `iso` by one step of Newton's method along
    /// the gradient. It stays in the cell, beside its border: vertices of neighbours never meet,
    /// also where a voxel has the value of the surface, and files without indices stay closed.
    pub(crate) fn vertex(&self, edges: impl Iterator<Item = usize>, iso: f64) -> (DVec3, DVec3) {
        let (sum, count) =
            edges.fold((DVec3::ZERO, 0.0), |(sum, count), edge| (sum + self.crossing(edge, iso), count + 1.0));
        let mean = sum / count;
        let (value, gradient) = self.at(mean);
        let steepness = gradient.length_squared();
        let step = if steepness > 0.0 { gradient * ((value - iso) / steepness) } else { DVec3::ZERO };
        let vertex = (mean - step).clamp(DVec3::splat(BORDER), DVec3::splat(1.0 - BORDER));
        (vertex, self.at(vertex).1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_crossed_edge_has_one_sheet() {
        for inside in 0..=255_u8 {
            let sheets = sheets(inside);
            let crossed = (0..EDGES)
                .filter(|edge| CORNERS[*edge].map(|k| inside >> k & 1).iter().sum::<u8>() == 1)
                .collect::<Vec<_>>();
            let mut listed: Vec<usize> = (0..sheets.count).flat_map(|sheet| sheets.edges(sheet)).collect();
            assert!((0..sheets.count).all(|sheet| sheets.edges(sheet).count() >= 3), "{inside:08b}");
            listed.sort_unstable();
            assert_eq!(listed, crossed, "{inside:08b}");
        }
    }

    #[test]
    fn diagonal_corners_have_sheets_of_their_own() {
        assert_eq!(sheets(0b0000_0001).count, 1);
        assert_eq!(sheets(0b0000_1001).count, 2);
        assert_eq!(sheets(0b1000_0001).count, 2);
        assert_eq!(sheets(0b0110_1001).count, 4);
        assert_eq!(sheets(0b0000_1111).count, 1);
    }

    #[test]
    fn vertex_of_linear_values_lies_on_their_plane() {
        let slope = DVec3::new(3.0, -2.0, 1.0);
        let values = Trilinear(std::array::from_fn(|corner| PLACES[corner].dot(slope)));
        let inside = (0..8).filter(|k| values.0[*k] >= 0.7).fold(0, |inside, k| inside | 1 << k);
        let sheets = sheets(inside);
        assert_eq!(sheets.count, 1);
        let (vertex, gradient) = values.vertex(sheets.edges(0), 0.7);
        assert!((vertex.dot(slope) - 0.7).abs() < 1e-12);
        assert!((gradient - slope).length() < 1e-12);
    }
}
