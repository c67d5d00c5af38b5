//! Layout of three orthogonal planes in one picture, all at the same mm per pixel.

use glam::DVec3;

use super::plane::{Box3, Section, basis};
use super::{SectionError, numbers};

/// Margins around planes in a picture, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Room {
    /// Around everything and between planes.
    pub gap: u32,
    /// Above each plane.
    pub above: u32,
    /// Left of each plane.
    pub left: u32,
    /// Below each plane.
    pub below: u32,
    /// Below everything.
    pub foot: u32,
}

/// A plane in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Panel {
    /// Axes of the box (0 = x) that run right and down, and the one that the plane cuts.
    pub axes: [usize; 3],
    /// Its first pixel in the picture.
    pub corner: [u32; 2],
    /// Its pixels.
    pub section: Section,
    /// Position of the plane on its third axis: voxel index, fractional.
    pub at_voxel: f64,
}

/// Arrangement of planes beside each other.
struct Arrangement {
    /// For each plane, the axes that run right and down, and column and row of the picture.
    planes: [([usize; 3], [usize; 2]); 3],
    columns: usize,
    rows: usize,
}

const ARRANGEMENTS: [Arrangement; 3] = [
    // xy, right of it zy with the same y, below it xz with the same x.
    Arrangement { planes: [([0, 1, 2], [0, 0]), ([0, 2, 1], [0, 1]), ([2, 1, 0], [1, 0])], columns: 2, rows: 2 },
    Arrangement { planes: [([0, 1, 2], [0, 0]), ([0, 2, 1], [1, 0]), ([1, 2, 0], [2, 0])], columns: 3, rows: 1 },
    Arrangement { planes: [([0, 1, 2], [0, 0]), ([0, 2, 1], [0, 1]), ([1, 2, 0], [0, 2])], columns: 1, rows: 3 },
];

/// Returns the planes across the axes of a volume's box through a point (world mm; the box's
/// middle if `None`). Chooses the arrangement that shows them largest in `size` pixels. If the
/// axes are not orthogonal, the planes are across x, across the part of y perpendicular to x,
/// and across the part of z perpendicular to both.
///
/// # Errors
/// [`SectionError::Misses`] for a point outside the box, [`SectionError::Room`] for a picture
/// without room.
pub fn three(place: &Box3, through: Option<DVec3>, size: [u32; 2], room: Room) -> Result<[Panel; 3], SectionError> {
    let basis = basis(place.world_from_lattice.matrix3);
    let through = through.unwrap_or_else(|| place.middle());
    let lattice = place.lattice_from_world().transform_point3(through);
    let inside = (0..3).all(|a| {
        let half = 0.5 + 1e-9;
        lattice[a] >= place.low[a] as f64 - half && lattice[a] <= place.high[a] as f64 + half
    });
    if !inside {
        let [low, high] = place.world_bounds();
        return Err(SectionError::Misses { what: format!("the point {} mm", numbers(through)), low, high });
    }
    // In coordinates along the basis.
    let corners = place.corners().map(|c| basis.transpose() * c);
    let low = corners.iter().copied().fold(corners[0], DVec3::min);
    let high = corners.iter().copied().fold(corners[0], DVec3::max);
    let (edge, at) = (high - low, basis.transpose() * through);

    let mut best: Option<(f64, &Arrangement)> = None;
    for arrangement in &ARRANGEMENTS {
        if let Some(scale) = arrangement.scale(edge, size, room)
            && best.is_none_or(|(largest, _)| scale > largest)
        {
            best = Some((scale, arrangement));
        }
    }
    let (scale, arrangement) = best.ok_or(SectionError::Room { size })?;
    // At least one pixel, and no more than there is room for.
    let pixels = edge.to_array().map(|mm| ((mm * scale + 1e-6).floor() as u32).max(1));
    let (columns, rows) = arrangement.cells(|axis| pixels[axis], |a, b| a.max(b), 0);
    let used = |cells: &[u32], fixed: u32| cells.iter().sum::<u32>() + fixed;
    let [fixed_x, fixed_y] = arrangement.fixed(room);
    // Unused pixels become an outer margin.
    let spare = [size[0].saturating_sub(used(&columns, fixed_x)) / 2, size[1].saturating_sub(used(&rows, fixed_y)) / 2];
    Ok(arrangement.planes.map(|(axes, [column, row])| {
        let before = |cells: &[u32], n: usize, each: u32| cells[..n].iter().sum::<u32>() + each * n as u32;
        let corner = [
            spare[0] + room.gap + room.left + before(&columns, column, room.gap + room.left),
            spare[1] + room.gap + room.above + before(&rows, row, room.gap + room.above + room.below),
        ];
        let [right, down, cut] = axes;
        let mm = 1.0 / scale;
        // The plane's pixels about the middle of its extent.
        let mut first = DVec3::ZERO;
        for axis in [right, down] {
            first[axis] = 0.5 * (low[axis] + high[axis]) - 0.5 * mm * (f64::from(pixels[axis]) - 1.0);
        }
        first[cut] = at[cut];
        let section = Section {
            first: basis * first,
            right: basis.col(right) * mm,
            down: basis.col(down) * mm,
            size: [pixels[right], pixels[down]],
        };
        Panel { axes, corner, section, at_voxel: lattice[cut] }
    }))
}

impl Arrangement {
    /// Returns the size of each column and row, from the size along each axis.
    fn cells<T: Copy>(&self, of: impl Fn(usize) -> T, larger: impl Fn(T, T) -> T, none: T) -> (Vec<T>, Vec<T>) {
        let (mut columns, mut rows) = (vec![none; self.columns], vec![none; self.rows]);
        for ([right, down, _], [column, row]) in self.planes {
            columns[column] = larger(columns[column], of(right));
            rows[row] = larger(rows[row], of(down));
        }
        (columns, rows)
    }

    /// Returns the pixels across and down that belong to no plane.
    fn fixed(&self, room: Room) -> [u32; 2] {
        let (columns, rows) = (self.columns as u32, self.rows as u32);
        [
            (columns + 1) * room.gap + columns * room.left,
            (rows + 1) * room.gap + rows * (room.above + room.below) + room.foot,
        ]
    }

    /// Returns pixels per mm; `None` if nothing fits.
    fn scale(&self, edge: DVec3, size: [u32; 2], room: Room) -> Option<f64> {
        let (columns, rows) = self.cells(|axis| edge[axis], f64::max, 0.0);
        let free: Vec<f64> =
            self.fixed(room).iter().zip(size).map(|(fixed, all)| f64::from(all) - f64::from(*fixed)).collect();
        let scale = (free[0] / columns.iter().sum::<f64>()).min(free[1] / rows.iter().sum::<f64>());
        // The thinnest axis may be rounded up to a pixel.
        (free.iter().all(|pixels| *pixels >= 8.0) && scale > 0.0).then_some(scale)
    }
}
